"""Numba kernels, on arrays only; this package imports nothing else of ftforce."""
