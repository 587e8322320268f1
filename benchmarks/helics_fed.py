# mypy: disable-error-code="import-untyped,import-not-found"
"""The same exchange on HELICS: a plant federate and a federate per robot, a process each.

The messages are formnet's bytes (:mod:`benchmarks.wire`) as raw publications:
five senses and five drives a tick, and every tenth tick five broadcasts to two
neighbours each. Nothing is computed. The clock of the plant runs from its first
publication to its last grant.

The scheme is the cheapest correct one found with HELICS 3.6:

- Two half steps. Both sides have period 1; the plant's grid starts at 0 and the
  robots' at 0.5. The plant publishes at k, the robots are granted k + 0.5 with
  these senses and publish, and the plant is granted k + 1 with these drives. So
  every federate asks for time once a tick, and nobody iterates. The other order
  that needs one request a tick, a common grid on which the plant waits for the
  current time's updates, costs the same without the next point and stalls with it.
- Time is coordinated by the broker (``--globaltime``) instead of among federates:
  half the cost, because neighbours do not have to tell each other their times.
- Federates cannot be interrupted; the broker runs inside the plant's process, which
  spares a process; the core is HELICS's default, zmq. TCP cores (``--helics-core
  tcp``, ``tcp_ss``) cost the same within the noise, single-socket zmq no less, UDP
  lost messages, and shared memory failed.

It favours HELICS: a broadcast published at k + 0.5 is read at k + 1.5, where formnet
delivers it within the tick, which would take HELICS a third grant at broadcast
ticks. Every federate counts what was updated at each grant and fails if a sense,
a drive or a broadcast is missing, so the time printed is that of a whole exchange.

As a program: one of these processes; :func:`tick_ms` starts them all.
"""

import argparse
import importlib.util
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.children import reported, running
from benchmarks.table import BenchmarkError
from benchmarks.wire import BROADCAST_EVERY, Wire, ring, wire
from formnet.formation.wire.bus import LOOPBACK
from formnet.formation.wire.process import on_stop
from formnet.lab.launch.launch import free_port

CORE = "zmq"
START_S, TICK_S = 30.0, 0.05
"""An exchange may take this long to start, and this long per tick, before it is given up."""
EXECUTING = "executing"
"""What the plant's federate says, on standard error, when the exchange begins."""
ABORT_AFTER_S, ABORT_S = 2.0, 120.0
"""How long an exchange runs before one of it is killed, and may go on then."""
_RUN = "section5-delay-abcdef"


class ExchangeIncomplete(RuntimeError):
    """A grant came at another time, or without the messages it should have brought."""


def installed() -> bool:
    """Whether HELICS can be imported."""
    return importlib.util.find_spec("helics") is not None


def tick_ms(robots: int, ticks: int, logs: Path, *, core: str = CORE) -> float:
    """Run the exchange once; wall-clock milliseconds per tick.

    Raises:
        BenchmarkError: a process failed or the exchange got stuck.
    """
    commands = _commands(robots, ticks, core)
    return reported(commands, logs, limit_s=START_S + TICK_S * ticks) / ticks * 1e3


def abort_s(robots: int, logs: Path, *, core: str = CORE) -> float:
    """Kill one robot of a running exchange; seconds until the plant's process ends by itself.

    Raises:
        BenchmarkError: it goes on for longer than ABORT_S.
    """
    with running(_commands(robots, 10**9, core), logs) as children:
        deadline = time.monotonic() + START_S
        while EXECUTING not in (logs / "helics-plant.log").read_text(encoding="utf-8"):
            if time.monotonic() > deadline:
                raise BenchmarkError("HELICS did not start")
            time.sleep(0.1)
        time.sleep(ABORT_AFTER_S)
        children[f"helics-robot-{robots}"].kill()
        began_s = time.monotonic()
        try:
            children["helics-plant"].wait(ABORT_S)
        except subprocess.TimeoutExpired:
            raise BenchmarkError(f"HELICS has not ended {ABORT_S:g} s after a kill") from None
        return time.monotonic() - began_s


def _commands(robots: int, ticks: int, core: str) -> dict[str, list[str]]:
    """The processes of an exchange, the plant first."""
    common = [
        "benchmarks.helics_fed",
        "--core",
        core,
        "--port",
        str(free_port()),
        "--robots",
        str(robots),
        "--ticks",
        str(ticks),
    ]
    commands = {"helics-plant": common}
    for robot in range(1, robots + 1):
        commands[f"helics-robot-{robot}"] = [*common, "--robot", str(robot)]
    return commands


