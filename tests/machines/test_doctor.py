"""``formnet doctor``, of three network namespaces with an SSH server in each."""

import os
import shutil
import subprocess
import sys

import pytest
from machines.network import PORT

from formnet.lab.machines import authority, keys


def doctor(network, *changes, keys_here=None):
    text = (network.folder / "hosts.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    file = network.folder / "doctor.toml"
    file.write_text(text)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "formnet",
            "doctor",
            "--hosts",
            str(file),
            "--keys",
            str(keys_here or network.folder / "keys"),
        ],
        env={**os.environ, "HOME": str(network.folder / "home"), "COLUMNS": "500"},
        capture_output=True,
        text=True,
    )
    assert "Traceback" not in done.stdout + done.stderr
    return done.returncode, done.stdout


def python_that(tmp_path, name, code):
    """An interpreter in which ``code`` runs first."""
    folder = tmp_path / name
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(code)
    script = folder / "python"
    script.write_text(f'#!/bin/sh\nPYTHONPATH={folder} exec {sys.executable} "$@"\n')
    script.chmod(0o755)
    return script


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_finds_nothing_where_all_is_well(network):
    code, said = doctor(network)
    assert code == 0, said
    assert (
        said.count("✓") == 5 + 7 + 1 + 3 * 4 + 5
    )  # here: what there is, keys, port; hosts; robots
    assert "no problems found" in said


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_names_what_is_wrong_and_the_remedy(network, tmp_path):
    late = python_that(tmp_path, "late", "import time\nt = time.time\ntime.time = lambda: t() - 2")
    old = python_that(
        tmp_path, "old", "import formnet.formation.wire.messages as m\nm.PROTOCOL = 1"
    )
    place = tmp_path / "keys"
    shutil.copytree(network.folder / "keys", place)
    (place / "robot-5.pem").unlink()
    python, folder = f'python = "{sys.executable}"', f'keys = "{network.folder / "keys"}"'
    code, said = doctor(
        network,
        (python, f'python = "{late}"'),
        (python, f'python = "{old}"'),
        (f"robots = [5]\n{python}\n{folder}", f'robots = [5]\n{python}\nkeys = "{place}"'),
    )
    assert code == 3
    lines = said.splitlines()
    for problem, remedy in [
        ("✗ alpha: clock: -", "run an NTP client"),
        ("✗ beta: formnet: has ", "install the same there"),
        ("✗ gamma: certificate of robot-5: ", "formnet keys init"),
    ]:
        (number,) = [k for k, line in enumerate(lines) if line.startswith(problem)]
        assert remedy in lines[number + 1]
    assert "problems: 3" in said


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_tries_the_port_and_the_way_in(network):
    listen = f"tls/{network.here}:7447"
    code, said = doctor(
        network,
        (listen, "tls/127.0.0.1:7447"),
        (f"{network.address('gamma')}:{PORT}", f"{network.address('gamma')}:9"),
        (f'python = "{sys.executable}"', 'python = "/nowhere/python"'),
    )
    assert code == 3
    assert "✗ alpha: formnet: /nowhere/python has no formnet" in said
    assert "✗ beta: port: cannot reach 127.0.0.1:7447: " in said
    assert "open that port for beta in the firewall" in said
    assert "✗ gamma: SSH: host gamma (" in said
    code, said = doctor(network, (listen, "tls/192.0.2.1:7447"))
    assert code == 3
    assert "✗ here: port: cannot listen at tls/192.0.2.1:7447" in said


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_sees_expired_and_foreign_certificates(network, tmp_path, monkeypatch):
    place = tmp_path / "keys"
    keys.make(place, [1, 2], [], 10)  # another authority's
    real = authority.datetime

    class Past(real):
        @classmethod
        def now(cls, zone):
            return real.now(zone) - authority.timedelta(days=9)

    monkeypatch.setattr(authority, "datetime", Past)
    keys.make(tmp_path / "past", [3, 4], [], 3)
    folder = f'keys = "{network.folder / "keys"}"'
    code, said = doctor(
        network, (folder, f'keys = "{place}"'), (folder, f'keys = "{tmp_path / "past"}"')
    )
    assert code == 3
    assert (
        "✗ alpha: certificate of robot-1: is signed by another authority than the plant's" in said
    )
    assert "✗ beta: certificate of robot-3: " in said
    assert "robot-3.pem has expired, or ca.pem has" in said
    assert "where ca-key.pem is, `formnet keys renew DIR robot-3` makes another" in said


@pytest.mark.namespaces
@pytest.mark.processes
@pytest.mark.parametrize("answer", ["5", "[]", '{"unix_s": "x"}', "[" * 100_000])
def test_the_doctor_hears_a_program_that_is_no_probe(network, tmp_path, answer):
    (tmp_path / "answer").write_text(answer + "\n")
    script = tmp_path / "python"
    script.write_text(f"#!/bin/sh\nexec cat {tmp_path}/answer\n")
    script.chmod(0o755)
    code, said = doctor(network, (f'python = "{sys.executable}"', f'python = "{script}"'))
    assert code == 3
    assert f"✗ alpha: formnet: {script} has no formnet: {answer[:200]}\n" in said


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_sees_revoked_and_unmatched_certificates_on_hosts(network, tmp_path):
    """The host cannot know of a revocation; of a key that is another's it can."""
    place, python = tmp_path / "keys", f'python = "{sys.executable}"'
    keys.make(place, range(1, 6), [network.here], 30)
    old, swapped = tmp_path / "old", tmp_path / "swapped"
    for to in (old, swapped):
        to.mkdir(mode=0o700)
        shutil.copy(place / "ca.pem", to)
    for robot in (1, 2):
        for end in (".pem", "-key.pem"):
            shutil.copy(place / f"robot-{robot}{end}", old)
    for robot, other in ((3, 3), (4, 3)):
        shutil.copy(place / f"robot-{robot}.pem", swapped)
        shutil.copy(place / f"robot-{other}-key.pem", swapped / f"robot-{robot}-key.pem")
    keys.renew(place, ["robot-1"], [], 30)
    keys.revoke(place, ["robot-2"])
    folder = f'keys = "{network.folder / "keys"}"'
    code, said = doctor(
        network,
        (f"{python}\n{folder}", f'{python}\nkeys = "{old}"'),
        (f"{python}\n{folder}", f'{python}\nkeys = "{swapped}"'),
        (f"{python}\n{folder}", f'{python}\nkeys = "{place}"'),
        keys_here=place,
    )
    assert code == 3
    assert "✗ alpha: certificate of robot-1: robot-1.1 is revoked or was renewed" in said
    assert "✗ alpha: certificate of robot-2: robot-2.1 is revoked or was renewed" in said
    assert "✓ beta: certificate of robot-3: robot-3.1, valid until " in said
    assert "robot-4-key.pem is not the private key of robot-4.pem" in said
    assert "✓ gamma: certificate of robot-5: robot-5.1, valid until " in said
