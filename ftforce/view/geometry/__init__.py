"""Visual geometry of an arm: URDF visuals, primitive shapes and meshes, within size limits."""
