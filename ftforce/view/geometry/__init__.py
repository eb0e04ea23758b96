"""What an arm looks like: its visuals, solids and meshes, within bounds."""
