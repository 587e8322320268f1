"""Broken messages at every decoder, with a new seed every time: see :mod:`fuzzing`; and odd
numbers at every key of a scenario: see :mod:`every_number`."""

import secrets

import every_number
import pytest
import tomli_w
from fuzzing import fuzz

from formnet.formation.paper.theory import assess
from formnet.formation.scenario.loading import ScenarioError, loads
from formnet.lab.schemas.scenario import scenario_schema


def test_no_broken_message_escapes_a_decoder():
    seed = secrets.randbits(32)
    print(f"seed {seed}: python tests/helpers/fuzzing.py --messages 5000 --seed {seed}")
    found = fuzz(5000, seed)
    assert found.raised == []
    assert set(found.tried.values()) == {5000}
    refusing = ("lockstep", "broadcast", "envelope")
    assert all(100 < found.accepted[name] < 4900 for name in refusing)


# --- numbers of scenarios ---------------------------------------------------------------------


def test_the_scenarios_that_are_broken_load_and_have_every_numeric_key_of_the_format():
    schema = scenario_schema()
    keys = {
        key
        for table in (schema, *schema["$defs"].values())
        for key, entry in table["properties"].items()
        if numeric(entry)
    }
    assert len(keys) > 80
    found = set()
    for base in every_number.bases():
        loads(tomli_w.dumps(base))
        found |= {
            [part for part in place if isinstance(part, str)][-1]
            for place in every_number.numbers(base)
        }
    assert keys <= found | {"1-2"}, keys - found


def numeric(entry):
    """Whether a key holds numbers, be it in a list."""
    if "items" in entry:
        return numeric(entry["items"])
    inner = entry.get("anyOf", [])
    return entry.get("type") in ("number", "integer") or any(map(numeric, inner))


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_no_odd_number_of_a_scenario_raises_anything_but_a_scenario_error():
    """Each is refused with its place, or loads; then the theory has something to say."""
    refused = loaded = 0
    for place, odd, text in every_number.odd_texts():
        where = f"{place} = {odd}"
        try:
            scenario = loads(text)
        except ScenarioError:
            refused += 1
            continue
        except Exception as error:
            raise AssertionError(f"{where}: load raises {error!r}") from error
        try:
            assess(scenario)
            loaded += 1
        except Exception as error:
            raise AssertionError(f"{where}: assess raises {error!r}") from error
    assert refused > 1000
    assert loaded > 100
