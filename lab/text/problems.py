"""What is wrong with a scenario, or takes long, in words on a console."""

from rich.console import Console

from formnet.formation.scenario.loading import ScenarioError
from formnet.lab.text.console import escape


def say_slow(console: Console, text: str) -> None:
    """Print what takes long before a run."""
    console.print(f"[yellow]waiting:[/] {escape(text)}", soft_wrap=True)


def warn(console: Console, warnings: list[str]) -> None:
    """Print warnings, one a line."""
    for warning in warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}", soft_wrap=True)


def report_problems(console: Console, error: ScenarioError) -> None:
    """Print every problem of a scenario, one a line: file, key, value, rule."""
    for problem in error.problems:
        console.print(f"[red]{escape(error.file)}:[/] {escape(str(problem))}", soft_wrap=True)
