"""Run the process of one robot.

Zenoh is imported once it is known how many threads it may have.
"""

import sys
from pathlib import Path

import click

from formnet.formation.wire import threads
from formnet.lab.commands.options import (
    KEYS,
    LEASE,
    LEASH,
    LONGEST_LEASE_S,
    PLAINTEXT,
    RUN_ID,
    Command,
    fail,
)


@click.command("agent", cls=Command)
@click.option("--robot", required=True, type=int, metavar="N", help="Id of the robot.")
@click.option(
    "--connect",
    required=True,
    metavar="ENDPOINT",
    help="Endpoint of the plant, e.g. tcp/127.0.0.1:7447.",
)
@RUN_ID
@LEASH
@KEYS
@PLAINTEXT
@LEASE
@click.option(
    "--law",
    metavar="FILE:NAME",
    help="Execute this law, code in a file, instead of the one that the scenario names.",
)
@click.option("--law-sha256", metavar="HEX", help="Only if the file's SHA-256 is this.")
def command(
    robot: int,
    connect: str,
    run_name: str,
    leash: bool,
    keys: Path | None,
    plaintext: bool,
    lease_s: float,
    law: str | None,
    law_sha256: str | None,
) -> None:
    """Run the process of one robot."""
    if lease_s < LONGEST_LEASE_S:  # one that is gone must not hold up the others
        threads.many()
    from formnet.agent.law import UnknownLaw, make
    from formnet.agent.law_file import LawFile
    from formnet.agent.process import main as agent_main
    from formnet.formation.machines.custody import KeysError
    from formnet.formation.wire.bus import BusError

    try:
        sys.exit(
            agent_main(
                robot=robot,
                run=run_name,
                connect=connect,
                stop_at_end_of_input=leash,
                keys=keys,
                plaintext=plaintext,
                lease_s=lease_s,
                law=make if law is None else LawFile.read(law, law_sha256),
            )
        )
    except (BusError, KeysError, UnknownLaw) as error:
        fail(3, str(error))
