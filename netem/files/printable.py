"""Text from strangers made fit to be shown: what would act on a terminal, or hide, is escaped.

Of these general categories of Unicode nothing is shown as it is: control characters (Cc: C0, DEL,
C1), format characters (Cf: bidirectional overrides and isolates, zero-width ones, tags),
surrogates (Cs), and separators of lines and paragraphs (Zl, Zp). Letters, accents, spaces of any
width and emoji stay. A backslash stays too: an escape is there to be seen, not to be undone.
"""

import unicodedata

_ACTING = {"Cc", "Cf", "Cs", "Zl", "Zp"}
_LAYOUT = "\t\n"


def printable(text: str, *, lines: bool = False) -> str:
    r"""``text`` with each such character as Python writes it: ``\x1b``, ``\u202e``, ``\n``.

    With ``lines``, what is laid out over several keeps its line feeds and tabs.
    """
    if text.isprintable():
        return text
    return "".join(
        _escaped(letter)
        if unicodedata.category(letter) in _ACTING and not (lines and letter in _LAYOUT)
        else letter
        for letter in text
    )


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii")
