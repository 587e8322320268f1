"""Every claim of the paper as runs with a predicted end: ``formnet claims``."""
