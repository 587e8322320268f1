"""What a run reports while it goes on: rows, events and how it ended, and their form as bytes.

The plant emits records and the lab consumes them. Here nothing is known of either.
"""
