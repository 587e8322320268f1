"""Figures show what was: places and edges, a colour for each robot, the circle, what befell whom."""

import math
import warnings
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.collections import LineCollection  # noqa: TID251

from formnet.formation.records.events import Kill, Lost
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Sample, Samples
from formnet.formation.scenario.loading import loads
from formnet.lab.claims.figures import compared
from formnet.lab.figures import links as link_figures
from formnet.lab.figures import run_figures as figures
from formnet.lab.figures.canvas import COLOURS, SCREEN_COLOURS, colours, dashes
from formnet.lab.figures.graph import cuts, graph
from formnet.lab.figures.headings import gaps_to_mean, headings, on_circle, wrapped
from formnet.lab.runs.recording import Collected
from formnet.lab.scenarios.new import Wish, scenario_text
from formnet.lab.scene import foxglove

WISH = Wish("x", 6, "circle", "ring", "ideal", None, 1, "lockstep")
TRIANGLES = "formation.edges=[[1, 2], [2, 3], [1, 3], [4, 5], [5, 6], [4, 6], [2, 4]]"
PLACES = [(0.0, 0.0), (1.0, 0.0), (0.5, 0.9), (4.0, 0.0), (5.0, 0.0), (4.5, 0.9)]
AT_PLACES = [f"robots.{k}.offset_m=[{x}, {y}]" for k, (x, y) in enumerate(PLACES, start=1)]


def scenario_of(*overrides, **wish):
    return loads(scenario_text(WISH._replace(**wish)), overrides=list(overrides))


def recorded(scenario, headings_rad=None, seconds=3, end_ns=None):
    """Robots that stand in their pattern, with ``headings_rad`` (instants, robots)."""
    run = Collected(scenario)
    if headings_rad is None:
        headings_rad = np.zeros((seconds * 100 + 1, len(scenario.ids)))
    for tick, row in enumerate(np.asarray(headings_rad, dtype=float).tolist()):
        run(
            Samples(
                [
                    Sample(tick * 10**7, robot, float(x), float(y), heading, 0.0, 0.0, None, None)
                    for robot, (x, y), heading in zip(
                        scenario.ids, scenario.offsets_m, row, strict=True
                    )
                ]
            )
        )
    run(Outcome("completed", run.now_ns() if end_ns is None else end_ns, None, ""))
    return run


# --- paths.png ------------------------------------------------------------------------


def patterns(run):
    """The ends of the lines in the panel of the end, by label, and the other lines there."""
    end = figures.paths(run).axes[1]
    lines = {
        item.get_label(): {
            frozenset(tuple(np.round(point, 9).tolist()) for point in line[[0, -1]])
            for line in map(np.asarray, item.get_segments())
        }
        for item in end.collections
        if isinstance(item, LineCollection)
    }
    return lines, [line for line in end.lines if line.get_linestyle() != "None"]


def test_two_triangles_are_two_triangles_and_no_star():
    run = recorded(scenario_of(TRIANGLES, *AT_PLACES))
    lines, others = patterns(run)
    edges = {frozenset((PLACES[a - 1], PLACES[b - 1])) for a, b in run.scenario.formation.edges}
    assert len(edges) == 7
    assert lines == {"desired pattern": edges, "final positions": edges}
    assert others == []


def test_final_edges_are_between_robots_that_are_up():
    dead = 'timeline=[{at_s=1.0, action="kill", robots=[2]}]'
    lines, _ = patterns(recorded(scenario_of(TRIANGLES, *AT_PLACES, dead)))
    gone = PLACES[1]
    assert {edge for edge in lines["desired pattern"] if gone not in edge} == lines[
        "final positions"
    ]
    assert len(lines["final positions"]) == 4


# --- colours --------------------------------------------------------------------------


