"""The mathematics, on arrays only, for use with any robotics library."""
