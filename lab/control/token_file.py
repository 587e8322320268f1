"""The file that holds the token while the endpoint is there, for scripts of its user alone."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from formnet.lab.runs import files


@contextmanager
def token_file(token: str, path: Path | None) -> Iterator[Path]:
    """A new file, mode 0600, with the token and a line end; it is gone in the end.

    Without a ``path``, in a new folder, mode 0700, among the temporary files.

    Raises:
        OSError: it cannot be written, or (FileExistsError) is there already.
    """
    if path is not None:
        files.write_new(path, f"{token}\n", 0o600)
        try:
            yield path
        finally:
            path.unlink(missing_ok=True)
        return
    with tempfile.TemporaryDirectory(prefix="formnet-control-") as folder:
        own = Path(folder) / "token"
        files.write_new(own, f"{token}\n", 0o600)
        yield own
