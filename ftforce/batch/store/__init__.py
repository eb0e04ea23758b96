"""Sweeps on disk: exclusive writing, description of the arrays, resuming."""
