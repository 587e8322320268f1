"""What a tick costs a machine that only wakes processes: no Zenoh, no formnet, pipes alone.

Every tick one process sends a byte to each of n others and waits for a byte of each; these
touch some memory before they answer, as a robot touches its own. How the cost grows with n
is the caches' and the scheduler's doing. ``python -m benchmarks.machine N TICKS KILOBYTES``
prints milliseconds a tick.
"""

import os
import subprocess
import sys
import time

from benchmarks.table import BenchmarkError

TOUCHED_KB = (0, 600)
"""Nothing, and about what a robot's process touches between two ticks."""
_LINE = 64


def tick_ms(processes: int, ticks: int, touched_kb: int) -> float:
    """Milliseconds a tick.

    Raises:
        BenchmarkError: it could not be measured.
    """
    arguments = map(str, (processes, ticks, touched_kb))
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.machine", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise BenchmarkError(f"machine: {done.stderr.strip().rpartition(chr(10))[2]}")
    return float(done.stdout)


def _measure(processes: int, ticks: int, touched_kb: int) -> float:
    answers, answer = os.pipe()
    bells = []
    for _ in range(processes):
        listen, ring = os.pipe()
        bells.append(ring)
        if os.fork() == 0:
            _serve(listen, answer, ticks, bytearray(touched_kb * 1024))
    start = time.perf_counter()
    for _ in range(ticks):
        for ring in bells:
            os.write(ring, b".")
        missing = processes
        while missing:
            missing -= len(os.read(answers, missing))
    took_s = time.perf_counter() - start
    for _ in range(processes):
        os.wait()
    return took_s / ticks * 1e3


def _serve(listen: int, answer: int, ticks: int, memory: bytearray) -> None:
    lines = b"x" * len(range(0, len(memory), _LINE))
    for _ in range(ticks):
        os.read(listen, 1)
        memory[::_LINE] = lines
        os.write(answer, b".")
    os._exit(0)


if __name__ == "__main__":
    print(_measure(*map(int, sys.argv[1:4])))
