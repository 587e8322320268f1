"""Commands that show a run in a viewer, while it goes on or afterwards."""
