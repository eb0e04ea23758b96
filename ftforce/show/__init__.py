"""Results in the terminal and in print."""
