"""A run as a scene for Rerun, and for Foxglove."""
