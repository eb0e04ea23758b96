"""One posture: question in, answer out."""