def lightness_and_ab(code):
    """CIELAB of ``#RRGGBB`` by the formulas of IEC 61966-2-1 and CIE 15, one number at a time."""
    red, green, blue = (
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
        for c in (int(code[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    )
    x = (0.4124 * red + 0.3576 * green + 0.1805 * blue) / 0.9505
    y = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    z = (0.0193 * red + 0.1192 * green + 0.9505 * blue) / 1.0890
    fx, fy, fz = (
        t ** (1 / 3) if t > (6 / 29) ** 3 else t / (3 * (6 / 29) ** 2) + 4 / 29 for t in (x, y, z)
    )
    return 116 * fy - 16, 500 * (fx - fy), 200 * (fy - fz)


@pytest.mark.parametrize("palette", [COLOURS, SCREEN_COLOURS])
def test_sixty_robots_have_sixty_colours(palette):
    """A difference of 2.3 is just noticed (Mahy et al., 1994); all here are over eight times that.

    Of white, the ground of a figure, too: a colour that is like it is none.
    """
    sixty = colours(60, palette)
    places = [lightness_and_ab(code) for code in ("#FFFFFF", *sixty)]
    least = min(math.dist(a, b) for k, a in enumerate(places) for b in places[:k])
    assert least > 8 * 2.3
    for count in range(1, 61):
        assert colours(count, palette) == sixty[:count]  # nobody's depends on how many there are


def test_the_first_eight_are_the_palette_and_solid():
    assert colours(8) == list(COLOURS)
    assert dashes(8) == ["-"] * 8
    assert dashes(9)[8] != "-"


def test_even_five_hundred_differ():
    assert len(set(colours(500))) == 500


def looks(axes):
    return [
        (line.get_color(), line.get_linestyle())
        for line in axes.lines
        if line.get_label().startswith("robot ")
    ]


def test_twenty_robots_can_be_told_apart_in_every_figure():
    scenario = scenario_of(robots=20, pattern="grid")
    run = recorded(scenario, seconds=1)
    kill = Kill(0, (3,))
    for figure in (figures.paths(run), headings(run, run.trajectories)):
        found = looks(figure.axes[0])
        assert len({colour for colour, _ in found}) == 20
        assert len({style for _, style in found}) > 1
        (legend,) = figure.legends
        assert len(legend.get_texts()) == 20
    nodes = [line.get_color() for line in graph(run).axes[0].lines if line.get_marker() == "o"]
    assert len(set(nodes)) == 20
    assert (
        len(
            {
                line.get_color()
                for line in figures.thumbnail(scenario, run.trajectories).axes[0].lines
            }
        )
        == 20
    )
    run(kill)
    motion = compared(run, run).axes[2]
    assert len({line.get_color() for line in motion.lines}) == 20
    bodies = [entity["cylinders"][0]["color"] for entity in foxglove._bodies(run)["entities"]]
    assert len({tuple(colour.values()) for colour in bodies}) == 20


def test_beyond_the_legend_the_numbers_stand_beside_the_robots():
    run = recorded(scenario_of(robots=30), seconds=1)
    figure = figures.paths(run)
    assert not figure.legends
    assert {text.get_text() for text in figure.axes[1].texts} == {str(k) for k in range(1, 31)}


# --- headings.png ---------------------------------------------------------------------


@given(st.floats(-1e4, 1e4))
def test_wrapped_is_the_same_direction_in_one_turn(angle):
    (found,) = wrapped(np.array([angle]))
    assert -math.pi < found <= math.pi
    assert math.isclose(math.remainder(found - angle, math.tau), 0.0, abs_tol=1e-9)


def test_pi_is_its_own_place():
    assert wrapped(np.array([math.pi, -math.pi, 3 * math.pi])).tolist() == pytest.approx(
        [math.pi] * 3
    )


@given(st.lists(st.floats(-20.0, 20.0), min_size=2, max_size=30))
def test_no_line_runs_across_the_circle(angles):
    t_s, drawn = on_circle(np.arange(len(angles), dtype=float), np.array(angles))
    assert all(not abs(b - a) > math.pi for a, b in pairwise(drawn))  # NaN is a gap
    kept = ~np.isnan(drawn)
    assert t_s[kept].tolist() == list(range(len(angles)))
    assert (np.diff(t_s) >= 0.0).all()


def test_who_agrees_over_the_end_of_the_circle_has_no_gap():
    """0 and 6.1 rad are 0.183 rad apart, and so each is half of that from the mean."""
    found = gaps_to_mean(np.array([[0.0, 6.1]]), np.ones((1, 2), dtype=bool))
    half = (math.tau - 6.1) / 2
    assert found[0] == pytest.approx([half, -half])


@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.booleans()), min_size=1, max_size=8))
def test_the_mean_is_that_of_the_circle_and_of_who_is_up(robots):
    """What defines it: Σ sin(gap) = 0 and Σ cos(gap) > 0 over those who are up."""
    angles, up = (np.array([column]) for column in zip(*robots, strict=True))
    gaps = gaps_to_mean(angles, up)
    assert np.isnan(gaps[~up]).all()
    own = gaps[up]
    resultant = abs(np.exp(1j * angles[up]).sum())
    if resultant > 1e-6:
        assert np.sin(own).sum() == pytest.approx(0.0, abs=1e-9)
        assert np.cos(own).sum() == pytest.approx(resultant)


