"""Reading TOML: text to tables, or what is wrong with it and on which line."""

import re
import tomllib
from pathlib import Path
from typing import Any

from formnet.netem.files.problems import shown
from formnet.netem.files.toml_clash import clash


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file (UTF-8, with or without a byte order mark).

    Raises:
        ValueError: it cannot be read, or is no TOML; the text says which, and on which line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"not TOML: not UTF-8 text (byte {error.start})") from None
    return parse_toml(text)


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text; a byte order mark before it is left out.

    Raises:
        ValueError: it is no TOML; the text says why, and on which line.
    """
    text = text.removeprefix("\ufeff")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not TOML: {_explained(text, error)}") from None
    except RecursionError:
        raise ValueError("not TOML: lists or tables are nested too deeply") from None
    except ValueError as error:  # a whole number of more digits than Python converts
        raise ValueError(f"not TOML: {error}") from None


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
