"""Everything that people look at: tables, later plots and the 3D view."""
