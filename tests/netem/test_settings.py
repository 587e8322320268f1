"""Settings of links: presets, every bad value refused by name, every good one usable."""

import math

import pytest
from complete_links import COMPLETE
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from formnet.netem import LinkSettings
from formnet.netem.files.problems import problems
from formnet.netem.files.tables import members
from formnet.netem.settings.delays import DelaySettings
from formnet.netem.settings.losses import LossSettings
from formnet.netem.settings.presets import PRESETS


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_links_and_a_base(name):
    base = LinkSettings.model_validate({"preset": name})
    assert base.link(seed=1, source=1, destination=2).send(0, 0, b"x")
    changed = LinkSettings.model_validate({"preset": name, "duplicate": {"probability": 0.5}})
    assert changed.duplicate.probability == 0.5
    assert changed.delay == base.delay
    assert name != "robot-link" or (
        base.rate.bits_per_s == 60_000_000
        and base.constant_ns is None
        and base.loss.probability == 0.0014
    )


BAD = {
    "delay": [
        ({"distribution": "normal", "mean_s": 0.0, "stddev_s": 0.1}, "mean_s"),
        ({"distribution": "lognormal", "mean_s": 0.1, "stddev_s": -1.0}, "stddev_s"),
        ({"distribution": "gamma", "mean_s": 0.1}, "stddev_s"),
        ({"distribution": "weibull", "scale_s": 0.1, "shape": 0.0}, "shape"),
        (
            {"distribution": "pareto", "minimum_s": 0.1, "shape": 2.0, "correlation": 0.5},
            "shape = 2",
        ),
        ({"distribution": "exponential", "mean_s": 0.1, "correlation": 1.0}, "correlation"),
        ({"distribution": "exponential", "mean_s": 0.1, "offset_s": -0.1}, "offset_s"),
        ({"distribution": "empirical", "samples_s": []}, "samples_s"),
        ({"distribution": "empirical", "samples_s": [0.1, -0.1]}, "samples_s"),
        ({"distribution": "empirical", "file": "nowhere.csv"}, "nowhere.csv"),
        ({"distribution": "trace", "times_s": [0.0, 0.0], "delays_s": [0.1, 0.1]}, "times_s"),
        ({"distribution": "trace", "times_s": [0.0], "delays_s": [0.1]}, "period_s"),
        ({"distribution": "trace", "times_s": [0.0, 1.0], "delays_s": [0.1]}, "delays_s"),
        (
            {
                "distribution": "trace",
                "times_s": [0.0, 1.0],
                "delays_s": [0.1, 0.2],
                "period_s": 1.0,
            },
            "period_s",
        ),
        ({"distribution": "uniform", "low_s": 0.2, "high_s": 0.1}, "low_s = 0.2"),
    ],
    "loss": [
        ({"probability": 1.5}, "probability"),
        ({"probability": 0.5, "correlation": 1.0}, "correlation"),
        ({"model": "gilbert_elliott", "p": -0.1}, "gilbert_elliott.p\n"),
        ({"model": "gilbert_elliott", "p": 0.1, "loss_in_bad": 2.0}, "loss_in_bad"),
        ({"model": "four_state", "p13": 0.6, "p14": 0.6}, "p13 + p14"),
        ({"model": "trace", "losses": [0, 2]}, "losses"),
        ({"model": "every_nth", "n": 0}, "every_nth.n\n"),
        ({"model": "bursty"}, "bursty"),
    ],
    "duplicate": [({"probability": -0.1}, "probability")],
    "corrupt": [({"probability": 1.1}, "probability")],
    "reorder": [({"probability": 0.1, "gap": 0}, "gap")],
    "rate": [({"bits_per_s": -1}, "bits_per_s"), ({"bits_per_s": 1.5}, "bits_per_s")],
    "queue": [({"messages": -1}, "messages"), ({"bytes": -1}, "bytes")],
    "slots": [({"min_s": 0.2, "max_s": 0.1}, "0.2"), ({"min_s": 0.0, "max_s": 0.1}, "min_s")],
    "keep_order": [("yes", "keep_order")],
    "playout_s": [(-1.0, "playout_s")],
    "preset": [("wlan", "must be one of 'ideal', 'lan'")],
}


@pytest.mark.parametrize(
    ("key", "value", "words"), [(key, *case) for key, cases in BAD.items() for case in cases]
)
def test_bad_settings_name_key_and_value(key, value, words):
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the text is checked below
        LinkSettings.model_validate({key: value})
    assert words in str(caught.value)
    assert key in str(caught.value)


def test_numbers_may_come_from_a_file(tmp_path):
    (tmp_path / "rtt.csv").write_text("delay_s\n0.001\n0.002\n")
    (tmp_path / "trace.csv").write_text("0,0.01\n1.5,0.02\n")
    (tmp_path / "loss.csv").write_text("0\n1\n")
    context = {"folder": str(tmp_path)}

    def validated(table):
        return LinkSettings.model_validate(table, context=context)

    delay = validated({"delay": {"distribution": "empirical", "file": "rtt.csv"}}).delay
    assert delay.samples_s == [0.001, 0.002]
    delay = validated({"delay": {"distribution": "trace", "file": "trace.csv"}}).delay
    assert (delay.times_s, delay.delays_s) == ([0.0, 1.5], [0.01, 0.02])
    assert validated({"loss": {"model": "trace", "file": "loss.csv"}}).loss.losses == [0, 1]
    (tmp_path / "rtt.csv").write_text("0.001\nfast\n")
    with pytest.raises(ValueError, match=r"rtt\.csv, line 2, column 1: must be a number"):
        validated({"delay": {"distribution": "empirical", "file": "rtt.csv"}})


