"""Commands about networks and machines."""