def test_opposite_headings_have_no_mean():
    assert np.isnan(gaps_to_mean(np.array([[0.0, math.pi]]), np.ones((1, 2), dtype=bool))).all()


def test_a_dead_robot_is_dotted_above_marked_where_it_fell_and_not_below():
    dead = 'timeline=[{at_s=1.0, action="kill", robots=3, restart_after_s=0.5}]'
    turning = np.linspace(0.0, 40.0, 301)[:, None] + np.array([0.0, math.tau, 0.0, 0.0, 0.0, 0.0])
    turning[100:150, 2] = turning[100, 2]
    run = recorded(scenario_of(dead), turning)
    upper, lower = headings(run, run.trajectories).axes
    assert upper.get_ylim() == pytest.approx((-1.06 * math.pi, 1.06 * math.pi))
    assert lower.get_ylim()[0] == -lower.get_ylim()[1]
    (cross,) = [line for line in upper.lines if line.get_marker() == "x"]
    assert cross.get_xydata().tolist() == [[1.0, wrapped(turning[100:101, 2])[0]]]
    (dotted,) = [line for line in upper.lines if line.get_linestyle() == ":"]
    t_s, angle = dotted.get_xydata().T
    drawn = t_s[~np.isnan(angle)]
    assert (drawn.min(), drawn.max()) == (1.0, 1.49)
    solid = [line for line in upper.lines if line.get_linestyle() == "-"]
    assert len(solid) == 6
    t_s, angle = solid[2].get_xydata().T
    assert not ((t_s[~np.isnan(angle)] >= 1.0) & (t_s[~np.isnan(angle)] < 1.5)).any()
    below = [line.get_xydata() for line in lower.lines if len(line.get_xydata()) > 2]
    assert len(below) == 6
    for k, line in enumerate(below):
        t_s, gap = line.T
        missing = t_s[np.isnan(gap)]
        assert len(missing) == (50 if k == 2 else 0)
        assert np.nanmax(np.abs(gap)) < 1e-9  # while it is down, it does not count


def test_headings_that_are_not_finite_are_drawn_as_gaps():
    odd = np.zeros((5, 6))
    odd[2, 0], odd[3, 1] = math.nan, math.inf
    run = recorded(scenario_of(), odd)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = headings(run, run.trajectories)
        figure.canvas.draw()
    assert np.isfinite(figure.axes[1].get_ylim()).all()


# --- graph.png ------------------------------------------------------------------------


