"""Loading of robots from a file or by name; the only package that calls Pinocchio."""
