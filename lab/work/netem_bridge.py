"""``formnet netem-bridge``: run a bridge until Ctrl-C, then say what became of the messages."""

import threading
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from formnet.lab.control.endpoint import Asked, opened
from formnet.lab.launch.signals import stop_signals
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, BROKEN, in_words
from formnet.lab.text.console import Console, escape
from formnet.lab.text.links_table import links_table
from formnet.lab.text.tables import output
from formnet.netem.bridge.bridge import Bridge, BridgeError, session
from formnet.netem.bridge.control import answer
from formnet.netem.bridge.lanes import checked_keys, load

_ARROWS = {"forward": "→", "backward": "←"}


def run_bridge(first: str, second: str, keys: str, network: Path, control: Asked | None) -> int:
    """Join two networks; returns the exit code of ``formnet netem-bridge``."""
    console = Console(stderr=True)
    with ExitStack() as stack:
        stopped = stack.enter_context(stop_signals())
        try:
            file = load(network)
            checked_keys(keys)
            endpoint = None if control is None else stack.enter_context(opened(control))
        except ValueError as error:
            console.print(f"[red]bad input:[/] {escape(str(error), lines=True)}", soft_wrap=True)
            return BAD_INPUT
        except FileExistsError as error:
            console.print(f"[red]--control-token:[/] {escape(in_words(error))}", soft_wrap=True)
            return BAD_INPUT
        except OSError as error:
            console.print(f"[red]--control:[/] {escape(in_words(error))}", soft_wrap=True)
            return BROKEN
        try:
            one = stack.enter_context(session(first))
            other = stack.enter_context(session(second))
            bridge = Bridge(one, other, keys, file)
        except BridgeError as error:
            console.print(f"[red]bridge:[/] {escape(str(error))}", soft_wrap=True)
            return BROKEN
        if endpoint is not None:
            endpoint.serve(stack, partial(answer, bridge))
            console.print(
                escape(f"control: {endpoint.url} (token in {endpoint.token})"), soft_wrap=True
            )
        console.print(
            escape(f"bridging {first} (→) and {second} (←), keys {keys}; Ctrl-C ends"),
            soft_wrap=True,
        )
        while not stopped.wait(0.2) and bridge.clock.running:
            pass
        broken = _drain(console, bridge, stopped)
        rows = bridge.statistics()
    output().print(
        links_table([(f"{_ARROWS[row['direction']]} {row['link']}", row) for row in rows], "")
    )
    if bridge.failures:
        console.print(f"[yellow]messages that could not be delivered:[/] {bridge.failures}")
    if broken is not None:
        console.print(
            f"[red]the bridge broke:[/] {escape(f'{type(broken).__name__}: {broken}')}",
            soft_wrap=True,
        )
        return BROKEN
    return ALL_HOLD


def _drain(console: Console, bridge: Bridge, stopped: threading.Event) -> Exception | None:
    """Deliver what is in flight, unless asked to stop again; returns what broke the bridge."""
    errors: list[Exception] = []

    def close() -> None:
        try:
            bridge.close()
        except Exception as error:  # whatever stopped the delivery
            errors.append(error)

    stopped.clear()
    closing = threading.Thread(target=close)
    closing.start()
    closing.join(0.3)
    if closing.is_alive():
        left = sum(row["in_flight"] for row in bridge.statistics())
        console.print(f"draining: {left} in flight; Ctrl-C again drops them")
    while closing.is_alive():
        closing.join(0.1)
        if stopped.is_set():
            bridge.clock.drop()
    return errors[0] if errors else None
