"""Many postures, all fault sets: sweeps, maps of the workspace, comparisons, the control loop."""
