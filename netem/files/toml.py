"""Reading TOML: text to tables, or what is wrong with it and on which line."""

import re
import tomllib
from pathlib import Path
from typing import Any

from formnet.netem.files.bounds import MOST_BYTES, check_tables, check_text
from formnet.netem.files.problems import shown
from formnet.netem.files.regular import read
from formnet.netem.files.toml_clash import clash


def read_toml(path: Path, *, follow: bool = True) -> dict[str, Any]:
    """The tables of a TOML file (UTF-8, with or without a byte order mark).

    ``follow``: it may be a symbolic link, as one that the user named. Somebody else may have put
    it there: nothing of the text that it leads to is in an error.

    Raises:
        ValueError: it cannot be read, is no TOML, or holds more than
            :mod:`netem.files.bounds` allows; the text says which, and on which line.
    """
    text = text_of(path, follow=follow)
    try:
        return parse_toml(text)
    except ValueError:
        if not path.is_symlink():
            raise
    rule = "it is a symbolic link, and only of the file that it leads to it is shown why"
    raise ValueError(f"not TOML that can be read ({rule})")


def text_of(path: Path, *, follow: bool = True) -> str:
    """The text of a TOML file, line ends as they are; raises as :func:`read_toml`."""
    try:
        return read(path, MOST_BYTES, follow=follow).decode()
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"not TOML: not UTF-8 text (byte {error.start})") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text; a byte order mark before it is left out.

    Raises:
        ValueError: it is no TOML, or holds too much; the text says why, and on which line.
    """
    text = text.removeprefix("\ufeff")
    check_text(text)
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not TOML: {_explained(text, error)}") from None
    except RecursionError:
        raise ValueError("not TOML: lists or tables are nested too deeply") from None
    except ValueError as error:  # a whole number of more digits than Python converts
        raise ValueError(f"not TOML: {error}") from None
    check_tables(found)
    return found


def parse_value(text: str) -> Any:
    """The value that a TOML text is; a text that is no TOML value, such as a bare word, is itself.

    Raises:
        ValueError: it begins as a list, a table or a string, and is none.
    """
    try:
        found = parse_toml(f"value = {text}")
    except ValueError:
        if text.lstrip()[:1] in tuple("[{\"'"):
            raise
        return text.strip()
    return found["value"] if len(found) == 1 else text.strip()


def _explained(text: str, error: tomllib.TOMLDecodeError) -> str:
    """The error; where a key is given twice, its name and both lines, else the text of the line.

    The words of tomllib differ from version to version of Python: all that is taken from them is
    the line, which has an attribute of its own from Python 3.14 on.
    """
    lines = text.replace("\r\n", "\n").split("\n")
    number: int | None = getattr(error, "lineno", None)
    if number is None:
        found = re.search(r"\bline (\d+)", str(error))
        number = int(found[1]) if found else None
    twice = clash("\n".join(lines))
    if twice is not None and (number is None or twice.begin <= number <= twice.end):
        return str(twice)
    if number is None or not 1 <= number <= len(lines):
        return str(error)
    return f"{error}: {shown(lines[number - 1].strip())}"
