"""What tests of hosts and keys share: a network and a folder of keys, for modules that ask."""

import shutil
import subprocess
import sys

import pytest
from machines.network import HOSTS, PORT, Network
from processes import missing

from formnet.lab.machines import keys


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    if shutil.which("ip") is None:
        missing("iproute2")
    found = Network(tmp_path_factory.mktemp("hosts"))
    try:
        try:
            found.build()
        except subprocess.CalledProcessError as error:
            pytest.skip(f"no network namespaces can be made here: {error.stderr.decode().strip()}")
        found.serve()
        place = found.folder / "keys"
        keys.make(place, range(1, 6), [found.here], 30)
        text = f'listen = "tls/{found.here}:7447"\n'
        for host, robots in HOSTS.items():
            text += (
                f'[[hosts]]\nname = "{host}"\nssh = "tester@{found.address(host)}:{PORT}"\n'
                f'robots = {robots}\npython = "{sys.executable}"\nkeys = "{place}"\n'
            )
        (found.folder / "hosts.toml").write_text(text)
        yield found
    finally:
        found.tear_down()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    place = tmp_path_factory.mktemp("keys") / "keys"
    keys.make(place, range(1, 6), ["10.1.2.3", "lab-pc"], 30)
    return place


@pytest.fixture
def folder(made, tmp_path):
    """A copy, to be spoilt."""
    shutil.copytree(made, tmp_path / "keys")
    return tmp_path / "keys"