def _plant(federate: Any, messages: Wire, robots: int, ticks: int) -> float:
    """The plant's side; returns the seconds it took."""
    import helics

    ids = range(1, robots + 1)
    senses = [_publication(federate, f"sense/{robot}") for robot in ids]
    drives = [helics.helicsFederateRegisterSubscription(federate, f"drive/{r}", "") for r in ids]
    helics.helicsFederateEnterExecutingMode(federate)
    print(EXECUTING, file=sys.stderr, flush=True)
    started_s = time.perf_counter()
    for tick in range(ticks):
        for sense in senses:
            helics.helicsPublicationPublishBytes(sense, messages.sense)
        _request(federate, tick + 1.0)
        if _take(drives) != robots:
            raise ExchangeIncomplete(f"drives are missing at tick {tick}")
    return time.perf_counter() - started_s


def _robot(federate: Any, messages: Wire, robot: int, robots: int, ticks: int) -> None:
    """A robot's side."""
    import helics

    drive = _publication(federate, f"drive/{robot}")
    broadcast = _publication(federate, f"broadcast/{robot}")
    sense = [helics.helicsFederateRegisterSubscription(federate, f"sense/{robot}", "")]
    heard = [
        helics.helicsFederateRegisterSubscription(federate, f"broadcast/{neighbour}", "")
        for neighbour in ring(robot, robots)
    ]
    helics.helicsFederateEnterExecutingMode(federate)
    for tick in range(ticks):
        _request(federate, tick + 0.5)
        if _take(sense) != 1:
            raise ExchangeIncomplete(f"robot {robot} misses the sense of tick {tick}")
        due = len(heard) if tick % BROADCAST_EVERY == 1 else 0
        if _take(heard) != due:
            raise ExchangeIncomplete(f"robot {robot} misses a broadcast at tick {tick}")
        helics.helicsPublicationPublishBytes(drive, messages.drive)
        if tick % BROADCAST_EVERY == 0:
            helics.helicsPublicationPublishBytes(broadcast, messages.broadcast)


def _publication(federate: Any, key: str) -> Any:
    import helics

    return helics.helicsFederateRegisterGlobalPublication(
        federate, key, helics.HELICS_DATA_TYPE_RAW, ""
    )


def _request(federate: Any, time_s: float) -> None:
    import helics

    granted_s = helics.helicsFederateRequestTime(federate, time_s)
    if granted_s != time_s:
        raise ExchangeIncomplete(f"asked for time {time_s}, was granted {granted_s}")


def _take(inputs: list[Any]) -> int:
    """Read what was updated; returns how many."""
    import helics

    updated = [one for one in inputs if helics.helicsInputIsUpdated(one)]
    for one in updated:
        helics.helicsInputGetBytes(one)
    return len(updated)


@contextmanager
def _broker(core: str, port: int, federates: int) -> Iterator[None]:
    import helics

    broker = helics.helicsCreateBroker(
        core,
        "broker",
        f"-f {federates} --port={port} --local_interface={LOOPBACK} --loglevel=error --globaltime",
    )
    yield
    helics.helicsBrokerWaitForDisconnect(broker, 2000)


@contextmanager
def _federate(name: str, core: str, port: int, offset: float) -> Iterator[Any]:
    import helics

    info = helics.helicsCreateFederateInfo()
    helics.helicsFederateInfoSetCoreTypeFromString(info, core)
    helics.helicsFederateInfoSetCoreInitString(
        info,
        f"--federates=1 --broker_address={LOOPBACK} --brokerport={port} "
        f"--local_interface={LOOPBACK} --loglevel=error",
    )
    helics.helicsFederateInfoSetTimeProperty(info, helics.HELICS_PROPERTY_TIME_PERIOD, 1.0)
    helics.helicsFederateInfoSetTimeProperty(info, helics.HELICS_PROPERTY_TIME_OFFSET, offset)
    helics.helicsFederateInfoSetFlagOption(info, helics.HELICS_FLAG_UNINTERRUPTIBLE, True)
    federate = helics.helicsCreateValueFederate(name, info)
    yield federate
    helics.helicsFederateDisconnect(federate)


def main() -> None:
    """One process: the plant with the broker, which prints its seconds, or robot ``--robot``."""
    parser = argparse.ArgumentParser(description="One process of the exchange on HELICS.")
    parser.add_argument("--core", required=True)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--robots", type=int, required=True)
    parser.add_argument("--ticks", type=int, required=True)
    parser.add_argument("--robot", type=int)
    asked = parser.parse_args()
    on_stop(lambda: None, at_end_of_input=True)
    messages = wire(_RUN)
    if asked.robot is None:
        with (
            _broker(asked.core, asked.port, asked.robots + 1),
            _federate("plant", asked.core, asked.port, 0.0) as federate,
        ):
            print(_plant(federate, messages, asked.robots, asked.ticks), flush=True)
    else:
        with _federate(f"robot-{asked.robot}", asked.core, asked.port, 0.5) as federate:
            _robot(federate, messages, asked.robot, asked.robots, asked.ticks)
    import helics

    helics.helicsCloseLibrary()


if __name__ == "__main__":
    main()
