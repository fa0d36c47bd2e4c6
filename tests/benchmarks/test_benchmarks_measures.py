"""Figures that are made of moments, values and pictures have known answers."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.measures import rate, summed_up, trend, worst_window
from usarsim_bench.figures import BenchError
from usarsim_bench.recording import real_time_factor
from usarsim_bench.watching import View

Samples = list[tuple[float, float]]


def paced(factor: float, count: int = 101, gap: float = 0.1) -> Samples:
    """Samples of a simulation that runs at a factor without any jitter."""
    return [(5.0 + n * gap, 2.0 + n * gap * factor) for n in range(count)]


def with_stall(samples: Samples, at: int, lost: float) -> Samples:
    """The same samples with wall time lost before one of them."""
    return [(wall + (lost if n >= at else 0.0), sim) for n, (wall, sim) in enumerate(samples)]


class TestWorstWindow:
    def test_of_an_even_run(self) -> None:
        """Every stretch of an even run has the factor of the run."""
        assert worst_window(paced(0.9), 1.0) == pytest.approx(0.9)

    def test_finds_the_stall(self) -> None:
        """Half a second lost: some stretch of ten gaps of 0.1 s advances 0.6 s in 1.1 s or so."""
        worst = worst_window(with_stall(paced(1.0), 50, 0.5), 1.0)
        assert worst == pytest.approx(0.5, abs=0.05)

    def test_a_long_stall_is_not_cut_short(self) -> None:
        """Three seconds of silence lie within one stretch, however narrow the window."""
        worst = worst_window(with_stall(paced(1.0), 50, 3.0), 1.0)
        assert worst == pytest.approx(0.1 / 3.1)

    def test_catching_up_shows_in_the_worst_but_not_in_the_whole(self) -> None:
        """A pause that is made up afterwards lowers the worst second only."""
        samples = paced(1.0)
        for n in range(40, 45):
            samples[n] = (samples[45][0], samples[n][1])
        assert real_time_factor(samples) == pytest.approx(1.0)
        assert worst_window(samples, 1.0) < 0.75

    def test_needs_the_width(self) -> None:
        """A run shorter than the window has no worst window."""
        with pytest.raises(ValueError, match="less than 2 s"):
            worst_window(paced(1.0, count=15), 2.0)


class TestRate:
    def test_counts_what_is_in_the_span(self) -> None:
        """Moments at either end belong to the span, others do not."""
        times = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]
        assert rate(times, 1.0, 3.0) == pytest.approx(5 / 2.0)
        assert rate(times, 4.0, 5.0) == 0.0
        assert rate([], 0.0, 1.0) == 0.0

    @pytest.mark.parametrize("stop", [2.0, 1.0])
    def test_needs_a_span(self, stop: float) -> None:
        """There is no rate over no time."""
        with pytest.raises(ValueError, match="span of time"):
            rate([2.0], 2.0, stop)


class TestTrend:
    def test_of_a_line(self) -> None:
        """Values that rise evenly have the slope of their line."""
        assert trend([(t, 7.0 + 3.0 * t) for t in range(20)]) == pytest.approx(3.0)

    def test_ignores_a_single_step(self) -> None:
        """One step up in the middle of a flat run is no trend."""
        assert trend([(t, 0.0 if t < 15 else 100.0) for t in range(20)]) == 0.0

    @given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=20), st.floats(-5.0, 5.0))
    def test_moves_with_the_slope(self, noise: list[float], slope: float) -> None:
        """Adding a slope to any values adds it to their trend."""
        flat = [(float(t), value) for t, value in enumerate(noise)]
        tilted = [(t, value + slope * t) for t, value in flat]
        assert trend(tilted) == pytest.approx(trend(flat) + slope, abs=1e-6)

    @pytest.mark.parametrize("samples", [[], [(1.0, 2.0)], [(1.0, 2.0), (1.0, 3.0)]])
    def test_needs_two_moments(self, samples: Samples) -> None:
        """Without a span of time there is no trend."""
        with pytest.raises(ValueError, match="two moments"):
            trend(samples)

    def test_is_finite(self) -> None:
        """Samples at equal times are left out instead of dividing by nothing."""
        assert math.isfinite(trend([(0.0, 1.0), (0.0, 2.0), (1.0, 3.0)]))


def test_span_is_summed_up() -> None:
    """Rates count what came within the span; times to answer are those of these pictures."""
    pictures = [View(n * 0.1, n * 0.1 + 0.01 + 0.001 * n, 1000, n // 2) for n in range(100)]
    trial = summed_up(pictures, 1.0, 5.0)
    assert trial.pictures == pytest.approx(10.0, abs=0.3)
    assert trial.news == pytest.approx(5.0, abs=0.3)
    assert trial.octets == pytest.approx(10_000, rel=0.03)
    assert 0.020 <= trial.median <= trial.tail <= trial.longest <= 0.060


def test_picture_that_comes_too_late_is_a_long_wait() -> None:
    """A span without a picture has a rate of zero and a wait; one without a question has none."""
    assert summed_up([View(0.0, 0.1, 1, 1)], 0.0, 2.0).pictures == 0.5
    stalled = summed_up([View(0.0, 0.1, 1, 1), View(0.2, 3.2, 1, 1)], 0.5, 1.5)
    assert (stalled.pictures, stalled.longest) == (0.0, 3.0)
    with pytest.raises(BenchError, match=r"no picture was asked for in 1\.0 s"):
        summed_up([View(0.0, 0.1, 1, 1), View(2.0, 2.1, 1, 1)], 0.5, 1.5)
