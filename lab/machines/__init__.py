"""Other machines: where robots run, keys, what is there."""
