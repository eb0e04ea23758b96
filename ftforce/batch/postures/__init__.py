"""Where the postures of a sweep come from: any block of them, in any order, on any machine."""

from ftforce.batch.postures.postures import Grid, Postures

__all__ = ["Grid", "Postures"]