# --- every parameter ------------------------------------------------------------------


def test_the_table_of_every_parameter_is_complete():
    assert {t["distribution"] for t in COMPLETE["delay"]} == {
        kind.model_fields["distribution"].annotation.__args__[0] for kind in members(DelaySettings)
    }
    assert {t["model"] for t in COMPLETE["loss"]} == {
        kind.model_fields["model"].annotation.__args__[0] for kind in members(LossSettings)
    }
    assert set(COMPLETE) == set(LinkSettings.model_fields) - {"keep_order", "playout_s"}
    for key, tables in COMPLETE.items():
        for table in tables:
            model = type(getattr(LinkSettings.model_validate({key: table}), key))
            assert set(table) == set(model.model_fields)


WRONG = [-1, math.nan, math.inf, -1e-9, 1e30, "much", None, True, [], {}]


def refusals():
    for key, tables in COMPLETE.items():
        for table in tables:
            for name in set(table) - {"distribution", "model"}:
                for wrong in WRONG:
                    yield key, table, name, wrong
    for wrong in WRONG:
        yield "playout_s", None, None, wrong


def test_every_bad_value_of_every_parameter_is_named_with_its_rule():
    unbounded = {"shape"}  # 1e30 is no bad value of it
    count = 0
    for key, table, name, wrong in refusals():
        data = {key: wrong if table is None else table | {name: wrong}}
        if (name in unbounded and wrong == 1e30) or (
            wrong is None and name in ("r", "p31", "period_s")
        ):
            if name == "shape":
                data[key]["correlation"] = 0.0  # nearly constant: it would mean nothing
            LinkSettings.model_validate(data)
            continue
        with pytest.raises(ValidationError) as caught:
            LinkSettings.model_validate(data)
        texts = [str(problem) for problem in problems(LinkSettings, data, caught.value)]
        place = key if name is None else f"{key}.{name}"
        shown = (
            {True: "true"}.get(wrong, repr(wrong))
            if not isinstance(wrong, list | dict)
            else repr(wrong)
        )
        assert any(text.startswith(f"{place} = {shown}: ") for text in texts), (data, texts)
        count += 1
    assert count > 400


def mixed(*cases):
    return st.sampled_from(cases)


seconds = mixed(0.0, 1e-12, 4.9e-10, 1e-9, 1.5e-9, 1e-6, 0.01, 1.0, 3600.0)
counts = mixed(0, 1, 7, 1500, 10**12)
shares = mixed(0.0, 1e-12, 0.5, 1.0)
correlations = mixed(0.0, 1e-9, 0.75, 0.999999)
VALUES = {
    "shape": mixed(0.1, 0.5, 1.0, 2.0001, 5.0, 1e9),
    "samples_s": st.lists(seconds, min_size=1, max_size=3),
    "times_s": st.lists(seconds, min_size=1, max_size=3).map(sorted),
    "delays_s": st.lists(seconds, min_size=1, max_size=3),
    "losses": st.lists(mixed(0, 1), min_size=1, max_size=3),
    "correlation": correlations,
    **dict.fromkeys(
        (
            "bits_per_s",
            "overhead_bytes",
            "cell_bytes",
            "cell_overhead_bytes",
            "messages",
            "bytes",
            "gap",
            "n",
        ),
        counts,
    ),
    **dict.fromkeys(
        ("probability", "p", "r", "loss_in_bad", "loss_in_good", "p13", "p31", "p32", "p23", "p14"),
        shares,
    ),
}


def extreme(table):
    return st.fixed_dictionaries(
        {
            name: st.just(value) if name in ("distribution", "model") else VALUES.get(name, seconds)
            for name, value in table.items()
        }
    )


@pytest.mark.long
@settings(max_examples=1500)
@given(
    st.fixed_dictionaries(
        {"delay": st.one_of([extreme(table) for table in COMPLETE["delay"]])},
        optional={
            key: st.one_of([extreme(table) for table in tables])
            for key, tables in COMPLETE.items()
            if key != "delay"
        }
        | {"keep_order": st.booleans(), "playout_s": seconds},
    ),
    st.lists(mixed(0, 1, 10**6, 10**13), min_size=20, max_size=20),
)
def test_every_setting_that_is_accepted_can_be_used(table, pauses_ns):
    """However extreme: a link in use must never break, or hang, on what was validated."""
    try:
        accepted = LinkSettings.model_validate(table)
    except ValidationError:
        return
    a_link, now_ns = accepted.link(seed=1, source=1, destination=2), 0
    for sequence, pause_ns in enumerate(pauses_ns):
        now_ns += pause_ns
        for copy in a_link.send(now_ns, sequence, b"x" * 50):
            assert copy.lost or copy.due_ns >= now_ns
    assert [accepted.delay.quantile_s(u) >= 0.0 for u in (1e-9, 0.5, 1.0 - 1e-9)] == [True] * 3
