"""Formation control over imperfect networks: run it, break it, get a verdict."""
