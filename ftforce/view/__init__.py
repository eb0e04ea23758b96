"""The robot in the browser: a scene, controls, the answer, and what can be taken along."""
