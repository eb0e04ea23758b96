"""Sources of postures for sweeps, with random access to blocks, reproducible on any machine."""

from ftforce.batch.postures.postures import Grid, Postures

__all__ = ["Grid", "Postures"]
