"""Commands that ``formnet run`` starts: the processes of a run."""
