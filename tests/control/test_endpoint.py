"""The control endpoint under raw sockets: heads and bodies that are wrong, slow, or never end."""

import os
import socket
import stat
import threading
from contextlib import ExitStack, closing

import pytest
from processes import until

from formnet.lab.control import server
from formnet.lab.control.endpoint import Asked, opened

TIMEOUT_S = 20.0


def connected(control):
    made = socket.create_connection(("127.0.0.1", control.port), TIMEOUT_S)
    made.settimeout(TIMEOUT_S)
    return made


def said(connection):
    """All that comes until the other end closes."""
    parts = []
    try:
        while part := connection.recv(65536):
            parts.append(part)
    except ConnectionResetError:
        pass
    return b"".join(parts)


def asked(control, data):
    with closing(connected(control)) as connection:
        connection.sendall(data)
        return said(connection)


def head(control, line="GET /network", *fields):
    mine = (
        f"{line} HTTP/1.1",
        f"Host: 127.0.0.1:{control.port}",
        f"Authorization: Bearer {control.token}",
        "Content-Type: application/json",
        "Connection: close",
        *fields,
    )
    return "\r\n".join((*mine, "", "")).encode()


def served(control):
    return asked(control, head(control)).startswith(b"HTTP/1.1 200 ")


CHUNKS = b"2\r\n{}\r\n0\r\n\r\n"
WRONG = {
    "a superscript": (("Content-Length: ²",), b"{}"),
    "negative": (("Content-Length: -1",), b"{}"),
    "signed": (("Content-Length: +2",), b"{}"),
    "not decimal": (("Content-Length: 0x2",), b"{}"),
    "empty": (("Content-Length:",), b"{}"),
    "a number without end": ((f"Content-Length: {'9' * 5000}",), b"{}"),
    "missing": ((), b""),
    "chunks": (("Transfer-Encoding: chunked",), CHUNKS),
    "chunks and a length": (("Transfer-Encoding: chunked", "Content-Length: 2"), CHUNKS),
    "an unknown encoding": (("Transfer-Encoding: gzip", "Content-Length: 2"), b"{}"),
    "two lengths": (("Content-Length: 2", "Content-Length: 3"), b"{}"),
    "two hosts": (("Content-Length: 2", "Host: rebound.test"), b"{}"),
    "two tokens": (("Content-Length: 2", "Authorization: Bearer x"), b"{}"),
    "a line that is no field": (("Content-Length: 2", "nothing"), b"{}"),
}


@pytest.mark.parametrize(("fields", "body"), WRONG.values(), ids=WRONG)
def test_a_head_that_is_wrong_is_a_4xx_and_changes_nothing(control, capfd, fields, body):
    answer = asked(control, head(control, "POST /cut", *fields) + body)
    assert answer.startswith(b"HTTP/1.1 4"), answer
    assert control.links.cut == []
    assert served(control)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    "data",
    [b"\0\1\2\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"\x16\x03\x01\x02\x00\r\n\r\n"],
)
def test_what_is_no_request_is_a_400(control, capfd, data):
    assert asked(control, data).startswith(b"HTTP/1.1 400 ")
    assert served(control)
    assert capfd.readouterr().err == ""


def test_a_head_without_end_is_cut_off(control):
    with closing(connected(control)) as connection:
        # 16 MB, far beyond what lies in buffers
        with pytest.raises((BrokenPipeError, ConnectionResetError)):
            connection.sendall((b"X: " + b"x" * 16_000 + b"\r\n") * 1000)
        assert not said(connection).startswith(b"HTTP/1.1 200")
    assert served(control)


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "HEAD", "PATCH", "CONNECT"])
def test_other_methods_are_refused(control, method):
    assert asked(control, head(control, f"{method} /cut")).startswith(b"HTTP/1.1 405 ")


@pytest.fixture
def hurried(monkeypatch):
    """Patience of a fraction of a second, for endpoints that are made after it."""
    monkeypatch.setattr(server, "HEAD_S", 0.3)
    monkeypatch.setattr(server, "BODY_S", 0.3)


@pytest.mark.parametrize("sent", ["nothing", "half a head", "half a body"])
@pytest.mark.parametrize("trickle", [False, True])
def test_who_does_not_go_on_is_cut_off_and_who_sends_byte_by_byte_too(
    hurried, control, sent, trickle
):
    data = {
        "nothing": b"",
        "half a head": b"GET /network HTTP/1.1\r\nX: ",
        "half a body": head(control, "POST /cut", "Content-Length: 1000"),
    }[sent]
    with closing(connected(control)) as connection:
        connection.sendall(data)
        ended = threading.Event()
        if trickle:
            threading.Thread(target=trickled, args=(connection, ended), daemon=True).start()
        assert said(connection) == b""  # it ends: else this waits for TIMEOUT_S, and fails
        ended.set()
    assert control.links.cut == []


def trickled(connection, ended):
    try:
        while not ended.wait(0.05):
            connection.sendall(b"x")
    except OSError:
        pass


def test_a_connection_that_was_used_and_is_idle_ends(hurried, control):
    with closing(connected(control)) as connection:
        connection.sendall(head(control).replace(b"close", b"keep-alive"))
        assert said(connection).startswith(b"HTTP/1.1 200 ")


@pytest.mark.long
@pytest.mark.parametrize("sent", [b"", b"POST /cut HTTP/1.1\r\nContent-Length: 9\r\nX"])
def test_a_thousand_idle_connections_keep_nobody_out(control, sent):
    threads, before = threading.active_count(), len(os.listdir("/proc/self/fd"))
    with ExitStack() as stack:
        for _ in range(1000):
            idle = stack.enter_context(closing(connected(control)))
            idle.sendall(sent)
        assert served(control)
        assert threading.active_count() == threads
        ours = 1000
        until(
            lambda: len(os.listdir("/proc/self/fd")) - before - ours <= server.MOST_CONNECTIONS,
            "the end of the oldest connections",
        )


def test_the_token_lies_in_a_new_file_of_its_user_s_and_goes_with_the_endpoint(tmp_path):
    place = tmp_path / "token"
    with opened(Asked("127.0.0.1:0", place)) as endpoint:
        assert place.read_text() == f"{endpoint.gate.token}\n"
        assert stat.S_IMODE(place.stat().st_mode) == 0o600
        with pytest.raises(FileExistsError), opened(Asked("127.0.0.1:0", place)):
            pass
        assert place.read_text() == f"{endpoint.gate.token}\n"
    assert not place.exists()
    with opened(Asked("127.0.0.1:0")) as endpoint:
        assert stat.S_IMODE(endpoint.token.parent.stat().st_mode) == 0o700
        assert stat.S_IMODE(endpoint.token.stat().st_mode) == 0o600
    assert not endpoint.token.parent.exists()


@pytest.mark.parametrize("target", ["precious.txt", "nothing there"])
def test_no_token_is_written_through_a_link(tmp_path, target):
    (tmp_path / "precious.txt").write_text("precious")
    (tmp_path / "token").symlink_to(target)
    with pytest.raises(FileExistsError), opened(Asked("127.0.0.1:0", tmp_path / "token")):
        pass
    assert (tmp_path / "precious.txt").read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["precious.txt", "token"]


def test_localhost_is_had_in_every_family_that_there_is():
    with opened(Asked("localhost:0")) as endpoint:
        names = [one.getsockname() for one in endpoint.sockets]
        assert len({name[1] for name in names}) == 1
        assert {name[0] for name in names} <= {"127.0.0.1", "::1"}
