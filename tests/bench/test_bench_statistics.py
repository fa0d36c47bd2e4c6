"""Statistics of moments and values, against inputs whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_bench.recording import (
    longest_extra_gap,
    percentile,
    period,
    rate,
    real_time_factor,
    trend,
    worst_window,
)

Samples = list[tuple[float, float]]
VALUES = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60)


def paced(factor: float, count: int = 101, gap: float = 0.1) -> Samples:
    """Samples of a simulation that runs at a factor without any jitter."""
    return [(5.0 + n * gap, 2.0 + n * gap * factor) for n in range(count)]


def with_stall(samples: Samples, at: int, lost: float) -> Samples:
    """The same samples with wall time lost before one of them."""
    return [(wall + (lost if n >= at else 0.0), sim) for n, (wall, sim) in enumerate(samples)]


class TestPercentile:
    @given(VALUES, st.floats(0.0, 100.0))
    def test_agrees_with_numpy(self, values: list[float], percent: float) -> None:
        """The interpolation is the usual one."""
        assert percentile(values, percent) == pytest.approx(
            float(np.percentile(values, percent)), rel=1e-9, abs=1e-6
        )

    def test_of_known_values(self) -> None:
        """Of 1 to 101 the 99th percentile is 100, whatever the order."""
        assert percentile(list(range(101, 0, -1)), 99.0) == 100.0

    def test_ends_are_least_and_greatest(self) -> None:
        """0 and 100 per cent are the extremes."""
        values = [3.0, 1.0, 2.0]
        assert (percentile(values, 0.0), percentile(values, 100.0)) == (1.0, 3.0)

    @pytest.mark.parametrize(("values", "percent"), [([], 50.0), ([1.0], -1.0), ([1.0], 101.0)])
    def test_nonsense_is_refused(self, values: list[float], percent: float) -> None:
        """No values, or a share that is none, is an error and not a number."""
        with pytest.raises(ValueError, match="percent"):
            percentile(values, percent)


class TestRealTimeFactor:
    @pytest.mark.parametrize("factor", [0.5, 0.98, 1.0, 3.0])
    @pytest.mark.parametrize("edge", [0.0, 1.0])
    def test_of_an_even_run(self, factor: float, edge: float) -> None:
        """A run without jitter gives its factor, with edges and without."""
        assert real_time_factor(paced(factor), edge) == pytest.approx(factor)

    def test_late_lines_at_the_ends_do_not_count(self) -> None:
        """A reader that was held up at the very end does not lower the factor, given edges."""
        samples = paced(1.0)
        samples[-1] = (samples[-1][0] + 0.05, samples[-1][1])
        samples[0] = (samples[0][0] + 0.05, samples[0][1])
        assert real_time_factor(samples, 1.0) == pytest.approx(1.0)
        assert real_time_factor([samples[1], samples[-1]]) < 0.996

    def test_time_that_is_lost_counts(self) -> None:
        """A stall in the middle that is never made up lowers the factor, edges or not."""
        samples = with_stall(paced(1.0), 50, 1.0)
        assert real_time_factor(samples) == pytest.approx(10.0 / 11.0)
        # Edges shorten the span, so that the stall weighs a little more in it.
        assert 8.0 / 9.0 <= real_time_factor(samples, 1.0) <= 10.0 / 11.0

    @pytest.mark.parametrize("samples", [[], [(1.0, 1.0)], [(1.0, 1.0), (1.0, 2.0)]])
    def test_needs_two_moments(self, samples: Samples) -> None:
        """Without a span of wall time there is no factor."""
        with pytest.raises(ValueError, match="span"):
            real_time_factor(samples)

    def test_edges_must_not_meet(self) -> None:
        """A span that the edges fill leaves nothing to measure."""
        with pytest.raises(ValueError, match="no more than 2 s"):
            real_time_factor(paced(1.0, count=21), 1.0)


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


class TestGaps:
    TIMES = tuple(n * 0.2 for n in range(50))

    def test_period_is_the_usual_gap(self) -> None:
        """One long gap does not change the period."""
        assert period([*self.TIMES, 30.0]) == pytest.approx(0.2)

    def test_period_needs_two(self) -> None:
        """One moment has no period."""
        with pytest.raises(ValueError, match="two moments"):
            period([1.0])

    def test_undisturbed_stream(self) -> None:
        """Nothing is missed: the longest silence is the period."""
        assert longest_extra_gap(self.TIMES, 4.0, 6.0) == pytest.approx(0.0, abs=1e-9)

    def test_disturbance_within_the_span(self) -> None:
        """A line that is 0.15 s late shows as just that."""
        times = [*self.TIMES[:25], 5.15, *self.TIMES[26:]]
        assert longest_extra_gap(times, 4.0, 6.0) == pytest.approx(0.15)

    def test_disturbance_outside_the_span(self) -> None:
        """What happened before or after the span is not counted."""
        times = [*self.TIMES[:10], *self.TIMES[14:]]
        assert longest_extra_gap(times, 4.0, 6.0) == pytest.approx(0.0, abs=1e-9)

    def test_gap_that_begins_before_the_span(self) -> None:
        """A silence that ends within the span counts in full."""
        times = [*self.TIMES[:19], *self.TIMES[22:]]
        assert longest_extra_gap(times, 4.0, 6.0) == pytest.approx(0.6)

    def test_stream_that_dies(self) -> None:
        """A stream without further lines is silent until the end of the span."""
        assert longest_extra_gap(self.TIMES[:21], 3.0, 7.0) == pytest.approx(3.0 - 0.2)

    def test_stream_that_had_not_begun(self) -> None:
        """A stream that begins after the span says nothing about it."""
        with pytest.raises(ValueError, match="not begun"):
            longest_extra_gap(self.TIMES, -2.0, -1.0)


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
