"""Links between two Zenoh networks."""
