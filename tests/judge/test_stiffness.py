"""The warning where gains and control period will not get along, against runs that break."""

import math
import re
from functools import partial
from math import inf

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from in_process import collected

from formnet.agent.law import Command
from formnet.formation.paper.theory import assess
from formnet.formation.scenario.loading import load, loads
from formnet.lab.cli import main
from formnet.lab.forecast import stiffness
from formnet.lab.forecast.stiffness import LIMIT, Look, course, longest_period_s, warnings
from formnet.lab.scenarios.new import Wish, scenario_text

COMPLETE = "formation.edges=[[1,2],[1,3],[1,4],[1,5],[2,3],[2,4],[2,5],[3,4],[3,5],[4,5]]"
STAR = "formation.edges=[[1,2],[1,3],[1,4],[1,5]]"
DELAYED = "paper/section5-delay.toml"
LOCKSTEP = "clock.mode=lockstep"
FAMILIES = {
    "ring": ("paper/section5.toml", (), 5.8e-3),
    "ring, delayed": (DELAYED, (), 9.0e-3),
    "complete graph": (DELAYED, (COMPLETE,), 2.66e-3),
    "star": (DELAYED, (STAR,), 6.0e-3),
    "half the length scale": (DELAYED, ("law.length_scale_m=50.0",), 16e-3),
    "kinematic": ("paper/theorem2.toml", (), 53e-3),
    "yard": ("yard.toml", (LOCKSTEP,), 240e-3),
    "yard, larger beta": ("yard.toml", (LOCKSTEP, "law.beta=6.0"), 126e-3),
}
"""Scenarios, and the control period (s) at which their runs were found to break."""


def sampled(root, family, factor):
    """The family's scenario at ``factor`` times the period at which its runs break."""
    file, overrides, breaks_at_s = FAMILIES[family]
    path = root / "configs" / file
    period_s = float(f"{factor * breaks_at_s:.3g}")
    broadcast_s = period_s * max(1, round(load(path).clock.broadcast_period_s / period_s))
    return load(
        path,
        [
            *overrides,
            f"clock.control_period_s={period_s!r}",
            f"clock.broadcast_period_s={broadcast_s!r}",
            f"duration_s={period_s * round(8.0 / period_s)!r}",
            "neighbours.silence_s=5.0",
        ],
    )


def breaks(scenario):
    """Whether the run diverges, or robots still whirl at its end (in the pattern: 0.5 rad/s)."""
    run = collected(scenario)
    if run.outcome.kind == "diverged":
        return True
    return bool(abs(run.latest().states[..., 4]).max() > 20.0)


def too_long(scenario):
    return scenario.clock.control_period_s > longest_period_s(course(scenario))


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
def test_the_warning_begins_within_a_factor_of_two_of_where_runs_break(root, family):
    assert not breaks(sampled(root, family, 0.85))
    assert breaks(sampled(root, family, 1.15))
    assert not too_long(sampled(root, family, 0.5))
    assert too_long(sampled(root, family, 2.0))


def shipped(root):
    found = sorted((root / "configs").rglob("*.toml"))
    return [path for path in found if path.name != "wifi.toml"]  # the bridge's


@pytest.mark.long
def test_no_shipped_scenario_is_warned_of_its_period(root):
    paths = shipped(root)
    assert len(paths) >= 12
    for path in paths:
        scenario = load(path)
        assert warnings(scenario) == assess(scenario).warnings, path


@pytest.mark.long
def test_check_and_run_warn_with_numbers_that_help(root, tmp_path, monkeypatch):
    monkeypatch.setattr(stiffness, "MOST_S", 60.0)  # however busy the machine is

    def said(command, *overrides):
        changes = [word for override in overrides for word in ("--set", override)]
        path = str(root / "configs" / "paper" / "section5.toml")
        result = CliRunner().invoke(main, [*command, path, *changes])
        return result.output

    slow = "clock.control_period_s=0.01"
    checked = said(["check"], slow)
    words = "warning: clock.control_period_s = 0.01: too long for these gains"
    advice = "Try control_period_s <= 0.0025, or law.beta <= "
    assert words in checked
    assert advice in checked
    beta = checked.partition(advice)[2].split()[0]
    assert "too long" not in said(["check"], "clock.control_period_s=0.0025")
    assert "too long" not in said(["check"], slow, f"law.beta={beta}")
    (tmp_path / "file").touch()  # the run ends before it begins, but not before it warns
    assert words in said(["run", "--inline", "--out", str(tmp_path / "file" / "below")], slow)


