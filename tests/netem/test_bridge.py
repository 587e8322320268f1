"""The bridge: which link a message takes, what arrives, and two plain Zenoh programs across it."""

import json
import math
import signal
import subprocess
import sys
import threading
import time
import tomllib
import urllib.error
import urllib.request
from contextlib import ExitStack, contextmanager
from functools import partial

import numpy as np
import pytest
import zenoh
from click.testing import CliRunner
from processes import until
from scipy import stats

from formnet.lab.cli import main
from formnet.lab.control.endpoint import Asked, opened
from formnet.lab.launch.launch import free_port
from formnet.netem import LOST_CUT
from formnet.netem.bridge.bridge import Bridge, BridgeError, session
from formnet.netem.bridge.control import answer
from formnet.netem.bridge.lanes import (
    ChangeRequest,
    CutRequest,
    HealRequest,
    LaneFile,
    Lanes,
    NetworkFileError,
    load,
)
from formnet.netem.settings.links import SettingError

MS = 1_000_000
ALPHA = 0.001
TIMEOUT_S = 20.0


def lanes(**network):
    return Lanes(LaneFile.model_validate({"network": network}))


# --- which link a message takes -------------------------------------------------------------

RULES = [
    {"key": "robot/**", "delay": {"distribution": "constant", "mean_s": 0.1}},
    {"key": "robot/*/camera", "direction": "forward", "rate": {"bits_per_s": 1000}},
]


@pytest.mark.parametrize(
    ("direction", "key", "name", "delay_s", "bits_per_s"),
    [
        ("forward", "base/state", "default", 0.0, 0),
        ("forward", "robot/1/pose", "robot/**", 0.1, 0),
        ("forward", "robot/1/camera", "robot/*/camera", 0.0, 1000),
        ("backward", "robot/1/camera", "robot/**", 0.1, 0),
    ],
)
def test_the_last_matching_entry_is_the_link(direction, key, name, delay_s, bits_per_s):
    lane = lanes(links=RULES).of(direction, key)
    assert (lane.direction, lane.name) == (direction, name)
    settings = lane.timeline.settings
    assert (settings.delay.mean_s, settings.rate.bits_per_s) == (delay_s, bits_per_s)


def test_keys_of_the_same_entry_share_a_link_and_others_do_not():
    made = lanes(links=RULES)
    assert made.of("forward", "robot/1/pose") is made.of("forward", "robot/2/pose")
    assert made.of("forward", "robot/1/pose") is not made.of("backward", "robot/1/pose")
    assert made.of("forward", "robot/1/pose") is not made.of("forward", "robot/1/camera")


def test_a_new_key_changes_no_draw_of_the_others():
    lossy = {"loss": {"probability": 0.5}, "delay": {"distribution": "exponential", "mean_s": 0.1}}

    def met(keys):
        made, found = lanes(default=lossy), []
        for k, key in enumerate(keys):
            (copy,) = made.of("forward", key).link.send(k * MS, k, b"", kind=key)
            if key == "a":
                found.append((copy.fate, copy.due_ns - copy.sent_ns))
        return found

    assert met(["a", "b", "b", "c"] * 50) == met(["a"] * 50)


def test_requests_reach_the_links_they_name_and_no_others():
    made = lanes(links=RULES)
    pose, camera = (made.of("forward", f"robot/1/{what}") for what in ("pose", "camera"))
    slow = {"link": "robot/**", "direction": "forward", "delay": {"mean_s": 0.5}}
    assert made.do(ChangeRequest.model_validate(slow), 5) == [pose]
    assert pose.timeline.settings.delay.mean_s == 0.5
    assert camera.timeline.settings.delay.mean_s == 0.0
    assert made.of("backward", "robot/1/pose").timeline.settings.delay.mean_s == 0.1
    (cut,) = made.do(CutRequest(link="default", direction="backward"), 6)
    assert cut.link.send(7, 0, b"")[0].fate == LOST_CUT
    assert set(made.do(HealRequest(), 8)) == set(made)
    assert not cut.link.send(9, 1, b"")[0].lost


