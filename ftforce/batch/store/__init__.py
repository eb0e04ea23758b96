"""The folder of a sweep: one writer, what its arrays mean, restart."""
