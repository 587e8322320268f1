"""One robot: its control law and the process around it.

A robot knows its own state and what its links have delivered, nothing else.
"""
