"""``python -m formnet``: the program ``formnet``."""

import sys

if not sys.flags.safe_path:
    del sys.path[0]  # the working directory, which may be anybody's

from formnet.lab.program import main

main()
