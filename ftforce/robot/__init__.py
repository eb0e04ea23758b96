"""From a file or a name to a `Robot`; the only package that calls Pinocchio."""
