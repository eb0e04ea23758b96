"""One module per format; all end in one checked tree of links and joints."""
