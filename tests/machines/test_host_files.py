"""Files of hosts, and ``[hosts]`` of a scenario: what is in them, and when it is used."""

import asyncio
import json
import re
from types import SimpleNamespace

import pytest
from in_process import formnet

from formnet.formation.machines.hosts import HostsError, load_hosts
from formnet.formation.records.events import HostLost, Lost
from formnet.formation.records.outcome import Outcome
from formnet.formation.scenario.loading import ScenarioError, load
from formnet.lab.machines import keys
from formnet.lab.machines.hosts import RemoteChild
from formnet.lab.machines.place import BadPlace, Where
from formnet.lab.machines.privacy import Private
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.watch.watcher import Watcher

# --- what is in them -------------------------------------------------------------------------


GOOD = 'listen = "tls/10.0.0.1:7447"\n[[hosts]]\nname = "a"\nssh = "x"\nrobots = [1]\nkeys = "k"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "listen: is required"),
        (GOOD.replace("tls/10.0.0.1:7447", "10.0.0.1"), "listen = "),
        (GOOD + 'passwords = "x"\n', "unknown key"),
        (GOOD.replace("[1]", "[]"), "hosts[0].robots"),
        (GOOD + GOOD.split("\n", 1)[1].replace('"a"', '"b"'), "robot 1 runs on a and on b"),
        ("= 3", "hosts.toml: not TOML: "),
    ],
)
def test_a_bad_file_of_hosts_is_said(tmp_path, text, words):
    file = tmp_path / "hosts.toml"
    file.write_text(text)
    with pytest.raises(HostsError) as found:
        load_hosts(file)
    assert words in str(found.value)


def test_the_hosts_of_a_scenario_are_checked_with_it(tmp_path):
    text = (CONFIGS / "yard.toml").read_text() + "\n[hosts]\n"
    file = tmp_path / "scenario.toml"
    file.write_text(text + GOOD.replace("[[hosts]]", "[[hosts.hosts]]").replace("[1]", "[1, 9]"))
    with pytest.raises(ScenarioError, match=r"hosts.a.robots = 9: robot 9 does not exist"):
        load(file)


def test_hosts_and_an_impatient_run_do_not_go_together(tmp_path):
    file = tmp_path / "hosts.toml"
    file.write_text(GOOD)
    keys.make(tmp_path / "keys", range(1, 6), [], 1)
    scenario = load(CONFIGS / "yard.toml", ["run.patience_s=1.0"])
    with pytest.raises(BadPlace, match=r"run.patience_s = 1: must be at least 4 with hosts"):
        Where(file, tmp_path / "keys").hosts(scenario)


@pytest.mark.parametrize(
    ("change", "with_keys", "words"),
    [
        (("[1]", "[9]"), True, "hosts.a.robots: robot 9 is not in the scenario"),
        (('keys = "k"\n', ""), True, "hosts.a.keys: is required with --keys"),
        (("x", "x"), False, "needs --keys DIR"),
        (("tls/", "tcp/"), False, "off loopback it must be tls/HOST:PORT"),
    ],
)
def test_hosts_that_do_not_suit_the_run_are_said(tmp_path, change, with_keys, words):
    file = tmp_path / "hosts.toml"
    file.write_text(GOOD.replace(*change))
    scenario = load(CONFIGS / "yard.toml")
    keys.make(tmp_path / "keys", scenario.ids, [], 1)
    with pytest.raises(BadPlace, match=re.escape(words)):
        Where(file, tmp_path / "keys" if with_keys else None).hosts(scenario)


