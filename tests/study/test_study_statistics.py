"""Statistics against a second implementation, books, and themselves (HRI-13, HRI-14)."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from second_implementation import DEPRESSION, SLEEP, STORED, judged

from usarsim_report import statistics
from usarsim_report.statistics import (
    bca,
    holm,
    paired,
    rank_sum,
    several_paired,
    signed_rank,
    summary,
    unpaired,
)
from usarsim_server import cli
from usarsim_study.power import closed_form, needed, simulated

REFERENCE = json.loads(STORED.read_text(encoding="utf-8"))

ROUNDING = """
5.40 5.50 5.55  5.85 5.70 5.75  5.20 5.60 5.50  5.55 5.50 5.40  5.90 5.85 5.70  5.45 5.55 5.60
5.40 5.40 5.35  5.45 5.50 5.35  5.25 5.15 5.00  5.85 5.80 5.70  5.25 5.20 5.10  5.65 5.55 5.45
5.60 5.35 5.45  5.05 5.00 4.95  5.50 5.50 5.40  5.45 5.55 5.50  5.55 5.55 5.35  5.45 5.50 5.55
5.50 5.45 5.25  5.65 5.60 5.40  5.70 5.65 5.55  6.30 6.30 6.25
"""
"""Times to round first base in three ways: Hollander and Wolfe (1973), table 7.1."""


def numbers(rows: list[list[str]]) -> list[list[float]]:
    """Rows of texts as numbers."""
    return [[float(one) for one in row] for row in rows]


class TestReference:
    """HRI-13."""

    def test_thirty_sets(self) -> None:
        """As many as were asked for, of every kind."""
        assert len(REFERENCE) == 30
        assert {one["kind"] for one in REFERENCE} == {
            *("paired", "unpaired", "several_paired", "several_unpaired"),
        }

    @pytest.mark.parametrize("place", range(30))
    def test_equals_stored_values(self, place: int) -> None:
        """P and effect sizes to 1e-6, and the stored values are what enumeration gives (HRI-13)."""
        row = REFERENCE[place]
        stored = row["values"]
        assert judged(row["kind"], row["data"]) == pytest.approx(stored, rel=1e-12)
        data = numbers(row["data"])
        judge = getattr(statistics, row["kind"])
        found = judge(*data) if row["kind"] in ("paired", "unpaired") else judge(data)
        for name, value in stored.items():
            assert getattr(found, name) == pytest.approx(value, abs=1e-6), name

    def test_books(self) -> None:
        """Values that are printed: t = 4.0621, p = .002833 (sleep); V = 40, p = .0391
        (depression); chi-squared 11.143, p = .003805 (rounding)."""
        sleep = paired(*numbers(SLEEP))
        assert sleep is not None
        assert sleep.t == pytest.approx(4.0621, abs=5e-5)
        assert sleep.t_p == pytest.approx(0.002833, abs=5e-7)
        depression = paired(*numbers(DEPRESSION))
        assert depression is not None
        assert depression.w == 40.0
        assert depression.wilcoxon_p == pytest.approx(0.0390625)
        times = np.array([float(one) for one in ROUNDING.split()]).reshape(22, 3)
        rounding = several_paired(times.tolist())
        assert rounding is not None
        assert rounding.statistic == pytest.approx(11.143, abs=5e-4)
        assert rounding.p == pytest.approx(0.003805, abs=5e-7)


class TestLevel:
    """HRI-13: 1,000 null simulations reject 5 % +-1.5 %."""

    def test_paired(self) -> None:
        """Paired t and Wilcoxon of 16 participants."""
        rng = np.random.default_rng(1)
        rejected = {"t": 0, "wilcoxon": 0}
        for _ in range(1000):
            found = rng.normal(size=16)
            t = statistics.stats.ttest_1samp(found, 0.0).pvalue
            rejected["t"] += t < 0.05
            rejected["wilcoxon"] += signed_rank(found)[2] < 0.05
        for name, count in rejected.items():
            assert 35 <= count <= 65, name

    def test_unpaired(self) -> None:
        """Mann and Whitney's of two groups of 15."""
        rng = np.random.default_rng(2)
        count = sum(
            rank_sum(rng.normal(size=15), rng.normal(size=15))[1] < 0.05 for _ in range(1000)
        )
        assert 35 <= count <= 65

    def test_intervals_cover(self) -> None:
        """95 % intervals of the mean of 20 hold it in 90 % at least of 100 studies."""
        rng = np.random.default_rng(3)
        intervals = [bca(rng.normal(size=20)) for _ in range(100)]
        held = sum(one is not None and one.low <= 0.0 <= one.high for one in intervals)
        assert 88 <= held <= 99


