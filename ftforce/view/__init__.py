"""The robot in the browser: a scene, controls, the answer, and what can be taken along."""

NEEDS_EXTRA = "the page needs the extra `view`: pip install 'ftforce[view]'"
