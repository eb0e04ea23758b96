"""What is drawn: links, arrows, sets of forces."""
