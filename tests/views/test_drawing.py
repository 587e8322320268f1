"""Edges that bend around others, and how much of the plane is in sight."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rerun.chunk import RrdReader

from formnet.formation.records.rows import Sample, Samples
from formnet.formation.scenario.loading import loads
from formnet.lab.figures.canvas import MOST_BENT, bowed, bows
from formnet.lab.scenarios.new import Wish, scenario_text
from formnet.lab.scene.blueprint import half_width
from formnet.lab.scene.rrd import RunFile

ALONG = np.linspace(0.0, 1.0, 101)
WISH = Wish("x", 8, "wedge", "ring", "ideal", None, 1, "lockstep")


def gap(points, edge, bow):
    """How near an edge comes to a point that is none of its ends."""
    curve = bowed(points[list(edge)], bow, ALONG)
    others = np.delete(points, edge, axis=0)
    return float(np.linalg.norm(curve[:, None] - others, axis=-1).min())


@pytest.mark.parametrize("turned", [0.0, 0.3, 2.0])
def test_among_points_in_a_line_only_neighbours_are_joined_straight(turned):
    along = np.array([np.cos(turned), np.sin(turned)])
    points = np.arange(6.0)[:, None] * along
    edges = [(a, b) for a in range(6) for b in range(a + 1, 6)]
    for edge, bow in zip(edges, bows(points, edges), strict=True):
        assert (bow == 0.0) == (edge[1] - edge[0] == 1)
        assert gap(points, edge, bow) > 0.07 * 5.0 * max(np.abs(along))


def test_the_wedge_of_the_tutorial_bends_its_long_edge_outwards():
    scenario = loads(scenario_text(WISH))
    points = scenario.offsets_m
    edges = [(a - 1, b - 1) for a, b in scenario.formation.edges]
    found = dict(zip(edges, bows(points, edges), strict=True))
    assert {edge for edge, bow in found.items() if bow} == {(0, 7)}
    middle = bowed(points[[0, 7]], found[0, 7], np.array([0.5]))[0]
    straight = points[[0, 7]].mean(axis=0)
    centre = points.mean(axis=0)
    assert np.linalg.norm(middle - centre) > np.linalg.norm(straight - centre)
    assert gap(points, (0, 7), 0.0) == pytest.approx(0.0, abs=0.05)


@given(st.floats(-1.0, 1.0), st.tuples(*[st.floats(-9.0, 9.0)] * 4))
def test_a_bow_keeps_the_ends_and_is_a_share_of_the_length(bow, ends):
    ends = np.array(ends).reshape(2, 2)
    curve = bowed(ends, bow, ALONG)
    assert curve[[0, -1]] == pytest.approx(ends)
    length = np.linalg.norm(ends[1] - ends[0])
    aside = np.linalg.norm(curve[50] - ends.mean(axis=0))
    assert aside == pytest.approx(abs(bow) * length, abs=1e-9)


def test_no_edge_and_many_robots_stay_straight():
    assert bows(np.zeros((3, 2)), []).shape == (0,)
    many = np.arange(MOST_BENT + 1.0)[:, None] * np.ones(2)
    assert bows(many, [(0, 9)]).tolist() == [0.0]


@pytest.mark.parametrize("robots", [2, 3, 4, 5, 40])
def test_robots_have_a_colour_each(robots, tmp_path):
    """Not one for all, as which Rerun takes three or four plain numbers."""
    scenario = loads(scenario_text(WISH._replace(robots=robots, graph="path")))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = RunFile(tmp_path, scenario)
        scene.take(
            Samples(
                [
                    Sample(0, robot, float(robot), 0.0, 0.0, 0.0, 0.0, None, None)
                    for robot in scenario.ids
                ]
            ),
            0,
        )
        scene.close(None)
    (names,) = [
        chunk.to_record_batch().column("Points2D:colors").to_pylist()[0]
        for chunk in RrdReader(str(tmp_path / "run.rrd")).stream()
        if chunk.entity_path == "/field/names" and not chunk.timeline_names
    ]
    assert len(set(names)) == robots


def test_what_is_in_sight_grows_with_who_leaves_but_not_after_who_diverges():
    scenario = loads(scenario_text(WISH))
    starts = np.array([(robot.start.x_m, robot.start.y_m) for robot in scenario.robots])
    first = half_width(scenario, starts)
    assert half_width(scenario, np.full((2, 2), np.nan), first) == first
    farther = half_width(scenario, starts + np.array([2.0 * first, 0.0]), first)
    assert first < farther <= 4.0 * first
    assert half_width(scenario, starts, farther) == farther  # it does not shrink
    away = half_width(scenario, np.array([[np.inf, 0.0], [1e300, 0.0]]))
    assert 16.0 * first <= away < 20.0 * first
