"""The commands of ``formnet``, one file each."""
