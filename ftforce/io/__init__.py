"""Files that users hand over, read safely."""
