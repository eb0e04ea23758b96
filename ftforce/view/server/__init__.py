"""viser's server, for this machine alone; the page as a file or a picture."""
