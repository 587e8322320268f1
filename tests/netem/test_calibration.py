"""Correlated delays are correlated as asked, within 0.005, or refused, whatever the distribution.

What a ρ gives is worked out here in other ways than in the code: bivariate normal probabilities
by integrating over one of the two scores, sums over a grid of pairs, and draws of pairs.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from formnet.formation.scenario.loading import ScenarioError, loads
from formnet.netem import Change, LinkSettings, RandomDelay, Timeline, UniformDelay
from formnet.netem.delays import calibration
from formnet.netem.delays import distributions as d
from formnet.netem.settings.links import SettingError
from formnet.netem.settings.presets import PRESETS

PROMISED = 0.005
WANTED = [0.1, 0.5, 0.8, 0.95, 0.99, 0.999]
SEED = 4711


def rho_of(delay):
    return delay._copula.rho


def both_above(a, b, rho):
    """P(z > a, z' > b): by the conditional probability, in pieces about where that changes."""
    spread = math.sqrt((1.0 - rho) * (1.0 + rho))

    def given_x(x):
        return stats.norm.pdf(x) * 0.5 * math.erfc((b - rho * x) / spread / math.sqrt(2.0))

    steps = np.array([-40.0, -8.0, -3.0, -1.0, 0.0, 1.0, 3.0, 8.0, 40.0]) * spread / rho
    cuts = sorted(
        {min(max(a, float(b / rho + step)), 12.0) for step in [*steps, -math.inf, math.inf]}
    )
    return sum(
        integrate.quad(given_x, low, high, epsabs=1e-13, epsrel=1e-11)[0]
        for low, high in pairwise(cuts)
    )


def correlation_of_values(values, shares, rho):
    """Lag-1 correlation of ``values`` (ascending) that each come with one of ``shares``."""
    values, shares = np.array(values), np.array(shares)
    mean = shares @ values
    variance = shares @ (values - mean) ** 2
    above = [float(shares[k:].sum()) for k in range(1, len(values))]
    scores = [float(stats.norm.isf(p)) for p in above]
    rises = np.diff(values)
    covariance = sum(
        rises[i] * rises[j] * (both_above(scores[i], scores[j], rho) - above[i] * above[j])
        for i in range(len(rises))
        for j in range(len(rises))
    )
    return covariance / variance


def correlation_on_a_grid(quantile, rho, lowest=-9.0):
    """The same of a distribution by sums over 2501² pairs of normal scores from ``lowest`` to 9."""
    scores, step = np.linspace(lowest, 9.0, 2501, retstep=True)
    values = np.array(
        [
            quantile(min(max(0.5 * math.erfc(-z / math.sqrt(2.0)), 2.0**-54), 1.0 - 2.0**-53))
            for z in scores
        ]
    )
    values = values / values.max()
    weights = stats.norm.pdf(scores) * step
    spread = math.sqrt(1.0 - rho * rho)
    apart = (scores[None, :] - rho * scores[:, None]) / spread
    density = np.exp(-0.5 * apart * apart) / (spread * math.sqrt(2.0 * math.pi))
    after = density @ values * step
    mean = weights @ values
    return float(((weights * values) @ after - mean**2) / (weights @ values**2 - mean**2))


# --- jumps --------------------------------------------------------------------------------


@pytest.mark.parametrize("wanted", WANTED)
@pytest.mark.parametrize(("low", "high"), [(1, 1), (2, 1), (9, 1), (99, 1), (999, 1), (1, 19)])
def test_two_values_against_the_bivariate_normal(low, high, wanted):
    delay = RandomDelay(d.Empirical([0.02] * low + [0.2] * high), correlation=wanted)
    share = high / (low + high)
    found = correlation_of_values([0.02, 0.2], [1 - share, share], rho_of(delay))
    assert found == pytest.approx(wanted, abs=PROMISED)


@pytest.mark.parametrize("wanted", WANTED)
def test_equal_shares_of_two_values_against_the_closed_form(wanted):
    """Sheppard 1899: corr = (2/π) asin ρ. To the nanosecond, so also for a uniform range of two."""
    for delay in (
        RandomDelay(d.Empirical([0.1, 0.3]), correlation=wanted),
        UniformDelay(7, 8, wanted),
    ):
        assert 2.0 / math.pi * math.asin(rho_of(delay)) == pytest.approx(wanted, abs=PROMISED)


@given(
    st.dictionaries(st.integers(1, 1000), st.integers(1, 40), min_size=2, max_size=4),
    st.floats(0.02, 0.9995),
)
def test_few_values_against_the_bivariate_normal(times_by_ms, wanted):
    values = sorted(times_by_ms)
    samples = [ms / 1000 for ms in values for _ in range(times_by_ms[ms])]
    delay = RandomDelay(d.Empirical(samples), correlation=wanted)
    shares = [times_by_ms[ms] / len(samples) for ms in values]
    found = correlation_of_values(values, shares, rho_of(delay))
    assert found == pytest.approx(wanted, abs=PROMISED)


@pytest.mark.parametrize("wanted", [0.1, 0.5, 0.8, 0.99])
@pytest.mark.parametrize("count", [2, 3, 6])
def test_a_uniform_range_of_few_nanoseconds_against_the_bivariate_normal(count, wanted):
    delay = UniformDelay(50, 49 + count, wanted)
    found = correlation_of_values(range(count), [1 / count] * count, rho_of(delay))
    assert found == pytest.approx(wanted, abs=PROMISED)


@pytest.mark.parametrize("wanted", [0.1, 0.5, 0.8, 0.99])
def test_what_is_drawn_is_whole_nanoseconds(wanted):
    """An exponential delay of 0.3 ns on average is 0, 1, 2, ... ns, nearly always 0."""
    delay = RandomDelay(d.Exponential(0.3e-9), offset_s=0.5, correlation=wanted)
    most = 9
    above = [1.0, *(math.exp(-(k + 0.5) / 0.3) for k in range(most)), 0.0]
    shares = [a - b for a, b in pairwise(above)]
    found = correlation_of_values(range(most + 1), shares, rho_of(delay))
    assert found == pytest.approx(wanted, abs=PROMISED)


MIXED = {
    "one late in ten": [0.02] * 9 + [0.2],
    "five": [0.01, 0.02, 0.03, 0.04, 0.05],
    "two bumps": [0.01 + k * 1e-5 for k in range(500)] + [0.3 + k * 1e-5 for k in range(100)],
    "one outlier in a thousand": [0.01 + k * 1e-6 for k in range(999)] + [0.5],
}


@pytest.mark.parametrize("wanted", WANTED)
def test_an_outlier_is_as_good_as_the_only_other_value(wanted):
    """The rest of the samples has 4e-7 of the variance."""
    delay = RandomDelay(d.Empirical(MIXED["one outlier in a thousand"]), correlation=wanted)
    found = correlation_of_values([0.0105, 0.5], [0.999, 0.001], rho_of(delay))
    assert found == pytest.approx(wanted, abs=PROMISED)


@pytest.mark.long
@pytest.mark.parametrize("wanted", [0.1, 0.5, 0.8, 0.99])
@pytest.mark.parametrize("name", ["one late in ten", "five", "two bumps"])
def test_samples_against_draws_of_pairs(name, wanted):
    """Two million independent pairs; within 0.005 and four standard errors, of 200 batches."""
    samples = np.array(sorted(MIXED[name]))
    rho = rho_of(RandomDelay(d.Empirical(MIXED[name]), correlation=wanted))
    random = np.random.default_rng(SEED)
    z, noise = random.standard_normal((2, 200, 10_000))
    pairs = []
    for scores in (z, rho * z + math.sqrt(1.0 - rho * rho) * noise):
        index = (stats.norm.cdf(scores) * len(samples)).astype(int)
        pairs.append(samples[np.minimum(index, len(samples) - 1)])
    mean, variance = samples.mean(), samples.var()
    batches = ((pairs[0] - mean) * (pairs[1] - mean)).mean(axis=1) / variance
    error = batches.std(ddof=1) / math.sqrt(len(batches))
    assert error < 0.003, SEED  # it says something
    assert abs(batches.mean() - wanted) < PROMISED + 4 * error, (SEED, batches.mean(), error)


# --- all others -----------------------------------------------------------------------------

SMOOTH = {
    "normal": d.Normal(0.05, 0.01),
    "normal, nearly all of it cut off": d.Normal(1e-3, 1.0),
    "lognormal": d.LogNormal(0.03, 0.03),
    "lognormal, heavy": d.LogNormal(0.01, 0.1),
    "lognormal, as heavy as it gets": d.LogNormal(1e-6, 1e3),
    "gamma": d.Gamma(0.05, 0.02),
    "gamma, a kink": d.Gamma(0.01, 0.2),
    "gamma, of the smallest shape": d.Gamma(0.01, 1.0),
    "weibull": d.Weibull(0.05, 1.5),
    "weibull, heavy": d.Weibull(0.01, 0.3),
    "weibull, of the smallest shape": d.Weibull(0.01, 0.1),
    "weibull, nearly constant": d.Weibull(0.01, 100.0),
    "pareto": d.Pareto(0.02, 5.0),
    "pareto, heavy": d.Pareto(0.02, 2.1),
    "exponential": d.Exponential(0.05),
}
ALL_IN_THE_TAIL = {"lognormal, as heavy as it gets"}  # all but 1e-9 of the variance


@pytest.mark.long
@pytest.mark.parametrize("name", SMOOTH)
def test_distributions_against_a_grid_of_pairs(name):
    law = SMOOTH[name]
    for wanted in (0.1, 0.5, 0.8, 0.95, 0.99):
        rho = rho_of(RandomDelay(law, correlation=wanted))
        lowest = 4.0 if name in ALL_IN_THE_TAIL else -9.0
        found = correlation_on_a_grid(law.quantile, rho, lowest)
        assert found == pytest.approx(wanted, abs=PROMISED)


@pytest.mark.parametrize("wanted", [0.999, 0.9999999, 1.0 - 2.0**-53])
@pytest.mark.parametrize("name", [*SMOOTH, *MIXED])
def test_nearly_one_can_be_had(name, wanted):
    law = SMOOTH[name] if name in SMOOTH else d.Empirical(MIXED[name])
    rho = rho_of(RandomDelay(law, correlation=wanted))
    assert 0.999 < rho < 1.0


def test_the_presets_have_the_copula_that_recorded_runs_were_drawn_from():
    """Another last bit would silently change every seeded scenario that uses them."""
    found = {}
    for name in PRESETS:
        for stage in LinkSettings.model_validate({"preset": name}).impairments():
            copula = getattr(stage, "_copula", None)
            if copula is not None:
                found[name] = copula.rho
    assert found == {"wifi": 0.3219280948876736, "wifi-congested": 0.5849625007215771}


# --- no variance --------------------------------------------------------------------------------


class Mine:
    """A distribution of one's own, which counts how often it is asked."""

    def __init__(self, *values):
        self.values = values
        self.asked = 0

    def quantile(self, u):
        self.asked += 1
        return self.values[int(u * len(self.values))]


@pytest.mark.parametrize(
    "make",
    [
        lambda: RandomDelay(d.Empirical([0.1, 0.1]), correlation=0.5),
        lambda: RandomDelay(d.Empirical([0.1, 0.1 + 1e-11]), correlation=0.5),
        lambda: RandomDelay(Mine(0.3, 0.3), correlation=0.5),
        lambda: UniformDelay(5, 5, 0.5),
    ],
)
def test_a_correlation_of_what_is_always_the_same_is_refused(make):
    with pytest.raises(ValueError, match="all delays are the same, so a correlation means nothing"):
        make()


SAME = [
    'distribution = "empirical", samples_s = [0.1, 0.1], correlation = 0.5',
    'distribution = "uniform", low_s = 0.1, high_s = 0.1, correlation = 0.5',
    'distribution = "normal", mean_s = 1e-9, stddev_s = 1e-9, offset_s = 1.0, correlation = 0.5',
]


@pytest.mark.parametrize(
    ("table", "words"),
    [(SAME[0], "all delays are the same"), (SAME[1], "all delays are the same"), (SAME[2], None)],
)
def test_a_scenario_says_so_when_it_is_checked(root, table, words):
    text = (root / "configs" / "paper" / "theorem2.toml").read_text(encoding="utf-8")
    text += f'\n[[network.links]]\nfrom = 2\nto = "*"\ndelay = {{ {table} }}\n'
    if words is None:
        loads(text)
        return
    with pytest.raises(ScenarioError, match=rf"network.links\[0\].delay.*{words}"):
        loads(text)


def test_a_change_that_takes_the_variance_away_is_refused_and_changes_nothing():
    table = {"delay": {"distribution": "uniform", "low_s": 0.1, "high_s": 0.2, "correlation": 0.5}}
    before = LinkSettings.model_validate(table)
    timeline = Timeline(before, link=before.link(seed=1, source=1, destination=2))
    with pytest.raises(SettingError, match=r"delay = .*all delays are the same"):
        timeline.do(0, Change({"delay.high_s": 0.1}))
    assert timeline.settings == before


# --- once ---------------------------------------------------------------------------------------


def test_a_twin_is_not_calibrated_again():
    law = Mine(0.1, 0.2, 0.4)
    delay = RandomDelay(law, correlation=0.7)
    asked = law.asked
    assert rho_of(delay.twin()) == rho_of(delay)
    assert law.asked == asked


def test_equal_settings_are_calibrated_once():
    def calibrations():
        return calibration._remembered.cache_info().misses

    for table in (
        {"distribution": "empirical", "samples_s": [0.0123, 0.0456, 0.0123]},
        {"distribution": "gamma", "mean_s": 0.0123, "stddev_s": 0.00456},
    ):
        before = calibrations()
        delay = table | {"correlation": 0.625}
        for _ in range(3):
            link = LinkSettings.model_validate({"delay": delay, "duplicate": {"probability": 0.5}})
            link.link(seed=1, source=1, destination=2)
        assert calibrations() == before + 1
        LinkSettings.model_validate({"delay": delay | {"correlation": 0.626}})
        assert calibrations() == before + 2


def test_distributions_are_equal_if_their_numbers_and_kinds_are():
    assert d.Gamma(0.1, 0.2) == d.Gamma(0.1, 0.2)
    assert hash(d.Gamma(0.1, 0.2)) == hash(d.Gamma(0.1, 0.2))
    assert d.Empirical([2.0, 1.0]) == d.Empirical([1.0, 2.0])
    kinds = [d.Normal, d.LogNormal, d.Gamma, d.Weibull, d.Pareto]
    laws = [make(a, b) for make in kinds for a in (1.0, 2.0) for b in (3.0, 4.0)]
    laws += [d.Exponential(1.0), d.Exponential(2.0), d.Empirical([1.0, 3.0]), d.Empirical([1.0])]
    assert len(set(laws)) == len(laws)
