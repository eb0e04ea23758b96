"""Safe reading of user-supplied files, and atomic writing."""