PLACES = [
    ("ssh", '"root@h:abc"', "must have a port from 1 to 65535"),
    ("ssh", '"root@h:"', "must have a port from 1 to 65535"),
    ("ssh", '"root@h:0"', "must have a port from 1 to 65535"),
    ("ssh", '"root@h:65536"', "must have a port from 1 to 65535"),
    ("ssh", '"root@h:²"', "must have a port from 1 to 65535"),
    ("ssh", '""', "must name a machine"),
    ("ssh", '"root@"', "must name a machine"),
    ("ssh", '"@h"', "with a plain user name before the @"),
    ("ssh", '"-l@h"', "with a plain user name before the @"),
    ("ssh", '"-oProxyCommand=x"', "must be one address or host name"),
    ("ssh", '"root@-h"', "must be one address or host name"),
    ("ssh", '"h;reboot"', "must be one address or host name"),
    ("ssh", '"root@a b"', "no spaces or control characters"),
    ("ssh", '"ro ot@h"', "with a plain user name before the @"),
    ("ssh", '"h\\u001b]0;x"', "no spaces or control characters"),
    ("ssh", '"läb"', "must be ASCII: write the A-label"),
    ("ssh", '"root@[fd00::1"', "must be an IPv6 address"),
    ("ssh", '"root@[fd00::1]22"', "must be user@[address]:port"),
    ("ssh", '"root@10.0.0"', "must be an IPv4 address"),
    ("ssh", "3", "must be a string"),
    ("listen", '"tls/:7447"', "must name a machine"),
    ("listen", '"tls/a:b"', "must have a port from 1 to 65535"),
    ("listen", '"tls/a:70000"', "must have a port from 1 to 65535"),
    ("listen", '"udp/a:7447"', "must be tls/ADDRESS:PORT"),
    ("listen", '"tls/fd00::1:7447"', "must have brackets around an IPv6 address"),
    ("listen", '"tls/[fe80::1%eth0]:7447"', "must have no zone"),
    ("listen", '"tls/0.0.0.0:7447"', "must be an address of this machine that the hosts can reach"),
    ("listen", '"tls/a#verify_name_on_connect=false;x=:7447"', "must be one address or host name"),
    ("listen", '"tls/a b:7447"', "no spaces or control characters"),
    ("python", '""', "must be a path"),
    ("python", '" python3"', "must be a path"),
    ("python", '"py\\nthon3"', "must be a path"),
    ("python", '"-c"', "must not begin with -"),
    ("python", '"python3 -X dev"', "must be the interpreter alone"),
    ("python", '"~/env/bin/python"', "must be the whole path: ~ is not expanded"),
    ("keys", '""', "must be a path"),
    ("keys", '"--plaintext"', "must not begin with -"),
    ("keys", '"~/keys"', "must be the whole path: ~ is not expanded"),
    ("keys", '"k\\u0007"', "must be a path"),
]


@pytest.mark.parametrize(("key", "value", "rule"), PLACES)
def test_what_is_no_host_is_said_with_place_value_and_rule(tmp_path, key, value, rule):
    entries = {
        "listen": '"tls/10.0.0.1:7447"',
        "ssh": '"x"',
        "python": '"python3"',
        "keys": '"k"',
    } | {key: value}
    text = f'listen = {entries.pop("listen")}\n[[hosts]]\nname = "a"\nrobots = [1]\n'
    text += "".join(f"{name} = {entry}\n" for name, entry in entries.items())
    file = tmp_path / "hosts.toml"
    file.write_text(text, encoding="utf-8")
    place = "listen" if key == "listen" else f"hosts[0].{key}"
    for command in (("check", CONFIGS / "yard.toml"), ("run", CONFIGS / "yard.toml"), ("doctor",)):
        code, said = formnet(*command, "--hosts", file)
        assert code == 2
        assert f"hosts.toml: {place} = " in said
        assert rule in said
        assert "\x1b" not in said
    scenario = tmp_path / "scenario.toml"
    inside = text.replace("[[hosts]]", "[[hosts.hosts]]")
    scenario.write_text(
        (CONFIGS / "yard.toml").read_text() + f"\n[hosts]\n{inside}", encoding="utf-8"
    )
    code, said = formnet("check", scenario)
    assert code == 2
    assert f"hosts.{place} = " in said
    assert rule in said


@pytest.mark.parametrize(
    ("ssh", "target"),
    [
        ("pi", ("", "pi", 0)),
        ("pi@lab_pc.example.org:22", ("pi", "lab_pc.example.org", 22)),
        ("DOMAIN\\pi@10.0.0.1", ("DOMAIN\\pi", "10.0.0.1", 0)),
        ("pi@[fd00::1]:22", ("pi", "fd00::1", 22)),
        ("fd00::1", ("", "fd00::1", 0)),
        ("pi@fe80::1%eth0", ("pi", "fe80::1%eth0", 0)),
    ],
)
def test_where_ssh_logs_in(tmp_path, ssh, target):
    file = tmp_path / "hosts.toml"
    file.write_text(GOOD.replace('"x"', json.dumps(ssh)))
    assert load_hosts(file).hosts[0].target == target


