"""Random schedules of failures, and what must hold whatever they are: ``formnet nemesis``."""
