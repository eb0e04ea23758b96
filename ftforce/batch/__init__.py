"""Fault analysis over many postures: sweeps, workspace maps, comparisons, real-time remap."""