def test_two_hosts_of_one_name_are_refused(tmp_path):
    """They would have shared one connection, so that robots ran where they should not."""
    file = tmp_path / "hosts.toml"
    other = GOOD.split("\n", 1)[1].replace("[1]", "[2]").replace('"x"', '"y"')
    file.write_text(GOOD + other)
    with pytest.raises(HostsError, match="two hosts are called a"):
        load_hosts(file)


def test_a_host_whose_first_line_is_no_process_s_id_is_heard():
    async def lines():
        for line in ("²\n", "text\n"):
            yield line

    async def wait():
        return None

    told = []
    channel = SimpleNamespace(is_closing=lambda: True)
    process = SimpleNamespace(
        stdout=lines(), wait=wait, channel=channel, exit_status=3, exit_signal=None
    )
    child = RemoteChild(None, None, process)
    asyncio.run(child.follow(told.append))
    assert told == ["²\n", "text\n"]
    assert child.poll() == 3


# --- used when the user says so ------------------------------------------------------------------

SECRET = ("tester", "192.0.2.77", "/opt/secret-env", "/srv/secret-keys", "alpha-host")


@pytest.fixture
def scenario(tmp_path):
    """Its author would have its user log in somewhere, and a program started there."""
    file = tmp_path / "scenario.toml"
    hosts = (
        '\n[hosts]\nlisten = "tls/192.0.2.1:7447"\n[[hosts.hosts]]\nname = "alpha-host"\n'
        'ssh = "tester@192.0.2.77:2222"\nrobots = [1, 2]\npython = "/opt/secret-env/bin/python"\n'
        'keys = "/srv/secret-keys"\n'
    )
    text = (CONFIGS / "paper" / "section5-delay.toml").read_text()
    file.write_text(text + hosts)
    return file


def mentions(folder):
    """What of SECRET stands in any file of ``folder``, or is its name."""
    return {
        (path.name, word)
        for path in folder.rglob("*")
        for word in SECRET
        if word in path.name or (path.is_file() and word.encode() in path.read_bytes())
    }


@pytest.mark.processes
def test_the_hosts_of_a_scenario_are_not_used_unasked_and_not_recorded(scenario, tmp_path):
    short = ("--set", "duration_s=0.3", "--no-scene", "--no-figures", "--no-lookahead")
    code, said = formnet("run", scenario, *short, "--out", tmp_path / "run")
    assert code == 1, said  # too short for its claims: it ran, here
    assert said.count("[hosts] is not used, and all robots run on this machine: add --hosts") == 1
    assert mentions(tmp_path / "run") == set()
    code, said = formnet("run", scenario, *short, "--inline", "--out", tmp_path / "inline")
    assert code == 1
    assert "[hosts]" not in said
    assert mentions(tmp_path / "inline") == set()
    code, said = formnet("verify", tmp_path / "run")
    assert code == 0, said
    code, said = formnet("run", tmp_path / "run", *short, "--inline", "--out", tmp_path / "again")
    assert code == 1
    hashes = {
        json.loads((tmp_path / name / "verdict.json").read_text())["trajectory_sha256"]
        for name in ("run", "inline", "again")
    }
    assert len(hashes) == 1
    assert (
        load(tmp_path / "run" / "scenario.toml") == load(scenario, ["duration_s=0.3"]).without_hosts
    )


@pytest.mark.long
def test_a_page_and_an_export_of_an_older_run_leave_hosts_out(scenario, tmp_path):
    """Its folder has them still."""
    run = tmp_path / "run"
    short = ("--set", "duration_s=0.3", "--no-scene", "--no-figures", "--no-lookahead")
    assert formnet("run", scenario, *short, "--inline", "--out", run)[0] == 1
    hosts = scenario.read_text().partition("[hosts]")[2]
    with (run / "scenario.toml").open("a") as file:
        file.write(f"\n[hosts]{hosts}")
    assert load(run / "scenario.toml").hosts is not None
    assert formnet("report", run)[0] == 0
    assert formnet("export", run, "--format", "csv", "--out", tmp_path / "csv")[0] == 0
    assert {word for name, word in mentions(run) if name != "scenario.toml"} == set()
    assert mentions(tmp_path / "csv") == set()


