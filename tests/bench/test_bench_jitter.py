"""Evenness of a stream: errors of its periods, in wall time and in simulated time."""

from __future__ import annotations

import pytest

from usarsim_bench.recording import Sample, period_errors, sensor_samples
from usarsim_bench.robot_files import LASER_NAME
from usarsim_bench.server import BenchError
from usarsim_bench.swarm import jitter_figures

LATENCY = 0.003


def stream(count: int, late: dict[int, float] | None = None) -> list[Sample]:
    """Lines of 10 Hz, all equally late but some."""
    late = late or {}
    return [(0.1 * n + LATENCY + late.get(n, 0.0), 0.1 * n) for n in range(count)]


class TestPeriods:
    def test_errors_have_no_sign(self) -> None:
        """A late line spoils the period before it and the one behind it."""
        assert period_errors([0.0, 0.1, 0.23, 0.3], 0.1) == pytest.approx([0.0, 0.03, 0.03])

    def test_one_moment_has_no_period(self) -> None:
        """There is nothing between fewer than two."""
        assert period_errors([1.0], 0.1) == []


class TestSamples:
    @pytest.mark.parametrize(
        "line",
        [
            b"SEN {Time 63.40} {Type RangeScanner} {Name lms200} {Resolution 0.1} {Range 1}",
            b"SEN {Time 63.40}{Type RangeScanner}{Name lms200}{Range 1}",
            b"SEN {Time 63.40} {Type Sonar} {Name lms200 Range 1.98}",
        ],
    )
    def test_of_the_sensor_asked_for(self, line: bytes) -> None:
        """In whatever way the dialect prints them (protocol reference 4.5)."""
        other = b"SEN {Time 63.40} {Type RangeScanner} {Name Other} {Range 1}"
        untimed = b"SEN {Type Odometry} {Name lms200} {Pose 1,2,3}"
        data = b"\r\n".join([other, line, untimed, b""])
        assert sensor_samples([(7.0, data)], "lms200") == [(7.0, 63.40)]


class TestFigures:
    def test_an_even_stream_has_no_error(self) -> None:
        """A constant delay is no jitter."""
        figures = {one.name: one for one in jitter_figures([stream(50), stream(30)])}
        tail = figures["Error of a period, 99th percentile"]
        assert tail.value == pytest.approx(0.0, abs=1e-6)
        assert tail.met is True
        assert figures["Error of a period in simulated time, longest"].met is True
        assert figures["Periods measured"].value == 49 + 29

    def test_late_lines_are_found(self) -> None:
        """Enough of them move the percentile; a single robot's are not hidden by the others."""
        shaken = stream(100, dict.fromkeys(range(10, 60, 10), 0.02))
        figures = {one.name: one for one in jitter_figures([stream(400), shaken])}
        worst = figures["Error of a period, 99th percentile of the worst robot"]
        assert worst.value == pytest.approx(20.0)
        assert figures["Error of a period, longest"].value == pytest.approx(20.0)
        assert figures["Error of a period, 99th percentile"].met is False
        assert figures["Error of a period, median"].value == pytest.approx(0.0, abs=1e-6)
        assert figures["Error of a period in simulated time, longest"].met is True

    def test_a_report_left_out_is_an_error_in_both(self) -> None:
        """A gap of two periods is one whole period wrong."""
        samples = stream(20)
        del samples[7]
        figures = {one.name: one for one in jitter_figures([samples])}
        assert figures["Error of a period, longest"].value == pytest.approx(100.0)
        simulated = figures["Error of a period in simulated time, longest"]
        assert simulated.value == pytest.approx(100.0)
        assert simulated.met is False

    @pytest.mark.parametrize("recorded", [[], [stream(20), stream(1)]])
    def test_needs_lines(self, recorded: list[list[Sample]]) -> None:
        """A robot without a laser line is an error, not a good figure of the others."""
        with pytest.raises(BenchError, match=LASER_NAME):
            jitter_figures(recorded)
