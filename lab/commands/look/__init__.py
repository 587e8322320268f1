"""Commands that look back at recorded runs."""
