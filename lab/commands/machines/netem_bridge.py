"""Join two Zenoh networks through emulated links."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import Command


@click.command("netem-bridge", cls=Command)
@click.option(
    "--from",
    "first",
    required=True,
    metavar="ENDPOINT",
    help="First network: connect to this endpoint, e.g. tcp/127.0.0.1:7447, or with the prefix "
    "listen: wait there for applications to connect.",
)
@click.option("--to", "second", required=True, metavar="ENDPOINT", help="Second network.")
@click.option(
    "--key", "keys", default="**", show_default=True, metavar="KEYEXPR", help="Keys to bridge."
)
@click.option(
    "--network",
    type=click.Path(path_type=Path),
    required=True,
    metavar="FILE.toml",
    help="The links: [network.default] and [[network.links]] with key and direction.",
)
@click.option(
    "--control",
    metavar="HOST:PORT",
    help="Serve statistics and accept changes here (HTTP, JSON), e.g. 127.0.0.1:8765.",
)
@click.option(
    "--control-token",
    "token",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="New file for the token that --control demands; it is deleted at the end.  "
    "[default: a temporary file]",
)
@click.option(
    "--control-anywhere",
    "anywhere",
    is_flag=True,
    help="Allow --control off loopback, unencrypted: only on a network that you trust.",
)
def command(
    first: str,
    second: str,
    keys: str,
    network: Path,
    control: str | None,
    token: Path | None,
    anywhere: bool,
) -> None:
    """Join two Zenoh networks through emulated links.

    Runs until Ctrl-C. Bridges publications (put, delete), queries and replies that match --key in
    both directions.
    """
    from formnet.lab.control.endpoint import Asked
    from formnet.lab.work.netem_bridge import run_bridge

    if control is None and (anywhere or token is not None):
        raise click.UsageError("--control-token and --control-anywhere need --control")
    asked = None if control is None else Asked(control, token, anywhere)
    sys.exit(run_bridge(first, second, keys, network, asked))
