"""Better postures and paths: what is left after the worst fault, made as large as possible."""
