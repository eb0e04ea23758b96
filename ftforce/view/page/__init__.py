"""The HTML of the page, and its controls."""