class TestPower:
    """HRI-14."""

    def test_simulated_equals_closed_form(self) -> None:
        """dz = 0.8, n = 15: within .03; about 80 %, so 15 participants are needed (HRI-14)."""
        assert simulated(0.8, 15) == pytest.approx(closed_form(0.8, 15), abs=0.03)
        assert closed_form(0.8, 15) == pytest.approx(0.821, abs=0.001)
        assert needed(0.8) == 15

    def test_level(self) -> None:
        """Without an effect both tests reject at their level; exact Wilcoxon not above it."""
        assert simulated(0.0, 12) == pytest.approx(0.05, abs=0.006)
        assert 0.03 < simulated(0.0, 12, test="wilcoxon") <= 0.056

    def test_printed_values(self) -> None:
        """Cohen's table: d = 0.5 needs 34 pairs for 80 %; 0.5 and 27 pairs have 70 %."""
        assert needed(0.5) == 34
        assert closed_form(0.5, 27) == pytest.approx(0.71, abs=0.01)


class TestEdges:
    """What cannot be computed is missing, and nothing warns."""

    def test_no_difference(self) -> None:
        """All pairs equal: p 1, no effect size, no interval."""
        found = paired([3.0, 3.0, 3.0], [3.0, 3.0, 3.0])
        assert found is not None
        assert (found.wilcoxon_p, found.sign_p, found.permutation_p) == (1.0, 1.0, 1.0)
        assert (found.t_p, found.dz, found.rank_biserial, found.interval) == (None,) * 4

    def test_same_difference(self) -> None:
        """No spread: no t, but ranks tell."""
        found = paired([1.0] * 6, [2.0] * 6)
        assert found is not None
        assert found.t is None
        assert found.wilcoxon_p == pytest.approx(2 / 2**6)
        assert found.rank_biserial == 1.0

    def test_few(self) -> None:
        """One value has a mean only, none is nothing."""
        one = summary([4.0])
        assert one is not None
        assert (one.n, one.mean, one.sd, one.interval) == (1, 4.0, None, None)
        assert summary([]) is None
        assert paired([], []) is None
        assert unpaired([], [1.0]) is None
        pair = paired([1.0], [2.0])
        assert pair is not None
        assert pair.wilcoxon_p == 1.0

    def test_ties_of_decimals(self) -> None:
        """0.3 - 0.1 ties with 0.2 - 0.0 although their last bits differ."""
        first, second = [0.1, 0.0, 0.1, 0.0], [0.3, 0.2, -0.1, -0.2]
        found = paired(first, second)
        assert found is not None
        assert found.w == 5.0
        assert found.wilcoxon_p == 1.0

    def test_many(self) -> None:
        """More than 50 values: the normal approximation agrees with 20,000 permutations."""
        rng = np.random.default_rng(4)
        drawn = rng.normal(0.25, 1.0, 60)
        _, _, p, exact = signed_rank(drawn)
        assert not exact
        assert p == pytest.approx(statistics.stats.wilcoxon(drawn, method="approx").pvalue)

    @given(
        st.lists(st.tuples(st.integers(-5, 5), st.integers(-5, 5)), min_size=1, max_size=9),
    )
    def test_turning_conditions_round(self, pairs: list[tuple[int, int]]) -> None:
        """Exchanging the conditions turns signs and nothing else."""
        first, second = [float(a) for a, _ in pairs], [float(b) for _, b in pairs]
        one, other = paired(first, second), paired(second, first)
        assert one is None or one.dz is None or one.dz * (one.sd or 0.0) == pytest.approx(one.mean)
        assert one is not None
        assert other is not None
        assert one.wilcoxon_p == pytest.approx(other.wilcoxon_p)
        assert (one.permutation_p is None) == (len(pairs) == 1)
        if one.permutation_p is not None:
            assert one.permutation_p == pytest.approx(other.permutation_p)
        assert one.mean == -other.mean
        assert (one.positive, one.negative) == (other.negative, other.positive)
        assert 0.0 < one.wilcoxon_p <= 1.0


def test_holm() -> None:
    """By hand: .01 x 4, .02 x 3, .03 x 2 = .06 again, .5; missing ones stay missing."""
    assert holm([0.03, 0.01, None, 0.5, 0.02]) == pytest.approx([0.06, 0.04, None, 0.5, 0.06])
    assert holm([]) == []
    assert holm([0.9, 0.8]) == [1.0, 1.0]


def test_the_same_every_time() -> None:
    """Bootstrap and permutations depend on the data alone."""
    rng = np.random.default_rng(5)
    first, second = rng.normal(size=20).tolist(), rng.normal(size=20).tolist()
    assert paired(first, second) == paired(first, second)
    assert unpaired(first, second) == unpaired(first, second)
    found = paired(first, second)
    assert found is not None
    assert found.interval is not None
    assert found.interval.low < found.mean < found.interval.high
    assert found.dz == pytest.approx(found.t / math.sqrt(20) if found.t is not None else None)


def test_command(capsys: pytest.CaptureFixture[str]) -> None:
    """`usarsim study power` says how many (HRI-14)."""
    assert cli.main(["study", "power", "--dz", "0.8"]) == 0
    out = capsys.readouterr().out
    assert "participants           15" in out
    assert "paired t, closed form  0.821" in out
    assert cli.main(["study", "power", "--dz", "0.001"]) == 2
