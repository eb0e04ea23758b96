"""What numba compiles: arrays only; nothing of ftforce outside of this package is imported."""
