"""A scenario as values by key path, as ``--set`` takes them: ``robots.3.damping``."""

from collections.abc import Mapping, Sequence
from typing import Any

from formnet.formation.scenario.model import Scenario


def by_path(scenario: Scenario, *, changed_only: bool = False) -> dict[str, Any]:
    """Every value of a scenario; with ``changed_only``, those that are no defaults."""
    data = scenario.model_dump(
        mode="json", by_alias=True, exclude_none=True, exclude_defaults=changed_only
    )
    return dict(_leaves(data, ""))


def shown(value: Any) -> str:
    """A value for people, much as TOML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    if isinstance(value, list):
        return "[" + ", ".join(shown(item) for item in value) + "]"
    return str(value)


def _leaves(data: Any, place: str) -> list[tuple[str, Any]]:
    if isinstance(data, Mapping):
        start = f"{place}." if place else ""
        return [leaf for key, value in data.items() for leaf in _leaves(value, f"{start}{key}")]
    if isinstance(data, Sequence) and data and all(isinstance(item, Mapping) for item in data):
        places = [
            f"{place}.{item['id']}" if "id" in item else f"{place}[{number}]"
            for number, item in enumerate(data)
        ]
        return [
            leaf for where, item in zip(places, data, strict=True) for leaf in _leaves(item, where)
        ]
    return [(place, data)]