def test_a_link_named_by_a_star_is_not_all_links():
    made = lanes(links=[{"key": "*"}])
    assert {lane.name for lane in made.do(CutRequest(link="*"), 0)} == {"*"}
    assert {lane.name for lane in made.do(HealRequest(), 0)} == {"*", "default"}


def test_keys_beyond_the_first_many_share_their_streams(monkeypatch):
    monkeypatch.setattr("formnet.netem.bridge.lanes._MOST_STREAMS", 2)
    lane = lanes().of("forward", "a")
    assert [lane.kind_of(key) for key in ("a", "b", "c", "a", "d")] == ["a", "b", "", "a", ""]


def test_a_request_that_one_link_does_not_admit_changes_none():
    made = lanes(
        links=[{"key": "a", "delay": {"distribution": "uniform", "low_s": 0, "high_s": 1}}]
    )
    before = made.described()
    with pytest.raises(SettingError, match=r"delay\.mean_s = 0\.5: unknown key"):
        made.do(ChangeRequest.model_validate({"delay": {"mean_s": 0.5}}), 0)
    with pytest.raises(LookupError, match=r"no link 'b' \(links: a, default\)"):
        made.do(CutRequest(link="b"), 0)
    assert made.described() == before


def test_the_documented_file_is_the_one_that_comes_along(root):
    documented = (root / "docs" / "bridge.md").read_text(encoding="utf-8")
    text = documented.split("```toml\n")[1].split("```")[0]
    assert LaneFile.model_validate(tomllib.loads(text)) == load(root / "configs/network/wifi.toml")


BAD_FILES = {
    "no TOML": ("[network", "not TOML"),
    "unknown key": (
        "[network.default]\ndelya = 1",
        "network.default.delya = 1: unknown key; did you mean 'delay'",
    ),
    "bad value": (
        "[network.default]\nloss.probability = 2.0",
        "network.default.loss.probability = 2.0: must be at most 1",
    ),
    "no key": ("[[network.links]]\nplayout_s = 1.0", r"network.links\[0\].key: is required"),
    "bad key": (
        '[[network.links]]\nkey = "a//b"',
        r"network.links\[0\].key = 'a//b': 'a//b' is not a key expression",
    ),
    "name of the default": (
        '[[network.links]]\nkey = "default"',
        r"key = 'default': 'default' is the name of the link of all other",
    ),
    "not text": (b"\xff\xfe", "not TOML: not UTF-8 text \\(byte 0\\)"),
    "bad direction": (
        '[[network.links]]\nkey = "a"\ndirection = "up"',
        "direction = 'up': must be 'forward', 'backward' or 'both'",
    ),
    "part of another kind": (
        '[[network.links]]\nkey = "a"\ndelay.low_s = 0.1',
        r"network.links\[0\].delay.low_s = 0.1: unknown key",
    ),
    "missing file": (
        '[network.default.delay]\ndistribution = "empirical"\nfile = "gone.csv"',
        "gone.csv cannot be read",
    ),
}


@pytest.mark.parametrize(("text", "words"), BAD_FILES.values(), ids=BAD_FILES)
def test_bad_network_file_is_named_and_exits_2(tmp_path, text, words):
    path = tmp_path / "network.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(NetworkFileError, match=words):
        load(path)
    found = bridge_command("--network", str(path))
    assert found.exit_code == 2
    assert "Traceback" not in found.output