@pytest.mark.parametrize("error", [ZeroDivisionError, SystemExit])
def test_a_law_that_raises_is_warned_of(root, error):
    class Broken:
        def command(self, now_ns, own, heard):
            raise error("none")

    scenario = load(root / "configs" / "yard.toml")
    said = f"the law failed in the trial before the run: robot 1: {error.__name__}: none (test_stiffness"
    assert warnings(scenario, lambda situation: Broken())[-1].startswith(said)


RETURN = 'timeline=[{action="kill", at_s=5.0, robots=3, restart_after_s=20.0}]'
"""Of a robot that has to make up for 20 s of turning."""


def fleet(*changes):
    """The scenario of ``formnet new`` with a γ for which that is too much."""
    text = scenario_text(Wish("fleet", 8, "wedge", "ring", "wifi", None, 1, "lockstep"))
    return loads(text, overrides=["law.gamma=0.1", "duration_s=40.0", RETURN, *changes])


@pytest.mark.long
def test_a_robot_that_comes_back_late_is_looked_at(monkeypatch):
    monkeypatch.setattr(stiffness, "MOST_S", 60.0)  # however busy the machine is
    said = [warning for warning in warnings(fleet()) if "too long" in warning]
    assert "after the restart of robot 3 at 25 s the closed loop has a rate of" in said[0]
    advice = said[0].partition("Try ")[2]
    gamma, period, steep = re.fullmatch(
        r"law.gamma <= (\S+), or control_period_s <= (\S+) \(with a robust term (\S+) times as steep "
        r"as at the start\)",
        advice,
    ).groups()
    assert float(steep) == pytest.approx(math.exp(0.1 * 25.0), rel=0.1)
    assert collected(fleet()).outcome.kind == "diverged"
    for change in (f"clock.control_period_s={period}", f"law.gamma={gamma}"):
        mended = fleet(change)
        assert not [warning for warning in warnings(mended) if "too long" in warning]
        assert collected(mended).outcome.kind == "completed"
    assert not [warning for warning in warnings(fleet("timeline=[]")) if "too long" in warning]


def test_any_law_is_looked_at(root):
    """A turn rate of −k θ under zero-order hold is stable up to h = 2 / k."""

    class Turning:
        def command(self, now_ns, own, heard):
            return Command(0.0, -8.0 * own.heading_rad)

    scenario = load(root / "configs" / "paper" / "theorem1.toml")
    assert longest_period_s(course(scenario, law=lambda situation: Turning())) == pytest.approx(
        2.0 / 8.0
    )


def test_a_law_that_takes_its_time_is_not_followed_for_long(root, monkeypatch):
    """A second each time it is asked: 6 times for a look at each of 5 robots, 5 for the way on."""
    clock = [0.0]

    class Slow:
        def command(self, now_ns, own, heard):
            clock[0] += 1.0
            return Command(0.0, -8.0 * own.heading_rad)

    scenario = load(root / "configs" / "paper" / "theorem1.toml")
    followed = partial(course, scenario, law=lambda situation: Slow())
    monkeypatch.setattr(stiffness.time, "monotonic", lambda: clock[0])
    assert len(followed(100.0)) == 2
    assert clock[0] == 2 * 55.0
    assert len(followed(0.0)) == 1
    assert len(followed()) > 2


RATES = st.floats(1e-3, 1e9)
LASTS = st.floats(1e-9, 1e3)


@given(st.lists(st.tuples(RATES, LASTS), max_size=20))
def test_a_period_is_short_enough_while_what_is_too_fast_for_it_ends_within_one(looks):
    longest_s = longest_period_s([Look(0.0, *look) for look in looks])
    shorter_s = 0.999 * longest_s if longest_s < inf else 1e9
    fast_s = sum(lasts for rate, lasts in looks if rate * shorter_s > LIMIT)
    assert fast_s <= shorter_s
    if longest_s < inf:
        reached_s = sum(lasts for rate, lasts in looks if rate * longest_s >= 0.999 * LIMIT)
        assert reached_s >= 0.999 * longest_s


def test_too_short_a_peak_does_no_harm():
    slow = Look(0.0, 10.0, 1.0)
    assert longest_period_s([slow, Look(1.0, 1e4, 1e-5)]) == pytest.approx(0.2)
    assert longest_period_s([slow, Look(1.0, 1e4, 1e-3)]) == pytest.approx(2e-4)
    assert longest_period_s([]) == inf
