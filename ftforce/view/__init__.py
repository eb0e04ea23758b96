"""The interactive browser view: 3D scene, controls, results, and export to files."""

NEEDS_EXTRA = "the page needs the extra `view`: pip install 'ftforce[view]'"
