"""The commands of ``formnet``, one file each, in folders by the sections of its help.

Each module has its command as ``command``. Only :mod:`lab.cli` imports them, each when it is
asked for.
"""
