"""Whether claims hold: errors, V, the verdict."""
