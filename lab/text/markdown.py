"""Text from strangers in Markdown (GitHub Flavored Markdown 0.29)."""

import re

from formnet.netem.files.printable import printable

_PLAIN = re.compile(
    r"(?!.*\bwww\.)(?:[^\W_]|[ .,;()+=%/–−×→∞ψμ²-]|(?<=[^\W_])_(?=[^\W_])|:(?= |$))*"
)
"""What means nothing in Markdown: words, numbers, and ``_`` within a word."""


def as_cell(text: str) -> str:
    """``text`` as a cell of a table: as it is if it is plain, and else as code.

    In code there are no links, images, HTML, mentions or emoji. Only ``|`` ends a cell even there
    (section 4.10), and is escaped; backslashes before it are doubled, for they would escape each
    other and let it end the cell.
    """
    text = printable(text)
    if _PLAIN.fullmatch(text):
        return text
    longest = max(map(len, re.findall("`+", text)), default=0)
    fence = "`" * (longest + 1)
    space = " " if "`" in (text[0], text[-1]) else ""
    escaped = re.sub(r"(\\*)\|", lambda found: found[1] * 2 + r"\|", text)
    return f"{fence}{space}{escaped}{space}{fence}"
