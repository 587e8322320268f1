"""Pages: of one run, and of all in a folder."""
