"""The scenario: its format, its rules, how it is read."""
