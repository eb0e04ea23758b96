"""The 3D scene: links, force arrows, sets of forces."""
