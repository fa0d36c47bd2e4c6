"""What clients received is taken apart as the protocol is written; figures have known answers."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.measures import longest_extra_gap, period, streams
from usarsim_bench.recording import between, lines, real_time_factor, status_samples
from usarsim_server.protocol import messages
from usarsim_server.protocol.values import Dialect

Samples = list[tuple[float, float]]


def paced(factor: float, count: int = 101, gap: float = 0.1) -> Samples:
    """Samples of a simulation that runs at a factor without any jitter."""
    return [(5.0 + n * gap, 2.0 + n * gap * factor) for n in range(count)]


def with_stall(samples: Samples, at: int, lost: float) -> Samples:
    """The same samples with wall time lost before one of them."""
    return [(wall + (lost if n >= at else 0.0), sim) for n, (wall, sim) in enumerate(samples)]


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


class TestGaps:
    TIMES = tuple(n * 0.2 for n in range(50))

    def test_period_is_the_usual_gap(self) -> None:
        """One long gap does not change the period."""
        assert period([*self.TIMES, 30.0]) == pytest.approx(0.2)

    def test_period_needs_two(self) -> None:
        """One moment has no period."""
        with pytest.raises(ValueError, match="two moments"):
            period([1.0])

    @pytest.mark.parametrize(
        ("times", "span", "gap"),
        [
            # Nothing is missed: the longest silence is the period.
            (TIMES, (4.0, 6.0), 0.0),
            # A line that is late shows as just that.
            ((*TIMES[:25], 5.15, *TIMES[26:]), (4.0, 6.0), 0.15),
            # What happened before the span is not counted.
            ((*TIMES[:10], *TIMES[14:]), (4.0, 6.0), 0.0),
            # A silence that ends within the span counts in full.
            ((*TIMES[:19], *TIMES[22:]), (4.0, 6.0), 0.6),
            # A stream without further lines is silent until the end of the span.
            (TIMES[:21], (3.0, 7.0), 3.0 - 0.2),
        ],
    )
    def test_the_longest_silence_beyond_the_period(
        self, times: tuple[float, ...], span: tuple[float, float], gap: float
    ) -> None:
        """A silence counts if it ends within the span or lasts until its end."""
        assert longest_extra_gap(times, *span) == pytest.approx(gap, abs=1e-9)

    def test_stream_that_had_not_begun(self) -> None:
        """A stream that begins after the span says nothing about it."""
        with pytest.raises(ValueError, match="not begun"):
            longest_extra_gap(self.TIMES, -2.0, -1.0)


STATUS = (
    b"STA {Type GroundVehicle} {Time 63.40} {FrontSteer 0.0000} {RearSteer 0.0000} "
    b"{LightToggle False} {LightIntensity 0} {Battery 1188} {View -1}"
)
UDK_STATUS = b"STA {Time 63.4021} {Battery 1187} {Type GroundVehicle} {LightToggle False}"
SENSORS = [
    (b"SEN {Time 63.40} {Type RangeScanner} {Name lms200} {Range 2.0,2.8}", "RangeScanner lms200"),
    (b"SEN {Time 63.40} {Type Sonar} {Name F1 Range 1.98} {Name F2 Range 2.3}", "Sonar F1"),
    (b"SEN {Type Odometry} {Name Odometry} {Pose 1.2,-0.0,6.2}", "Odometry Odometry"),
    (b"SEN {Time 1.5}{Type RangeScanner}{Name lms200}{Range 1.0}", "RangeScanner lms200"),
]


def as_chunks(data: bytes, cuts: list[int]) -> list[tuple[float, bytes]]:
    """Bytes cut at some places, one second apart."""
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [(float(n), data[a:b]) for n, (a, b) in enumerate(pairwise(edges))]


class TestLines:
    @given(st.lists(st.integers(0, 1000), max_size=30))
    def test_do_not_depend_on_the_chunks(self, cuts: list[int]) -> None:
        """Any cutting gives the same lines, cut inside a line end included."""
        told = [STATUS, SENSORS[0][0], UDK_STATUS]
        found = [line for _, line in lines(as_chunks(b"\r\n".join([*told, b""]), cuts))]
        assert found == told

    def test_bear_the_moment_of_their_last_byte(self) -> None:
        """A line counts as there when its end is."""
        chunks = [(1.0, b"STA {Ti"), (2.0, b"me 1.0}\r"), (3.0, b"\nSEN {Type X} {Name Y}\r\nDI")]
        assert list(lines(chunks)) == [(3.0, b"STA {Time 1.0}"), (3.0, b"SEN {Type X} {Name Y}")]

    def test_rest_without_end_is_no_line(self) -> None:
        """What was cut off when the recording ended is left out."""
        assert list(lines([(1.0, STATUS)])) == []


class TestStatus:
    @pytest.mark.parametrize(("line", "time"), [(STATUS, 63.40), (UDK_STATUS, 63.4021)])
    def test_time_of_both_dialects(self, line: bytes, time: float) -> None:
        """The simulated time is found wherever the dialect puts it (protocol reference 4.3)."""
        assert status_samples([(7.5, line + b"\r\n")]) == [(7.5, time)]

    def test_other_lines_give_none(self) -> None:
        """Sensor lines and replies are no samples, whatever times they tell."""
        data = b"\r\n".join([line for line, _ in SENSORS] + [b"NFO {Time 3.0}", b""])
        assert status_samples([(1.0, data)]) == []

    @pytest.mark.parametrize("dialect", list(Dialect))
    def test_agrees_with_the_server(self, dialect: Dialect) -> None:
        """Lines are read as this server writes them."""
        status = messages.GroundStatus(
            time=12.5,
            front_steer=0.0,
            rear_steer=0.0,
            joints=(),
            light=False,
            light_intensity=0,
            battery=1,
            view=-1,
        )
        line = messages.encode(messages.ground_status(status, dialect))
        assert status_samples([(1.0, line)]) == [(1.0, 12.5)]


class TestStreams:
    @pytest.mark.parametrize(("line", "name"), SENSORS)
    def test_sensor_streams_have_type_and_first_name(self, line: bytes, name: str) -> None:
        """Each sensor, or batch of sensors, is one stream (protocol reference 4.6)."""
        assert streams([(2.0, line + b"\r\n")]) == {name: [2.0]}

    def test_arrivals_are_kept_in_order_and_apart(self) -> None:
        """Every stream has its own arrivals; replies belong to none."""
        scan, sonar = SENSORS[0][0] + b"\r\n", SENSORS[1][0] + b"\r\n"
        chunks = [(1.0, scan + STATUS + b"\r\n"), (2.0, sonar), (3.0, b"DIE {None}\r\n" + scan)]
        assert streams(chunks) == {
            "RangeScanner lms200": [1.0, 3.0],
            "STA": [1.0],
            "Sonar F1": [2.0],
        }


def test_between_includes_both_ends() -> None:
    """A span contains the samples at its ends."""
    samples = [(1.0, 0.1), (2.0, 0.2), (3.0, 0.3), (4.0, 0.4)]
    assert between(samples, 2.0, 3.0) == [(2.0, 0.2), (3.0, 0.3)]
