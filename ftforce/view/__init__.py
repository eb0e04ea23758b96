"""The interactive browser view: 3D scene, controls, results, and export to files."""

from ftforce.errors import FtforceError

NEEDS_EXTRA = "the browser view requires the extra 'view' (pip install 'ftforce[view]')"

try:
    import markupsafe as _markupsafe  # noqa: F401 (many modules need it: say so once)
except ImportError:
    raise FtforceError(NEEDS_EXTRA) from None
