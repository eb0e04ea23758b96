"""What is asked on the page, and the answer."""
