"""Everything around a run: launching, recording, verdict, figures, command line."""
