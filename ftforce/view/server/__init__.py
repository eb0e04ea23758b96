"""A local viser server, and export of the page as HTML or PNG."""
