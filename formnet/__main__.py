"""``python -m formnet``: the program ``formnet``."""

from formnet.lab.program import main

main()
