"""A link's settings as they stand in a file, and how they change over time."""
