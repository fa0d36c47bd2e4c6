"""EXP-12: times of goals that not every run reached, and ranks out of them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from usarsim_exploration.reporting.ranking import rank
from usarsim_exploration.reporting.survival import (
    Time,
    band,
    common_horizon,
    interval,
    kaplan_meier,
    log_rank,
    median,
    restricted_mean,
)

NEVER = Time(math.inf, reached=False)
HAND = [Time(2), Time(4, reached=False), Time(5), Time(8)]


def test_curve_and_mean_by_hand() -> None:
    """EXP-12: after a run that was stopped at 4, two are at risk, and each falls by half."""
    steps, shares = kaplan_meier(HAND)
    assert steps.tolist() == [0, 2, 5, 8]
    assert shares.tolist() == pytest.approx([1, 3 / 4, 3 / 8, 0])
    assert restricted_mean(HAND, 8) == pytest.approx(2 + 3 * 3 / 4 + 3 * 3 / 8)
    assert restricted_mean(HAND, 6) == pytest.approx(2 + 3 * 3 / 4 + 1 * 3 / 8)
    assert median(HAND) == 5


def test_a_stopped_run_is_not_its_last_step() -> None:
    """EXP-12: the limit value would give 4.75, leaving the run out 5; what never comes counts."""
    assert restricted_mean(HAND, 8) > 5
    never = [Time(2), NEVER, Time(5), Time(8)]
    assert restricted_mean(never, 8) == pytest.approx((2 + 8 + 5 + 8) / 4)
    assert median([Time(2), NEVER, NEVER]) is None
    assert common_horizon([HAND, [Time(3), Time(6, reached=False)]], 100) == 6
    assert common_horizon([HAND, never], 100) == 100


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 9), st.booleans()), min_size=1, max_size=12))
def test_curves_are_those_of_scipy(values: list[tuple[int, bool]]) -> None:
    """The same shares after every event as `scipy.stats.ecdf`."""
    steps, shares = kaplan_meier([Time(*one) for one in values])
    at, reached = zip(*values, strict=True)
    data = stats.CensoredData.right_censored(at, np.logical_not(reached))
    assert shares == pytest.approx(stats.ecdf(data).sf.evaluate(steps))


def test_intervals_cover() -> None:
    """Intervals of the mean hold the true one about as often as they say."""
    random = np.random.default_rng(1)
    true = 20 * (1 - math.exp(-30 / 20))
    held = 0
    for _ in range(60):
        drawn, stopped = random.exponential(20, 25), random.uniform(20, 80, 25)
        times = [Time(min(a, b), bool(a < b)) for a, b in zip(drawn, stopped, strict=True)]
        found = interval(times, 30)
        assert found is not None
        held += found.low <= true <= found.high
    assert held >= 50
    assert interval([Time(3)] * 5, 30) is None
    low, high = band(np.tile([1.0, 2.0], (4, 1)))
    assert low.tolist() == high.tolist() == pytest.approx([1.0, 2.0])


def test_two_groups() -> None:
    """Equal ones do not differ; those of which one is always earlier do."""
    late = [Time(one.at + 20, one.reached) for one in HAND * 3]
    assert log_rank(HAND * 3, HAND * 3, 50) == pytest.approx(1)
    assert (log_rank(HAND * 3, late, 50) or 1) < 0.001
    assert log_rank([NEVER] * 3, [NEVER] * 3, 50) is None


def test_ranks() -> None:
    """Fast before slow; a run that was stopped before the other's goal is no loser."""
    results = {
        "slow": {seed: Time(50 + seed) for seed in range(12)},
        "fast": {seed: Time(30 + seed) for seed in range(12)},
        "lost": dict.fromkeys(range(12), NEVER),
    }
    found = rank(results)
    assert found is not None
    assert found.ranks == {"fast": 1, "slow": 2, "lost": 3}
    assert found.blocks == 12
    assert found.friedman is not None
    assert found.friedman.p < 0.001
    # Demsar's q of three is 2.343
    assert found.difference == pytest.approx(2.343 * math.sqrt(3 * 4 / (6 * 12)), abs=1e-3)
    assert found.alike() == []
    first = found.pairs[0]
    assert (first.first, first.second, first.wins, first.losses) == ("fast", "slow", 12, 0)
    assert first.p == pytest.approx(2 / 2**12)
    assert first.holm == pytest.approx(3 * first.p)
    results["slow"] = dict.fromkeys(range(12), Time(20, reached=False))
    found = rank(results)
    assert found is not None
    assert [(one.wins, one.losses, one.ties) for one in found.pairs] == [
        (0, 0, 12),
        (12, 0, 0),
        (0, 0, 12),
    ]
    few = rank({name: dict(list(times.items())[:6]) for name, times in results.items()})
    assert few is not None
    assert few.alike() == [("fast", "slow"), ("slow", "lost")]
    assert rank({"alone": {1: Time(3)}}) is None
    assert rank({"one": {1: Time(3)}, "other": {2: Time(3)}}) is None
