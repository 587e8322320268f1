"""Commands about one run: do it, check it first, and what it can be made of."""