def bridge_command(*options):
    ends = ("--from", "tcp/127.0.0.1:1", "--to", "tcp/127.0.0.1:1")
    return CliRunner().invoke(main, ["netem-bridge", *ends, *options])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--control", "8765"], "--control 8765: must be HOST:PORT"),
        (["--control", "localhost:99999"], "must be HOST:PORT"),
        (["--control", "localhost:²"], "must be HOST:PORT"),
        (["--control", f"localhost:{'9' * 5000}"], "must be HOST:PORT"),
        (["--control", "0.0.0.0:0"], "0.0.0.0 is off loopback"),
        (["--control", "[::]:0"], ":: is off loopback"),
        (["--control-anywhere"], "need --control"),
        (["--control", "127.0.0.1:0", "--control-token", "."], "is a directory"),
        (["--control", "127.0.0.1:0", "--control-token", "/etc/hostname"], "File exists"),
        (["--key", "a//b"], "'a//b' is not a key expression"),
    ],
)
def test_bad_options_are_named_and_exit_2(tmp_path, options, words):
    path = tmp_path / "network.toml"
    path.write_text("", encoding="utf-8")
    found = bridge_command("--network", str(path), *options)
    assert found.exit_code == 2
    assert words in found.output


@pytest.mark.processes
def test_an_endpoint_that_cannot_be_had_is_named():
    with (
        pytest.raises(BridgeError, match=r"cannot listen on tcp/256\.0\.0\.1:1"),
        session("listen:tcp/256.0.0.1:1"),
    ):
        pass


@pytest.mark.processes
def test_a_network_cannot_be_joined_with_itself():
    end = f"tcp/127.0.0.1:{free_port()}"
    with (
        session(f"listen:{end}"),
        session(end) as one,
        session(end) as other,
        pytest.raises(BridgeError, match="both ends lead to the same network"),
    ):
        Bridge(one, other, "**", LaneFile())


# --- what arrives: applications and bridge in one process --------------------------------------


class Ends:
    """Two applications with a bridge between them, and what each of them received."""

    def __init__(self, stack, tmp_path, text):
        path = tmp_path / "network.toml"
        path.write_text(text, encoding="utf-8")
        here, there = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
        joined = [stack.enter_context(session(f"listen:{end}")) for end in (here, there)]
        self.bridge = Bridge(*joined, "robot/**", load(path))
        stack.callback(self.bridge.close, drain=False)
        self.left, self.right = (stack.enter_context(application(end)) for end in (here, there))

    def subscribed(self, app, publisher, key):
        """A list that fills with what ``app`` receives; the way is proven."""
        got = []
        app.declare_subscriber(key, got.append)

        def heard():
            publisher.put("robot/probe", b"")
            return any(str(sample.key_expr) == "robot/probe" for sample in got)

        until(heard, "a probe")
        return got


