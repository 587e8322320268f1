"""The console of every command: strangers' text on it is text, whatever characters it has."""

from collections.abc import Iterable
from typing import IO, Any

import rich.console
import rich.markup
from rich.segment import Segment
from rich.text import Text

from formnet.lab.text.streams import styled
from formnet.netem.files.printable import printable


def escape(text: str, *, lines: bool = False) -> str:
    """Markup for a stranger's ``text``, in one line; with ``lines``, in as many as it has.

    A line feed in the name of a file or a key would make a line that formnet seems to have said.
    """
    return rich.markup.escape(printable(text, lines=lines))


class Console(rich.console.Console):
    """Rich's, on which nothing acts but its own styles: no control characters, no emoji codes."""

    def __init__(self, **options: Any) -> None:
        super().__init__(emoji=False, **options)

    @property
    def file(self) -> IO[str]:
        """Where it writes to: past what escapes all that is printed otherwise."""
        return styled(super().file)

    @file.setter
    def file(self, new_file: IO[str]) -> None:
        self._file = new_file

    def render_str(self, text: str, **options: Any) -> Text:
        """Markup as text, escaped before it is measured."""
        return super().render_str(printable(text, lines=True), **options)

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """What is printed in the end, also of text that was no markup."""
        for segment in super().render(*arguments, **options):
            if segment.control:
                yield segment
            else:
                yield Segment(printable(segment.text, lines=True), segment.style)
