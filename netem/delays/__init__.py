"""How long messages travel: distributions, and their correlation."""
