"""The world: the dynamics of all robots, and the owner of virtual time.

Knows true parameters and no control law: states out, commands in.
"""
