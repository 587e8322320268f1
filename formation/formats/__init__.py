"""The formats that scenarios have had, and the way from each to the next."""