def legend_of(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


@pytest.mark.parametrize(
    "wish", [{"robots": 12, "pattern": "wedge"}, {"robots": 20, "pattern": "grid"}, {"robots": 3}]
)
def test_the_damping_covers_no_robot(wish):
    figure = graph(
        recorded(
            scenario_of(
                *(f"robots.{k}.damping={1.0 + k / 10}" for k in range(1, wish["robots"] + 1)),
                **wish,
            ),
            seconds=1,
        )
    )
    figure.canvas.draw()
    axes = figure.axes[0]
    said = [text for text in axes.texts if text.get_text().startswith("μ")]
    assert len(said) == wish["robots"]
    frame = axes.get_window_extent()
    for text in said:
        box = text.get_window_extent()
        assert frame.x0 < box.x0
        assert box.x1 < frame.x1
        assert frame.y0 < box.y0
        assert box.y1 < frame.y1
    for node in (line for line in axes.lines if line.get_marker() == "o"):
        centre = axes.transData.transform(node.get_xydata()[0])
        radius = 0.5 * node.get_markersize() * figure.dpi / 72.0
        for text in said:
            box = text.get_window_extent()
            nearest = np.clip(centre, [box.x0, box.y0], [box.x1, box.y1])
            assert np.linalg.norm(nearest - centre) > radius


def test_one_damping_for_all_is_said_once():
    figure = graph(
        recorded(
            scenario_of(
                *(f"robots.{k}.damping=1.5" for k in (2, 4)),
                *(f"robots.{k}.damping=0.0" for k in (1, 3, 5, 6)),
            )
        )
    )
    assert not [text for text in figure.axes[0].texts if text.get_text().startswith("μ")]
    assert "damped: μ = 1.5" in legend_of(figure)


def test_without_marks_there_is_no_legend():
    undamped = [f"robots.{k}.damping=0.0" for k in range(1, 7)]
    assert graph(recorded(scenario_of(*undamped))).legends == []


HAPPENED = """timeline=[
    {at_s=1.0, action="kill", robots=1},
    {at_s=1.0, action="pause", robots=2, resume_after_s=0.5},
    {at_s=9.0, action="kill", robots=6},
    {at_s=0.5, action="cut", links=[[1, 2], [2, 1]], heal_after_s=1.0},
    {at_s=0.5, action="cut", links=[[3, 2]], heal_after_s=1.0},
    {at_s=2.0, action="cut", links=[[3, 4], [4, 3]]},
    {at_s=0.2, action="cut", links=[[4, 5]], heal_after_s=0.1},
    {at_s=2.0, action="cut", links=[[5, 4]]},
    {at_s=9.0, action="cut", links=[[5, 6], [6, 5]]},
]""".replace("\n", "")


def test_what_befell_robots_and_links_is_marked_and_said():
    run = recorded(scenario_of(HAPPENED, "robots.1.damping=0.0"))
    tick = 10**9 // run.scenario.clock.control_period_ns
    run(Lost(10**9, 3, "gone", tick))
    end_ns = 3 * 10**9
    found = {edge: tuple(cuts(run.scenario, edge, end_ns)) for edge in run.scenario.formation.edges}
    assert found == {
        (1, 2): ([], [(1, 2), (2, 1)]),
        (2, 3): ([], [(3, 2)]),
        (3, 4): ([(3, 4), (4, 3)], []),
        (4, 5): ([(5, 4)], [(4, 5)]),
        (5, 6): ([], []),
        (1, 6): ([], []),
    }
    figure = graph(run)
    axes = figure.axes[0]
    said = legend_of(figure)
    assert "grey, crossed out: killed or lost, and down at the end" in said
    assert "crossed out: paused, and up again at the end" in said
    assert {"link cut at the end", "link was cut, and healed", "arrow: cut this way only"} <= set(
        said
    )
    crossed = {tuple(x.get_xydata()[0]) for x in axes.lines if x.get_marker() == "x"}
    assert crossed == {tuple(run.scenario.offsets_m[k]) for k in (0, 1, 2)}
    looks = [line.get_linestyle() for line in axes.lines if line.get_marker() == "None"]
    dashed = dict(zip(run.scenario.formation.edges, looks, strict=True))
    assert {edge for edge, look in dashed.items() if look == "--"} == {
        (1, 2),
        (2, 3),
        (3, 4),
        (4, 5),
    }
    places = dict(zip(run.scenario.ids, run.scenario.offsets_m, strict=True))
    arrows = [item for item in axes.texts if item.arrow_patch is not None]
    assert len(arrows) == 2
    for (source, destination), arrow in zip([(3, 2), (5, 4)], arrows, strict=True):
        along = places[destination] - places[source]
        assert (np.array(arrow.xy) - arrow.xyann) @ along > 0.0  # its head is at the receiver


# --- deliveries.png -------------------------------------------------------------------


def delivered(delays_ms):
    """The heights of the messages of links with these delays (None: lost), by band; the axes."""
    scenario = scenario_of(robots=3)
    run = Collected(scenario)
    links = scenario.directed_links[: len(delays_ms)]
    run(
        LinkRows(
            [
                LinkRow(
                    k * 10**7,
                    None if ms is None else k * 10**7 + int(ms * 1e6),
                    *link,
                    k,
                    "lost: random" if ms is None else "delivered",
                )
                for link, row in zip(links, delays_ms, strict=True)
                for k, ms in enumerate(row)
            ]
        )
    )
    run(Outcome("completed", 10**8, None, ""))
    axes = link_figures.of(run)["deliveries"]().axes[0]
    heights = np.concatenate(
        [line.get_ydata() for line in axes.lines if line.get_marker() in (".", "|")]
    )
    return axes, {band: [h for h in heights if round(-h) == band] for band in range(len(links))}


def test_a_constant_delay_is_in_the_middle_of_its_band_beside_its_label():
    axes, heights = delivered([[100.0] * 4, [10.0, 60.0, 100.0], [20.0, None, 20.0]])
    assert axes.get_yticks().tolist() == [0.0, -1.0, -2.0]
    assert heights[0] == [0.0] * 4
    assert sorted(heights[2])[1:] == [-2.0] * 2
    (named,) = axes.child_axes
    assert [label.get_text() for label in named.get_yticklabels()] == ["100 ms", "20 ms"]


@pytest.mark.long
@given(
    st.lists(
        st.lists(st.none() | st.floats(0.0, 1e4), min_size=1, max_size=6), min_size=1, max_size=6
    )
)
def test_no_message_leaves_the_band_of_its_link(delays_ms):
    _, heights = delivered(delays_ms)
    for band, row in enumerate(delays_ms):
        assert len(heights[band]) == len(row)
        assert all(abs(height + band) <= 0.42 for height in heights[band])
