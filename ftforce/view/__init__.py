"""The interactive browser view: 3D scene, controls, results, and export to files."""

NEEDS_EXTRA = "the browser view requires the extra 'view' (pip install 'ftforce[view]')"
