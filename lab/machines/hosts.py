"""Hosts on which robots run, over SSH: what runs there as if it ran here.

An agent on another host is a :class:`RemoteChild` with the face of ``subprocess.Popen``; its
standard input is its leash here too, for SSH closes it when this process ends. asyncssh has a
thread of its own.
"""

import asyncio
import re
import shlex
import signal
import threading
import warnings
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

import asyncssh

from formnet.formation.machines.hosts import Host
from formnet.lab.launch.interpreter import SAFE

# asyncssh leaves a coroutine behind when a connection is cut off; nobody needs to know.
warnings.filterwarnings("ignore", "coroutine 'Queue.join' was never awaited", RuntimeWarning)

CONNECT_S = 10.0
"""How long a host may take to let one in."""
KEEPALIVE_S, KEEPALIVES = 1, 3
"""A host that answers none of so many questions in a row is gone."""

Result = TypeVar("Result")


class HostLost(RuntimeError):
    """A host cannot be reached; the text says which one and why."""


class Fleet:
    """Connections to hosts; use as a context manager."""

    def __init__(self, lost: Callable[[Host, str], None] = lambda _host, _why: None) -> None:
        self._lost = lost
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._connections: dict[str, asyncssh.SSHClientConnection] = {}
        self._closing = False

    def __enter__(self) -> "Fleet":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _close(self) -> None:
        for connection in self._connections.values():
            connection.abort()
        others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        if others:
            await asyncio.wait(others, timeout=1.0)
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    def start(self, host: Host, arguments: list[str], log: Callable[[str], None]) -> "RemoteChild":
        """Start ``formnet ARGUMENTS`` on ``host``; ``log`` gets its output, line by line.

        Raises:
            HostLost: the host cannot be reached.
        """
        command = shlex.join([host.python, SAFE, "-m", "formnet", *arguments])
        process = self._wait(host, self._start(host, f"echo $$; exec {command}"))
        child = RemoteChild(self, host, process)
        asyncio.run_coroutine_threadsafe(child.follow(log), self._loop)
        return child

    def run(self, host: Host, command: str, seconds: float = CONNECT_S) -> tuple[int, str]:
        """Run ``command`` on ``host``; its exit code and what it said.

        Raises:
            HostLost: the host cannot be reached, or takes longer.
        """

        async def go() -> tuple[int, str]:
            connection = await self._connect(host)
            done = await asyncio.wait_for(connection.run(command), seconds)
            said = f"{done.stdout or ''!s}{done.stderr or ''!s}"
            return done.returncode or 0, said.strip()

        return self._wait(host, go())

    def post(self, work: Coroutine[Any, Any, Any]) -> None:
        """Have ``work`` done, some time."""
        asyncio.run_coroutine_threadsafe(work, self._loop)

    def call(self, work: Callable[[], object]) -> None:
        """Have ``work`` done on the thread of all connections."""
        self._loop.call_soon_threadsafe(work)

    def _wait(self, host: Host, work: Coroutine[Any, Any, Result]) -> Result:
        try:
            return asyncio.run_coroutine_threadsafe(work, self._loop).result()
        except (OSError, asyncssh.Error, TimeoutError) as error:
            why = str(error) or type(error).__name__
            raise HostLost(f"host {host.name} ({host.ssh}): {why}") from None

    async def _start(self, host: Host, command: str) -> "asyncssh.SSHClientProcess[str]":
        connection = await self._connect(host)
        return await connection.create_process(command, stderr=asyncssh.STDOUT)

    async def _connect(self, host: Host) -> asyncssh.SSHClientConnection:
        known = self._connections.get(host.name)
        if known is not None and not known.is_closed():
            return known
        user, address, port = host.target
        options: dict[str, Any] = {"username": user} if user else {}
        if port:
            options["port"] = port
        connection = await asyncio.wait_for(
            asyncssh.connect(
                address, keepalive_interval=KEEPALIVE_S, keepalive_count_max=KEEPALIVES, **options
            ),
            CONNECT_S,
        )
        self._connections[host.name] = connection
        asyncio.get_running_loop().create_task(self._watch(host, connection))
        return connection

    async def _watch(self, host: Host, connection: asyncssh.SSHClientConnection) -> None:
        await connection.wait_closed()
        if not self._closing:
            self._lost(host, "its connection has ended")


class RemoteChild:
    """A process on another host, as far as a launcher needs ``subprocess.Popen``."""

    def __init__(self, fleet: Fleet, host: Host, process: "asyncssh.SSHClientProcess[str]") -> None:
        self._fleet, self._host, self._process = fleet, host, process
        self._pid: int | None = None
        self._ended = threading.Event()
        self.returncode: int | None = None

    async def follow(self, log: Callable[[str], None]) -> None:
        """Pass its output on to its end. The first line is its process's id."""
        try:
            async for line in self._process.stdout:
                if self._pid is None and re.fullmatch(r"[0-9]{1,9}\s*", line):
                    self._pid = int(line)
                else:
                    log(line)
            await self._process.wait()
        except asyncssh.Error as error:
            log(f"{error}\n")
        if not self._process.channel.is_closing() or self._process.exit_status is not None:
            self._end(self._process.exit_status)
        # else the connection is lost, and nobody knows what became of it

    def _end(self, status: int | None) -> None:
        ended_by = self._process.exit_signal
        if ended_by is not None:
            number = getattr(signal, f"SIG{ended_by[0]}", signal.SIGKILL)
            self.returncode = -int(number)
        else:
            self.returncode = status
        self._ended.set()

    def poll(self) -> int | None:
        """Its exit code; None while it runs, or may."""
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code, once it has ended. Raises TimeoutError."""
        if not self._ended.wait(timeout):
            raise TimeoutError
        assert self.returncode is not None
        return self.returncode

    def release(self) -> None:
        """Close its standard input, at whose end it ends."""
        self._fleet.call(self._process.stdin.write_eof)

    def send_signal(self, number: int) -> None:
        """Send it a signal (SSH itself knows too few)."""
        if self.returncode is None and self._pid is not None:
            self._fleet.post(self._kill(number))

    def kill(self) -> None:
        """Kill it; whatever becomes of it then, it is over for the launcher."""
        self.send_signal(signal.SIGKILL)
        if self.returncode is None:
            self.returncode = -signal.SIGKILL
        self._ended.set()

    async def _kill(self, number: int) -> None:
        connection = await self._fleet._connect(self._host)
        await connection.run(f"kill -{int(number)} {self._pid}")
