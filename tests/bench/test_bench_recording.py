"""What clients received is taken apart as the protocol is written."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_bench.recording import between, lines, start_tags, status_samples, streams
from usarsim_server.protocol import messages
from usarsim_server.protocol.values import Dialect

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


class TestStartTags:
    def test_of_the_servers_answer(self) -> None:
        """The tags are those of the world, in its order (protocol reference 4.2)."""
        zero = (0.0, 0.0, 0.0)
        line = messages.start_poses([("Here", zero, zero), ("There", (1.0, 2.0, 3.0), zero)])
        assert start_tags(line) == ["Here", "There"]

    @pytest.mark.parametrize("line", ["NFO {StartPoses 0}", "NFO {Gametype X} {Level Y}", ""])
    def test_none(self, line: str) -> None:
        """An answer without poses, or another line, has no tags."""
        assert start_tags(line) == []
