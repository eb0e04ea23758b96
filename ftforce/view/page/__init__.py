"""HTML and controls of the page."""
