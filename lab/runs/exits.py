"""Exit codes of every command, and which one an error of the system stands for."""

import errno

ALL_HOLD, ONE_FAILS, BAD_INPUT, BROKEN, INTERRUPTED = 0, 1, 2, 3, 130
"""1 is about claims alone: about what was run, never about where it was run."""


class Stop(BaseException):
    """A signal to end, raised where nobody asks for it; code that catches errors lets it pass."""


_OUT_OF = {
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EIO,
    errno.ENOMEM,
    errno.EMFILE,
    errno.ENFILE,
}
"""What a machine may run out of, or break, on the way."""


def of(error: OSError) -> int:
    """BROKEN if the machine failed, BAD_INPUT if the place that was named cannot be used."""
    return BROKEN if error.errno in _OUT_OF else BAD_INPUT


def in_words(error: OSError) -> str:
    """The file, if one is known, and the reason."""
    reason = error.strerror or str(error)
    return reason if error.filename is None else f"{error.filename}: {reason}"
