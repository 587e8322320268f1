"""What the larger commands do; ``lab/commands`` declares them and imports this when called."""
