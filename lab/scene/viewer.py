"""Rerun's viewer as a process of its own: a window, or a page on loopback."""

import shutil
import socket
import subprocess
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import quote

from formnet.formation.wire.bus import LOOPBACK
from formnet.lab.launch.launch import free_port

_START_S = 20.0
_LOOK_S = 0.05


class ViewerFailed(RuntimeError):
    """The viewer does not start; the text says why, and what to do."""


class Viewer:
    """A viewer that waits for data at ``url`` (gRPC), or shows ``files``.

    ``page`` is the address to open in a browser, None for a window.

    Raises:
        ViewerFailed: it ended at once, or is not there within 20 s.
    """

    def __init__(self, *, web: bool, files: tuple[Path, ...] = ()) -> None:
        port, web_port = free_port(), free_port()
        self.url = f"rerun+http://{LOOPBACK}:{port}/proxy"
        self.page: str | None = None
        options = ["--bind", LOOPBACK, "--port", str(port), "--hide-welcome-screen"]
        if web:
            options += ["--serve-web", "--web-viewer-port", str(web_port)]
            self.page = f"http://{LOOPBACK}:{web_port}/?url={quote(self.url, safe='')}"
        self.process = subprocess.Popen(
            [binary(), *options, *map(str, files)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,  # a window stays when the run is over
        )
        try:
            for awaited in [port, web_port] if web else [port]:
                self._wait_for(awaited)
        except ViewerFailed:
            self.close()
            raise

    def close(self) -> None:
        """End it."""
        self.process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(2.0)
        self.process.kill()
        self.process.wait()

    def _wait_for(self, port: int) -> None:
        deadline = time.monotonic() + _START_S
        while self.process.poll() is None and time.monotonic() < deadline:
            with suppress(OSError), socket.create_connection((LOOPBACK, port), 1.0):
                return
            time.sleep(_LOOK_S)
        if self.process.poll() is None:
            raise ViewerFailed(f"the Rerun viewer did not start within {_START_S:g} s")
        assert self.process.stderr is not None
        said = self.process.stderr.read().decode(errors="replace").strip().splitlines()
        reason = said[-1] if said else f"exit code {self.process.returncode}"
        if "DISPLAY" in reason:
            raise ViewerFailed("the Rerun viewer does not open: there is no display; use --web")
        raise ViewerFailed(f"the Rerun viewer does not open: {reason}")


def binary() -> str:
    """The viewer's program, from the package rerun-sdk.

    Raises:
        ViewerFailed: it is not installed.
    """
    package = find_spec("rerun_cli")
    if package is not None and package.origin is not None:
        found = Path(package.origin).with_name("rerun")
        if found.exists():
            return str(found)
    other = shutil.which("rerun")
    if other is None:
        raise ViewerFailed("the Rerun viewer is not installed: pip install rerun-sdk")
    return other
