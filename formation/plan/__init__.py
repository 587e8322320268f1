"""What is planned to happen in a run: to links, and to robots."""
