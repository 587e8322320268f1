"""Code in files that a scenario names: which of it may be executed, and who said so."""