def application(endpoint):
    config = {
        "mode": "peer",
        "listen": {"endpoints": []},
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


@pytest.fixture
def join(tmp_path):
    with ExitStack() as stack:
        yield lambda text="": Ends(stack, tmp_path, text)


def about(got, key):
    return [sample for sample in got if str(sample.key_expr) == key]


@pytest.mark.processes
def test_publications_pass_both_ways_with_everything_they_carry(join):
    ends = join()
    for source, target in ((ends.left, ends.right), (ends.right, ends.left)):
        got = ends.subscribed(target, source, "**")
        source.put("other/topic", b"stays")
        source.put(
            "robot/a",
            b"\0\xff",
            encoding="image/png",
            attachment=b"note",
            priority=zenoh.Priority.DATA_HIGH,
            express=True,
        )
        source.delete("robot/a", attachment=b"gone")
        until(lambda got=got: len(about(got, "robot/a")) == 2, "two samples")
        put, deleted = about(got, "robot/a")
        assert (put.payload.to_bytes(), str(put.encoding)) == (b"\0\xff", "image/png")
        assert put.attachment.to_bytes() == b"note"
        assert (put.priority, put.express) == (zenoh.Priority.DATA_HIGH, True)
        assert put.kind == zenoh.SampleKind.PUT
        assert (deleted.kind, deleted.attachment.to_bytes()) == (zenoh.SampleKind.DELETE, b"gone")
        assert about(got, "other/topic") == []
    assert ends.bridge.failures == 0


@pytest.mark.processes
def test_queries_pass_with_their_replies(join):
    ends = join()

    def answer(query):
        asked = query.payload.to_bytes() if query.payload else b"-"
        if "bad" in str(query.selector):
            query.reply_err(b"no " + asked)
        else:
            query.reply("robot/x", b"1 " + asked, attachment=b"note")
            query.reply_del("robot/y")

    ends.right.declare_queryable("robot/*", answer)
    replies = []

    def answered():
        replies[:] = list(ends.left.get("robot/*", payload=b"?", timeout=TIMEOUT_S))
        return replies

    until(answered, "an answer")
    first, second = sorted((r.ok for r in replies), key=lambda sample: str(sample.key_expr))
    assert (first.payload.to_bytes(), first.attachment.to_bytes()) == (b"1 ?", b"note")
    assert (str(second.key_expr), second.kind) == ("robot/y", zenoh.SampleKind.DELETE)
    (bad,) = ends.left.get("robot/*?bad", payload=b"?", timeout=TIMEOUT_S)
    assert bad.err.payload.to_bytes() == b"no ?"


@pytest.mark.processes
def test_a_query_that_is_lost_ends_without_reply(join):
    ends = join(
        '[[network.links]]\nkey = "robot/**"\ndirection = "forward"\nloss.probability = 1.0'
    )
    asked = []
    ends.right.declare_queryable("robot/*", asked.append)
    forward = next(lane for lane in ends.bridge.statistics() if lane["link"] == "robot/**")
    assert forward["sent"] == 0
    start = time.monotonic()

    def lost():
        assert list(ends.left.get("robot/*", timeout=TIMEOUT_S)) == []
        return ends.bridge.statistics()[1]["lost"].get("random", 0) > 0

    until(lost, "a lost query")
    assert asked == []
    assert time.monotonic() - start < TIMEOUT_S  # it ended, not only its patience


@pytest.mark.processes
def test_a_reply_that_comes_after_the_end_is_counted_and_breaks_nothing(join):
    ends = join('[network.default.delay]\ndistribution = "constant"\nmean_s = 0.3')
    ends.right.declare_queryable("robot/x", lambda query: query.reply("robot/x", b"late"))
    replies = ends.left.get("robot/x", timeout=TIMEOUT_S)
    until(lambda: ends.bridge.statistics()[0]["in_flight"], "the query")
    ends.bridge.close()
    assert list(replies) == []
    until(lambda: ends.bridge.failures == 1, "the reply")


@contextmanager
def controlled(bridge, host="127.0.0.1"):
    address = f"[{host}]:0" if ":" in host else f"{host}:0"
    with ExitStack() as stack:
        endpoint = stack.enter_context(opened(Asked(address)))
        endpoint.serve(stack, partial(answer, bridge))
        url = endpoint.url.partition("/#")[0]
        headers = {
            "Authorization": f"Bearer {endpoint.token.read_text().strip()}",
            "Content-Type": "application/json",
        }

        def call(path, body=None):
            data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
            request = urllib.request.Request(url + path, data, headers)
            try:
                with urllib.request.urlopen(request, timeout=TIMEOUT_S) as got:
                    return got.status, json.load(got)
            except urllib.error.HTTPError as error:
                return error.code, json.load(error)

        yield call


@pytest.mark.processes
def test_control_shows_and_changes_links_in_use(join):
    ends = join("[network.default]\nrate.overhead_bytes = 7")
    got = ends.subscribed(ends.right, ends.left, "**")
    with controlled(ends.bridge) as call:
        status, shown = call("/network", {"direction": "forward", "delay": {"mean_s": 0.2}})
        assert (status, shown) == (200, {"done": [{"link": "default", "direction": "forward"}]})
        forward, backward = call("/network")[1]
        assert (forward["delay"]["mean_s"], backward["delay"]["mean_s"]) == (0.2, 0.0)
        assert forward["rate"]["overhead_bytes"] == 7
        start = time.monotonic()
        ends.left.put("robot/late", b"")
        until(lambda: about(got, "robot/late"), "the delayed message")
        assert time.monotonic() - start >= 0.2
        call("/cut", {"direction": "forward", "in_flight": "lost"})
        assert call("/network")[1][0]["cut"] is True
        ends.left.put("robot/cut", b"")
        until(lambda: call("/statistics")[1][0]["lost"].get("cut"), "a loss by the cut")
        call("/heal", {})
        assert call("/network")[1][0]["cut"] is False
        assert about(got, "robot/cut") == []


@pytest.mark.processes
def test_control_listens_on_ipv6_too(join):
    with controlled(join().bridge, "::1") as call:
        assert call("/network")[0] == 200


@pytest.mark.processes
@pytest.mark.parametrize(
    ("path", "body", "status", "words"),
    [
        ("/nothing", None, 404, "there is no /nothing; there are: GET /statistics"),
        ("/statistics", {}, 404, "there is no POST /statistics"),
        ("/network", {"delay": {"mean_s": -1.0}}, 400, "delay.mean_s = -1.0: must be at least 0"),
        ("/network", {"deley": {"mean_s": 1.0}}, 400, "unknown key; did you mean 'delay'"),
        ("/network", {"delay": {"low_s": 1.0}}, 400, "delay.low_s = 1.0: unknown key"),
        ("/network", {"link": "gone"}, 400, "there is no link 'gone' (links: default)"),
        ("/network", [], 400, "must be a table"),
        ("/network", b"{delay", 400, "not JSON"),
        ("/network", b"[" * 100_000, 400, "not JSON"),
        ("/network", b"\xff", 400, "not JSON"),
        ("/network", b" " * 1_000_001, 413, "at most 1000000 bytes"),
        ("/network", b" " * 20_000_000, 413, "at most 1000000 bytes"),  # more than any buffer holds
        ("/cut", {"in_flight": "gone"}, 400, "in_flight = 'gone': must be 'kept' or 'lost'"),
    ],
)
def test_bad_requests_are_refused_with_the_reason(join, path, body, status, words):
    with controlled(join().bridge) as call:
        code, content = call(path, body)
        assert code == status
        assert words in " ".join(content["problems"])


# --- two plain programs ---------------------------------------------------------------------


@contextmanager
def program(*command):
    process = subprocess.Popen(
        [sys.executable, "-m", *command],
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


NETWORK = """
seed = 8
[network.default]
delay = { distribution = "uniform", low_s = 0.04, high_s = 0.06 }
loss = { probability = 0.1 }
"""
COUNT = 1500


@pytest.mark.processes
def test_two_unmodified_programs_meet_exactly_the_network_that_was_asked_for(tmp_path):
    """Which messages are lost, and for how long each travels, follows from the seed alone."""
    path = tmp_path / "network.toml"
    path.write_text(NETWORK, encoding="utf-8")
    key = "robot/1/pose"
    link = Lanes(load(path)).of("forward", key).link
    copies = [link.send(0, k, b"", kind=key)[0] for k in range(COUNT + 1)]
    travel_ns = {k: copy.due_ns for k, copy in enumerate(copies) if not copy.lost}
    assert COUNT in travel_ns, "the seed should let the delete at the end through"
    here, there = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with ExitStack() as stack:
        publisher = stack.enter_context(
            program(
                "benchmarks.zenoh_ends",
                "publish",
                key,
                "--listen",
                here,
                "--count",
                str(COUNT),
                "--period",
                "0.002",
            )
        )
        subscriber = stack.enter_context(
            program(
                "benchmarks.zenoh_ends",
                "subscribe",
                "robot/**",
                "--listen",
                there,
                "--count",
                str(len(travel_ns)),
            )
        )
        bridge = stack.enter_context(
            program(
                "formnet",
                "netem-bridge",
                "--from",
                here,
                "--to",
                there,
                "--key",
                "robot/**",
                "--network",
                str(path),
            )
        )
        watchdog = threading.Timer(60.0, subscriber.kill)
        watchdog.start()
        assert subscriber.stdout.readline() == "ready\n"
        publisher.stdin.write("go\n")
        publisher.stdin.flush()
        received = json.loads(subscriber.stdout.read() or "null")
        watchdog.cancel()
        bridge.send_signal(signal.SIGINT)
        table, messages = bridge.communicate(timeout=TIMEOUT_S)
    assert bridge.returncode == 0, messages
    assert "→ default" in table
    assert received, "the messages did not all come"
    puts = {row["number"]: row for row in received if row["kind"] == "PUT"}
    assert set(puts) == set(travel_ns) - {COUNT}
    assert [row["kind"] for row in received].count("DELETE") == 1
    assert all(row["attachment"] == f"note {k}" for k, row in puts.items())
    assert {row["encoding"] for row in puts.values()} == {"text/plain;x"}
    assert stats.binomtest(COUNT - len(puts), COUNT, 0.1).pvalue > ALPHA
    late_ns = np.array(
        [row["arrived_ns"] - row["sent_ns"] - travel_ns[k] for k, row in puts.items()]
    )
    assert late_ns.min() >= 0, "a message came early"
    assert np.median(late_ns) < 10 * MS
    delays_ms = [(row["arrived_ns"] - row["sent_ns"]) / MS for row in puts.values()]
    for q in (0.25, 0.5, 0.75):  # uniform on 40 to 60 ms, and what Zenoh and the machine add
        error_ms = 20.0 * math.sqrt(q * (1 - q) / len(puts))
        surplus_ms = np.quantile(delays_ms, q) - (40.0 + 20.0 * q)
        assert -4 * error_ms < surplus_ms < 4 * error_ms + 2 * np.median(late_ns) / MS


@contextmanager
def bridge_program(tmp_path, text):
    """A bridge in a process of its own, and an application in each of the two networks."""
    path = tmp_path / "network.toml"
    path.write_text(text, encoding="utf-8")
    here, there = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with ExitStack() as stack:
        bridge = stack.enter_context(
            program(
                "formnet",
                "netem-bridge",
                "--from",
                f"listen:{here}",
                "--to",
                f"listen:{there}",
                "--network",
                str(path),
            )
        )
        assert "bridging" in bridge.stderr.readline()
        left, right = (stack.enter_context(application(end)) for end in (here, there))
        yield bridge, left, right


@pytest.mark.processes
def test_a_query_ends_with_its_last_reply(tmp_path):
    """Not when its patience does. Only a bridge in another process lets its query go too late."""
    with bridge_program(tmp_path, "") as (_, left, right):
        replies, deadline = [], time.monotonic() + TIMEOUT_S
        right.declare_queryable("a/x", lambda query: query.reply("a/x", b"1"))
        while not replies:  # until the way is open in both networks
            assert time.monotonic() < deadline
            replies = [reply.ok for reply in left.get("a/x", timeout=TIMEOUT_S)]
        start = time.monotonic()
        for _ in range(3):
            (reply,) = left.get("a/x", timeout=3 * TIMEOUT_S)
            assert reply.ok.payload.to_bytes() == b"1"
            assert list(left.get("a/nobody", timeout=3 * TIMEOUT_S)) == []
        assert time.monotonic() - start < TIMEOUT_S


@pytest.mark.processes
def test_an_interrupted_bridge_delivers_what_is_in_flight(tmp_path):
    delayed = "[network.default]\ndelay = { distribution = 'constant', mean_s = 1.0 }"
    with bridge_program(tmp_path, delayed) as (bridge, left, right):
        got = []
        right.declare_subscriber("a/**", got.append)
        publisher = left.declare_publisher("a/x")
        deadline = time.monotonic() + TIMEOUT_S
        while not got:  # the way is open in both networks
            assert time.monotonic() < deadline
            left.put("a/probe", b"")
            threading.Event().wait(0.1)
        sent = 50
        for k in range(sent):
            publisher.put(str(k).encode())
        threading.Event().wait(0.3)  # they reach the bridge, and are a second from leaving it
        bridge.send_signal(signal.SIGINT)
        _, messages = bridge.communicate(timeout=TIMEOUT_S)
        assert bridge.returncode == 0, messages
        assert "draining" in messages
        numbers = [
            int(sample.payload.to_bytes()) for sample in got if str(sample.key_expr) == "a/x"
        ]
        assert numbers == list(range(sent))
