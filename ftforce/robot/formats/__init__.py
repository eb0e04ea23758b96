"""Robot description formats, one module each; all yield a checked tree of links and joints."""
