"""The language that robots, plant and lab share: scenario, messages, bus, geometry.

Knows nothing of how a robot decides or how the plant moves.
"""
