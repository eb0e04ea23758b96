"""Analysis of a single posture."""