def test_a_schedule_of_nemesis_has_no_hosts(scenario):
    from formnet.lab.nemesis.schedule import scheduled

    assert scheduled(load(scenario), 1, []).hosts is None


def test_check_says_who_would_be_logged_in_to_and_what_started(scenario, tmp_path):
    words = (
        "the plant listens at tls/192.0.2.1:7447 host 1 (alpha-host): logs in to "
        "tester@192.0.2.77:2222 with your SSH keys and starts robots 1, 2 there with "
        "/opt/secret-env/bin/python, with the keys in /srv/secret-keys"
    )
    code, said = formnet("check", scenario, "--no-lookahead")
    assert code == 0
    assert f"[hosts], used with --hosts scenario alone: {words}" in said
    code, said = formnet("check", scenario, "--no-lookahead", "--hosts", "scenario")
    assert code == 0
    assert f"hosts, to be used: {words}" in said
    assert said.count(words) == 1
    other = tmp_path / "hosts.toml"
    other.write_text(GOOD)
    code, said = formnet("check", scenario, "--no-lookahead", "--hosts", other)
    assert code == 0
    assert "hosts, to be used: the plant listens at tls/10.0.0.1:7447 host 1 (a): logs in" in said
    assert f"[hosts], used with --hosts scenario alone: {words}" in said


def test_hosts_scenario_needs_hosts_in_the_scenario(tmp_path):
    for command in ("check", "run"):
        code, said = formnet(command, CONFIGS / "yard.toml", "--hosts", "scenario")
        assert code == 2
        assert "--hosts scenario: the scenario has no [hosts]" in said


# --- what is recorded ----------------------------------------------------------------------------


def test_texts_of_a_run_tell_of_no_machine(scenario, tmp_path):
    private = Private(load(scenario).hosts, tmp_path / "keys")
    for text, expected in [
        ("cannot reach tls/192.0.2.1:7447: no", "cannot reach tls/ADDRESS:7447: no"),
        ("tester@192.0.2.77:2222 refused", "USER@ADDRESS:2222 refused"),
        ("/srv/secret-keys/robot-1.pem is missing", "KEYS/robot-1.pem is missing"),
        (f"{tmp_path}/keys/plant.pem: bad", "KEYS/plant.pem: bad"),
        ('File "/opt/secret-env/lib/python3.11/x.py"', 'File "PYTHON/lib/python3.11/x.py"'),
        ('File "/home/alice/laws/mine.py", line 3', 'File "~/laws/mine.py", line 3'),
        ("/Users/alice: no; /root: no; /rooted", "~: no; ~: no; /rooted"),
        ("from 198.51.100.7:4711, [2001:db8::7]:1", "from ADDRESS:4711, [ADDRESS]:1"),
        ("127.0.0.1:7447 and [::1]:7447 stay", "127.0.0.1:7447 and [::1]:7447 stay"),
        ("zenoh 1.10.2, at 08:30:59 robot 3 :: ok", "zenoh 1.10.2, at 08:30:59 robot 3 :: ok"),
        ("a tester of the plant", "a tester of the plant"),
    ]:
        assert private(text) == expected
    lost = Lost(0, 1, "said tester@192.0.2.77", 3)
    assert private.record(lost) == Lost(0, 1, "said USER@ADDRESS", 3)
    assert private.record(Outcome("lost", 0, 1, "/home/alice/x")).reason == "~/x"
    host_lost = HostLost(0, "host 1", (1, 2), "its connection has ended")
    assert private.record(host_lost) == host_lost


@pytest.mark.processes
def test_a_monitor_that_does_not_start_tells_its_user_why_and_its_log_of_no_folder(tmp_path):
    place, told = tmp_path / "keys", []
    keys.make(place, [1], [], 1)
    (place / "monitor.pem").unlink()
    (tmp_path / "run" / "logs").mkdir(parents=True)
    where = Where(keys=place)
    watcher = Watcher("web", tmp_path / "run", where, told.append, where.private(None))
    watcher.join("tls/127.0.0.1:9", "run")
    watcher.close()
    assert f"the monitor did not start: {place}/monitor.pem is missing" in told[0]
    log = (tmp_path / "run" / "logs" / "monitor.log").read_text()
    assert log.startswith("KEYS/monitor.pem is missing")
    assert str(tmp_path) not in log
