"""Scenario files: every mistake is found and named; good ones survive a round trip."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from formnet.formation.scenario.loading import ScenarioError, dumps, load, loads
from formnet.lab.cli import main
from formnet.netem.settings.presets import PRESETS

PAPER = Path(__file__).parents[2] / "configs" / "paper"
GOOD = (PAPER / "section5-delay.toml").read_text(encoding="utf-8")


def problems(text: str, *overrides: str) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        loads(text, "file.toml", overrides)
    return [str(problem) for problem in caught.value.problems]


# What is changed in a good file (old, new), and what must be said about it.
BAD = {
    "unknown key": (
        "beta = 10.0",
        "betta = 10.0",
        "law.betta = 10.0: unknown key; did you mean 'beta'?",
    ),
    "unknown table": (
        "[clock]",
        "[clokc]",
        "clokc = {'mode': 'lockstep', 'control_period_s': 0.001, 'broadcas...: "
        "unknown key; did you mean 'clock'?",
    ),
    "unknown key in a union": (
        "mean_s = 0.1",
        "men_s = 0.1",
        "network.default.delay.men_s = 0.1: unknown key; did you mean 'mean_s'?",
    ),
    "nothing near": (
        "seed = 1",
        "zzz = 1",
        "zzz = 1: unknown key; valid keys here: clock, description, "
        "duration_s, expect, format, formation, hosts, law, name, neighbours, network, plant, robot_defaults, robots, "
        "run, seed, timeline",
    ),
    "missing key": ('name = "section5-delay"', "", "name: is required"),
    "missing in a robot": (
        "offset_m = [4.0, 0.0]\n",
        "",
        "robots[4].offset_m: is required (robot 5)",
    ),
    "text for a number": ("beta = 10.0", 'beta = "ten"', "law.beta = 'ten': must be a number"),
    "text for seconds": (
        "duration_s = 40.0",
        'duration_s = "50ms"',
        "duration_s = '50ms': must be a number, of seconds",
    ),
    "number for a text": ('name = "section5-delay"', "name = 5", "name = 5: must be a string"),
    "truth for a number": ("gamma = 0.1", "gamma = true", "law.gamma = true: must be a number"),
    "fraction for an id": (
        "id = 5",
        "id = 5.5",
        "robots[4].id = 5.5: must be a whole number (robot 5.5)",
    ),
    "text for a truth": (
        "centroid = true ",
        'centroid = "yes" ',
        "expect.centroid = 'yes': must be true or false",
    ),
    "number for a table": (
        "start = { x_m = 12.1, y_m = 37.0, heading_rad = -2.0 }",
        "start = 3",
        "robots[4].start = 3: must be a table (robot 5)",
    ),
    "not one of the words": (
        'level = "dynamic"',
        'level = "dynamik"',
        "law.level = 'dynamik': must be 'kinematic' or 'dynamic'; did you mean 'dynamic'?",
    ),
    "unknown distribution": (
        '"constant"',
        '"gauss"',
        "network.default.delay.distribution = 'gauss': "
        "must be one of 'constant', 'uniform', 'normal', 'lognormal', 'gamma', 'weibull', 'pareto', 'exponential', 'empirical', 'trace'",
    ),
    "unknown preset": (
        'delay = { distribution = "constant", mean_s = 0.1 }',
        'preset = "wify"',
        "network.default.preset = 'wify': "
        "must be one of 'ideal', 'lan', 'wifi', 'wifi-congested', 'lte', 'satellite', 'robot-link'; did you mean 'wifi'?",
    ),
    "negative mass": (
        "mass_kg = 1.0",
        "mass_kg = -1.0",
        "robot_defaults.mass_kg = -1.0: must be greater than 0",
    ),
    "negative damping": (
        "damping = 4.0",
        "damping = -4.0",
        "robots[0].damping = -4.0: must be at least 0 (robot 1)",
    ),
    "not finite": ("gamma = 0.1", "gamma = inf", "law.gamma = inf: must be finite"),
    "pair too long": (
        "offset_m = [4.0, 0.0]",
        "offset_m = [4.0, 0.0, 1.0]",
        "robots[4].offset_m = [4.0, 0.0, 1.0]: must have exactly 2 items (robot 5)",
    ),
    "edge to a missing robot": (
        "[5, 1]]",
        "[5, 9]]",
        "formation.edges[4]: robot 9 does not exist (robots: 1, 2, 3, 4, 5)",
    ),
    "edge to itself": (
        "[5, 1]]",
        "[5, 5]]",
        "formation.edges[4] = [5, 5]: connects a robot to itself",
    ),
    "edge twice": (
        "[5, 1]]",
        "[2, 1]]",
        "formation.edges[4] = [2, 1]: repeats formation.edges[0]; edges are undirected",
    ),
    "id twice": (
        "[expect]",
        "[[robots]]\nid = 2\noffset_m = [0.0, 0.0]\nstart = { x_m = 0.0, y_m = 0.0 }\n[expect]",
        "robots[5].id = 2: already used by robots[1]",
    ),
    "broadcast period": (
        "broadcast_period_s = 0.01",
        "broadcast_period_s = 0.0105",
        "clock.broadcast_period_s = 0.0105: must be a multiple of control_period_s = 0.001: times are whole nanoseconds, "
        "and 10500000 ns is not a multiple of 1000000 ns (nearest: 0.01 or 0.011)",
    ),
    "duration": (
        "duration_s = 40.0",
        "duration_s = 40.0005",
        "duration_s = 40.0005: must be a multiple of clock.control_period_s = 0.001: times are whole nanoseconds, "
        "and 40000500000 ns is not a multiple of 1000000 ns (nearest: 40.0 or 40.001)",
    ),
    "coupling misses an edge": (
        "coupling = 2.0",
        'coupling = { "1-2" = 2.0, "2-3" = 2.0, "3-4" = 2.0, "4-5" = 2.0 }',
        'formation.coupling."5-1": is required: a table needs one weight for every edge',
    ),
    "coupling of the wrong kind": (
        "coupling = 2.0",
        'coupling = "strong"',
        "formation.coupling = 'strong': must be a number",
    ),
    "negative coupling": (
        "coupling = 2.0",
        "coupling = -2.0",
        "formation.coupling = -2.0: must be greater than 0",
    ),
    "negative coupling of an edge": (
        "coupling = 2.0",
        'coupling = { "1-2" = -2.0, "2-3" = 2.0, "3-4" = 2.0, "4-5" = 2.0, "5-1" = 2.0 }',
        "formation.coupling.1-2 = -2.0: must be greater than 0",
    ),
    "pair too short": (
        "offset_m = [4.0, 0.0]",
        "offset_m = [4.0]",
        "robots[4].offset_m[1]: is required (robot 5)",
    ),
    "coupling of no edge": (
        "coupling = 2.0",
        'coupling = { "1-2" = 2.0, "2-3" = 2.0, "3-4" = 2.0, "4-5" = 2.0, '
        '"5-1" = 2.0, "1-3" = 1.0 }',
        'formation.coupling."1-3" = 1.0: is not an edge of formation.edges',
    ),
    "link from nowhere": (
        "[robot_defaults]",
        "[[network.links]]\nfrom = [7]\nto = [1]\n[robot_defaults]",
        "network.links[0].from: robot 7 does not exist (robots: 1, 2, 3, 4, 5)",
    ),
    "loss above one": (
        "[robot_defaults]",
        "[[network.links]]\nfrom = [1]\nto = [2]\n"
        'loss = { model = "random", probability = 1.5 }\n[robot_defaults]',
        "network.links[0].loss.probability = 1.5: must be at most 1",
    ),
    "empty range": (
        "[robot_defaults]",
        "[[network.links]]\nfrom = [1]\nto = [2]\n"
        'delay = { distribution = "uniform", low_s = 0.3, high_s = 0.1 }\n[robot_defaults]',
        "network.links[0].delay = {'distribution': 'uniform', 'low_s': 0.3, 'high_s': 0.1}: "
        "low_s = 0.3 must not exceed high_s = 0.1",
    ),
    "window too long": (
        "[expect]",
        "[expect]\nwindow_s = 50.0",
        "expect.window_s = 50.0: must not exceed duration_s = 40.0",
    ),
    "name no folder can have": (
        'name = "section5-delay"',
        'name = "../x"',
        "name = '../x': must start with a letter or digit; then letters, digits, . _ -",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_scenario_is_named(case):
    old, new, message = BAD[case]
    assert old in GOOD
    assert problems(GOOD.replace(old, new, 1)) == [message]


def test_60_hz_is_told_in_nanoseconds_with_the_nearest_values_that_would_do():
    """1/60 s is 16 666 667 ns: 5 of them are 83 333 335 ns and 6 are 100 000 002 ns."""
    text = GOOD.replace("control_period_s = 0.001", f"control_period_s = {1 / 60}").replace(
        "broadcast_period_s = 0.01", "broadcast_period_s = 0.1"
    )
    found = problems(text, "duration_s=1.0")
    assert found == [
        "clock.broadcast_period_s = 0.1: must be a multiple of control_period_s = "
        "0.016666666666666666: times are whole nanoseconds, and 100000000 ns is not a multiple of "
        "16666667 ns (nearest: 0.083333335 or 0.100000002)",
        "duration_s = 1.0: must be a multiple of clock.control_period_s = "
        "0.016666666666666666: times are whole nanoseconds, and 1000000000 ns is not a multiple of "
        "16666667 ns (nearest: 0.983333353 or 1.00000002)",
    ]
    loads(text, "f", ["clock.broadcast_period_s=0.100000002", "duration_s=0.983333353"])
    loads(text, "f", ["clock.broadcast_period_s=0.083333335", "duration_s=1.00000002"])


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("duration_s=1e300", "duration_s = 1e+300: must be at most 1e+09"),
        (
            "clock.control_period_s=1e9",
            "clock.control_period_s = 1000000000.0: must be at most 3600",
        ),
        ("clock.broadcast_period_s=3601", "clock.broadcast_period_s = 3601: must be at most 3600"),
        ("clock.control_period_s=1e-10", "clock.control_period_s = 1e-10: must be at least 1e-09"),
        ("expect.window_s=1e300", "expect.window_s = 1e+300: must be at most 1e+09"),
        (
            "network.default.delay={distribution='trace', times_s=[0, 1e300], delays_s=[0, 1]}",
            "network.default.delay.times_s[1] = 1e+300: must be at most 1e+09",
        ),
        (
            "network.default.delay={distribution='trace', times_s=[0], delays_s=[1], period_s=1e10}",
            "network.default.delay.period_s = 10000000000.0: must be at most 1e+09",
        ),
    ],
)
def test_times_have_bounds(override, message):
    assert message in problems(GOOD, override)


def test_all_problems_are_reported_together():
    text = GOOD
    for case in (
        "unknown key",
        "not one of the words",
        "edge to a missing robot",
        "negative damping",
        "broadcast period",
        "missing in a robot",
    ):
        text = text.replace(*BAD[case][:2], 1)
    found = problems(text)
    for case in (
        "unknown key",
        "not one of the words",
        "edge to a missing robot",
        "negative damping",
        "broadcast period",
        "missing in a robot",
    ):
        assert BAD[case][2] in found
    assert len(found) == 6


def test_a_bad_edge_does_not_shift_the_others_places():
    found = problems(GOOD.replace("[[1, 2], ", '[["a", 2], ').replace("[5, 1]]", "[5, 9]]"))
    assert found == [
        "formation.edges[0][0] = 'a': must be a whole number",
        "formation.edges[4]: robot 9 does not exist (robots: 1, 2, 3, 4, 5)",
    ]


def test_not_toml():
    (found,) = problems("# one\nname = = 3")
    assert found.startswith("not TOML: ")
    assert found.endswith(": 'name = = 3'")


def test_not_text(tmp_path):
    path = tmp_path / "x.toml"
    path.write_bytes(b"name = \xff")
    with pytest.raises(ScenarioError, match=r"x\.toml: not TOML: not UTF-8 text \(byte 7\)"):
        load(path)


def test_no_such_file_and_a_folder(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read: No such file"):
        load(tmp_path / "none.toml")
    with pytest.raises(ScenarioError, match="cannot be read: it is no regular file"):
        load(tmp_path)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("beta", "--set beta: must read key.path=value, such as law.beta=5"),
        (
            "robots.9.damping=1",
            "--set robots.9: there is no '9' in this list (there: 1, 2, 3, 4, 5)",
        ),
        ("seed.x=1", "--set seed.x: seed is not a table"),
        ("law.betta=1", "law.betta = 1: unknown key; did you mean 'beta'?"),
        ("law.beta=ten", "law.beta = 'ten': must be a number"),
    ],
)
def test_bad_override_is_named(override, message):
    assert problems(GOOD, override) == [message]


def test_overrides_reach_tables_lists_and_robots_by_id():
    text = GOOD.replace("id = 5", "id = 50").replace("[4, 5], [5, 1]", "[4, 50], [50, 1]")
    scenario = loads(
        text,
        "f",
        [
            "law.beta=7.5",
            "robots.50.damping=1.5",
            "formation.edges.0=[1, 3]",
            "name=other",
            "network.default.loss.probability=0.25",
            "robots.50.start.x_m=-1",
        ],
    )
    assert scenario.law.beta == 7.5
    assert scenario.vehicles[50].damping == 1.5
    assert scenario.formation.edges[0] == (1, 3)
    assert scenario.name == "other"
    assert scenario.network.default.loss.probability == 0.25
    assert scenario.robots[4].start.x_m == -1.0


@pytest.mark.parametrize("path", sorted(PAPER.glob("*.toml")), ids=lambda p: p.stem)
def test_resolved_scenario_is_the_same_scenario(path):
    scenario = load(path)
    assert scenario.name == path.stem
    assert loads(dumps(scenario)) == scenario


def test_later_link_rules_win_and_change_only_what_they_name():
    rules = """
