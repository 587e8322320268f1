"""Many pieces of work: at once and in turn, ended early, and failing."""

import os
import subprocess
import sys
import time

import psutil
import pytest
from rich.console import Console
from workers import dying, endless, failing, squared, until_stopped

from formnet.lab.launch import pool


@pytest.mark.processes
def test_every_item_is_done_once():
    for found in (
        pool.at_once(squared, range(20), lambda: False, 2),
        pool.in_turn(squared, range(20), lambda: False),
    ):
        assert sorted(found) == [(n, n * n) for n in range(20)]


@pytest.mark.processes
def test_an_early_end_reaches_what_runs_and_begins_no_more():
    done = []
    for item, result in pool.at_once(until_stopped, range(50), lambda: bool(done), 2):
        done.append((item, result))
    assert done == [(0, "first")]
    assert list(pool.in_turn(squared, range(3), lambda: True)) == []


@pytest.mark.processes
def test_work_that_never_asks_is_cut_short(tmp_path):
    begun = tmp_path / "begun"
    since = time.monotonic()
    assert list(pool.at_once(endless, [begun, begun], begun.exists, 1)) == []
    assert time.monotonic() - since < 60.0


@pytest.mark.processes
def test_what_goes_wrong_is_told():
    with pytest.raises(pool.WorkFailed, match="Unpicklable: three is"):
        list(pool.at_once(failing, [1], lambda: False, 1))
    with pytest.raises(pool.WorkFailed, match="Unpicklable: three is"):
        list(pool.in_turn(failing, [1], lambda: False))
    with pytest.raises(pool.WorkFailed, match="a worker's process died"):
        list(pool.at_once(dying, [1], lambda: False, 1))


@pytest.mark.processes
def test_workers_die_with_the_process_that_began_them(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import os, pathlib, sys, time\n"
        "from formnet.lab.launch import pool\n"
        "def endless(item, stopped):\n"
        "    pathlib.Path(sys.path[0], f'{os.getpid()}.pid').touch()\n"
        "    time.sleep(600)\n"
        "if __name__ == '__main__':\n"
        "    list(pool.at_once(endless, [1, 2], lambda: False, 2))\n"
    )
    process = subprocess.Popen([sys.executable, str(script)])
    deadline = time.monotonic() + 60.0
    while len(pids := [int(path.stem) for path in tmp_path.glob("*.pid")]) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    workers = [psutil.Process(pid) for pid in pids]
    process.kill()
    process.wait()
    assert psutil.wait_procs(workers, timeout=10.0)[1] == []


def test_the_bar_passes_everything_on():
    console = Console(file=open(os.devnull, "w"))  # noqa: SIM115
    pairs = [(n, -n) for n in range(4)]
    assert list(pool.shown(console, pairs, 4, str)) == pairs
