"""The control endpoint of a bridge: who may use it, the HTTP server, and its own page."""