[[network.links]]
from = [1]
to = [2, 5]
delay = { distribution = "uniform", low_s = 0.05, high_s = 0.3 }
[[network.links]]
from = [1]
to = [2]
loss = { model = "random", probability = 0.5 }
[robot_defaults]"""
    network = loads(GOOD.replace("[robot_defaults]", rules)).network
    assert network.settings(1, 2).delay.distribution == "uniform"
    assert network.settings(1, 2).loss.probability == 0.5
    assert network.settings(1, 5).loss.probability == 0.0
    assert network.settings(2, 1) == network.default


# --- the command line ---------------------------------------------------------------------


def test_check_reports_numbers_and_theorem():
    result = CliRunner().invoke(main, ["check", str(PAPER / "section5-delay.toml")])
    assert result.exit_code == 0
    assert "λ₂(L)  2.764" in result.output
    assert "λ_min(L + diag μ)             0.4174" in result.output
    assert "β λ_min(½(D − A D⁻¹ A) + diag μ) = 1.6 is above 1/4" in result.output
    assert "Theorem 6, proved: " in result.output
    assert "dynamic level, constant delays, some μ > 0" in result.output


def test_check_warns_of_broken_assumptions():
    result = CliRunner().invoke(
        main,
        [
            "check",
            str(PAPER / "section5.toml"),
            "--set",
            "law.w1.bias=0",
            "--set",
            "formation.edges=[[1, 2], [3, 4]]",
        ],
    )
    assert result.exit_code == 0
    assert "warning: Assumption 1" in result.output
    assert "{1, 2}, {3, 4}, {5}" in result.output
    assert "warning: Assumption 2" in result.output


@pytest.mark.parametrize("command", ["run", "check", "nemesis"])
def test_an_option_that_is_a_key_of_scenarios_is_told_how(command):
    result = CliRunner().invoke(main, [command, "yard", "--mode", "realtime"])
    assert result.exit_code == 2
    said = (
        "No such option '--mode'. To change a value of the scenario, use --set, e.g. --set clock."
    )
    assert said in result.output
    near = CliRunner().invoke(main, [command, "yard", "--sett", "seed=1"]).output
    assert "Did you mean" in near
    assert "What stands" not in near


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["nemesis", "yard", "--limit", "1e300"], "--limit"),
        (["nemesis", "yard", "--limit", "nan"], "--limit"),
        (["plant", "yard", "--run", "x", "--start-patience", "inf"], "--start-patience"),
        (["plant", "yard", "--run", "x", "--lease", "nan"], "--lease"),
        (["replay", "x", "--speed", "nan"], "--speed"),
        (["new", "x", "--spacing", "nan"], "--spacing"),
    ],
)
def test_numbers_of_options_have_bounds_and_are_numbers(words, option):
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 2
    assert f"Invalid value for '{option}'" in result.output


@pytest.mark.parametrize("command", ["run", "check"])
def test_bad_scenario_exits_2_with_every_problem(command, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(GOOD.replace("beta = 10.0", "betta = 10.0").replace("[5, 1]]", "[5, 9]]"))
    result = CliRunner().invoke(main, [command, str(path)])
    assert result.exit_code == 2
    assert "law.betta = 10.0: unknown key; did you mean 'beta'?" in result.output
    assert "formation.edges[4]: robot 9 does not exist" in result.output
    assert "Traceback" not in result.output


def test_unknown_law_is_a_bad_scenario():
    result = CliRunner().invoke(
        main, ["check", str(PAPER / "section5.toml"), "--set", "law.kind=mine"]
    )
    assert result.exit_code == 2
    assert (
        "law.kind = 'mine': no law 'mine' is installed (installed: cooperative, leader_follower)"
        in result.output
    )


def test_existing_run_is_never_overwritten(tmp_path):
    (tmp_path / "precious").write_text("data")
    result = CliRunner().invoke(
        main, ["run", str(PAPER / "section5.toml"), "--inline", "--out", str(tmp_path)]
    )
    assert result.exit_code == 2
    assert "exists already" in result.output
    assert [p.name for p in tmp_path.iterdir()] == ["precious"]


def test_usage_errors_exit_2():
    assert CliRunner().invoke(main, ["run"]).exit_code == 2
    assert CliRunner().invoke(main, ["walk"]).exit_code == 2


def test_laws_and_version():
    assert "cooperative" in CliRunner().invoke(main, ["laws"]).output
    assert CliRunner().invoke(main, ["--version"]).output.startswith("formnet 0.3.0")


def delays_ms(rules):
    """The delay of every link of the ring 1-5 under ``rules``, as {(from, to): ms}."""
    tables = "".join(f"[[network.links]]\n{rule}\n" for rule in rules)
    scenario = loads(GOOD.replace("[robot_defaults]", tables + "[robot_defaults]", 1))
    assert loads(dumps(scenario)) == scenario
    return {
        link: round(scenario.network.settings(*link).delay.mean_s * 1e3)
        for link in scenario.directed_links
    }


def test_links_are_picked_by_id_list_or_star_one_way_or_both():
    delay = "delay={{distribution='constant', mean_s={}}}".format
    from_one = delays_ms(["from=1\nto='*'\n" + delay(0.2)])
    assert {link for link, ms in from_one.items() if ms == 200} == {(1, 2), (1, 5)}
    both = delays_ms(["from=1\nto=[2, 3]\nboth_ways=true\n" + delay(0.2)])
    assert {link for link, ms in both.items() if ms == 200} == {(1, 2), (2, 1)}
    later = delays_ms(["from='*'\nto='*'\n" + delay(0.2), "from=[2]\nto=3\n" + delay(0.3)])
    assert later[2, 3] == 300
    assert set(later.values()) == {200, 300}
    assert list(later.values()).count(300) == 1


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        ('from = "all"\nto = 1', "network.links[0].from = 'all': must be '*'"),
        ("from = 1.5\nto = 1", "network.links[0].from = 1.5: must be a list"),
        ("from = []\nto = 1", "network.links[0].from = []: needs 1 or more"),
        ("from = 1\nto = 9", "network.links[0].to: robot 9 does not exist (robots: 1, 2, 3, 4, 5)"),
        ("from = -1\nto = 1", "network.links[0].from = -1: must be at least 0"),
    ],
)
def test_bad_selector_is_named(rule, message):
    text = GOOD.replace("[robot_defaults]", f"[[network.links]]\n{rule}\n[robot_defaults]", 1)
    assert problems(text) == [message]


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_are_written_out_and_survive_a_round_trip(preset):
    scenario = loads(GOOD, overrides=[f'network.default={{preset="{preset}", keep_order=true}}'])
    assert scenario.network.default.keep_order
    assert loads(dumps(scenario)) == scenario
    assert "preset" not in dumps(scenario)


def test_files_are_looked_for_beside_the_scenario_and_their_numbers_written_out(tmp_path):
    (tmp_path / "rtt.csv").write_text("0.01\n0.02\n", encoding="utf-8")
    file = tmp_path / "scenario.toml"
    file.write_text(GOOD, encoding="utf-8")
    override = 'network.default.delay={distribution="empirical", file="rtt.csv"}'
    scenario = load(file, [override])
    assert scenario.network.default.delay.samples_s == [0.01, 0.02]
    assert loads(dumps(scenario)) == scenario
    # What comes over the bus must not make a robot read its files.
    assert problems(GOOD, override) == [
        "network.default.delay.file = 'rtt.csv': may only be named in a file; give the numbers"
    ]
