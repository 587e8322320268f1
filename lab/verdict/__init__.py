"""The verdict on a run: its model, section by section, how each is computed, written and read."""
