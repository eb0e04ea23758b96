"""Better postures and paths: what a redundant arm can choose so that a fault costs less."""
