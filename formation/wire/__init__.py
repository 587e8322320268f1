"""What robots and plant say to each other, and over what."""
