"""Other machines: where robots run, and the keys by which they are known."""
