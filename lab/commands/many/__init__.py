"""Commands that do many runs."""
