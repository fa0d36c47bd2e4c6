"""What the kit makes of what it reads: lines, places, simulated time, streams."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_conformance.lines import Line, Lines, number, numbers
from usarsim_conformance.places import Place, place_from, read_start_poses, spaced
from usarsim_conformance.recordings import irregular
from usarsim_conformance.survey import dialect_of
from usarsim_conformance.wire import Transcript


def line(text: str) -> Line:
    """A line with a proper end."""
    return Line(text.encode("latin-1") + b"\r\n")


class TestLine:
    def test_segments(self) -> None:
        """Head, names and values are what stands before and in braces, whatever the blanks."""
        found = line("SEN {Time 1.50}  {Type INS}{Name INS}")
        assert found.head == "SEN"
        assert found.segments == (("Time", "1.50"), ("Type", "INS"), ("Name", "INS"))
        assert (found.type, found.time) == ("INS", 1.5)

    def test_missing_values(self) -> None:
        """What is not there is None, not a number, or empty; never an exception."""
        found = line("SEN {None} {Name }")
        assert found.get("Range") is None
        assert math.isnan(found.number("Range"))
        assert found.numbers("Range") == ()
        assert found.get("Name") == ""

    @pytest.mark.parametrize(
        "text",
        [
            "SEN {Type Sonar} {Name F1 Range 2.5} {Name F2 Range 5.0}",
            "SEN {Type Sonar} {Name F1} {Range 2.5} {Name F2} {Range 5.0}",
        ],
    )
    def test_items_in_either_form(self, text: str) -> None:
        """Pairs within a segment and separate segments tell the same of the items."""
        assert line(text).items() == [
            {"Name": "F1", "Range": "2.5"},
            {"Name": "F2", "Range": "5.0"},
        ]

    @given(st.binary(max_size=200))
    def test_any_bytes(self, data: bytes) -> None:
        """Whatever a server sends can be looked at."""
        found = Line(data)
        found.items()
        assert isinstance(found.names, tuple)
        assert "\n" not in str(found) or b"\n" in data.rstrip(b"\r\n")

    @pytest.mark.parametrize("text", ["", "-", "1,5", "nan", "inf", "1e", "0x1", "1 2"])
    def test_what_is_no_number(self, text: str) -> None:
        """Only plain decimals are numbers."""
        assert math.isnan(number(text))

    def test_numbers_keep_their_places(self) -> None:
        """A word among numbers is not a number, and the others stay where they are."""
        first, second, third = numbers("1.5,x,-2")
        assert (first, third) == (1.5, -2.0)
        assert math.isnan(second)


class TestLines:
    @given(st.lists(st.binary(max_size=20), max_size=10))
    def test_nothing_is_lost(self, chunks: list[bytes]) -> None:
        """Lines and rest together are what came, however it was cut."""
        cutter = Lines()
        found = [one.raw for chunk in chunks for one in cutter.feed(chunk)]
        assert b"".join(found) + cutter.rest == b"".join(chunks)
        assert all(raw.endswith(b"\n") and b"\n" not in raw[:-1] for raw in found)


class TestDialectOf:
    @pytest.mark.parametrize(
        ("text", "dialect"),
        [
            ("STA {Type GroundVehicle} {Time 1.20} {Battery 9} {View -1}", "ut2004"),
            ("STA {Type GroundVehicle} {Time 1.2000} {Battery 9} {View -1}", "udk"),
            ("STA {Time 1.2000} {Battery 9} {Type GroundVehicle}", "udk"),
            ("STA {Time 1.2}{Battery 9}{Type GroundVehicle}{LightToggle False}", "gazebo"),
            ("STA {Type GroundVehicle} {Time 1.234}", "ut2004"),
            ("STA {Time 1.234} {Type GroundVehicle}", "udk"),
            ("STA", ""),
        ],
    )
    def test_shapes(self, text: str, dialect: str) -> None:
        """Digits and blanks of a status tell the dialect; with odd digits its order does."""
        assert dialect_of(line(text)) == dialect


class TestPlaces:
    @pytest.mark.parametrize(
        "text",
        [
            "NFO {StartPoses 2} {A 1.0,2.0,-0.3 0,0,1.57 B 4,5,6 0,0,0}",
            "NFO {StartPoses 2}{A 1.0,2.0,-0.3 0,0,1.57}{B 4,5,6 0,0,0}",
            "NFO {StartPoses 2} {Name A Location 1.0,2.0,-0.3 Orientation 0,0,1.57}"
            " {Name B Location 4,5,6 Orientation 0,0,0}",
        ],
    )
    def test_start_poses_in_three_forms(self, text: str) -> None:
        """All known forms of start poses are read (protocol reference 4.2)."""
        one, other = read_start_poses(line(text))
        assert one == Place("A", (1.0, 2.0, -0.3), (0.0, 0.0, 1.57))
        assert (other.tag, other.location) == ("B", (4.0, 5.0, 6.0))

    def test_places_keep_apart(self) -> None:
        """Of start poses that are close together one is used; poses that are none are not."""
        places = [
            Place("A"),
            Place("B", (0.5, 0.0, 0.0)),
            Place("C", (math.nan, 0.0, 0.0)),
            Place("D", (3.0, 0.0, 0.0)),
        ]
        assert [place.tag for place in spaced(places)] == ["A", "D"]

    def test_tilted_places(self) -> None:
        """Roll and pitch tilt, yaw and whole turns do not; what is no number does not either."""
        for rotation, tilted in (
            ((0.1, 0.0, 0.0), True),
            ((0.0, -0.1, 1.0), True),
            ((0.0, 0.0, 1.0), False),
            ((math.tau, 0.005, 0.0), False),
            ((math.inf, math.nan, 0.0), False),
        ):
            assert Place("A", rotation=rotation).is_tilted is tilted

    def test_beside_a_place(self) -> None:
        """Right of a robot that faces +y is -x, with z down."""
        beside = Place("A", (1.0, 1.0, -0.2), (0.0, 0.0, math.pi / 2)).moved(right=1.0)
        assert beside.location == pytest.approx((0.0, 1.0, -0.2))
        assert beside.segments.startswith("{Location ")

    def test_what_users_name(self) -> None:
        """A tag, three numbers, or three and a yaw."""
        assert place_from("Start7").segments == "{Start Start7}"
        assert place_from("1,2,-0.5").location == (1.0, 2.0, -0.5)
        assert place_from("1, 2, -0.5, 1.57").rotation == (0.0, 0.0, 1.57)
        with pytest.raises(ValueError, match="neither a start pose nor"):
            place_from("1,2")


class TestTranscript:
    def test_bounded(self) -> None:
        """A flood leaves the first and the last entries, and tells how many are missing."""
        transcript = Transcript()
        for index in range(5000):
            transcript.received("c1", b"x" * 10_000 + str(index).encode())
        entries = transcript.entries()
        assert len(entries) < 150
        assert "4900 more" in entries[30]
        assert entries[-1].endswith("4999")
        assert all(len(entry) < 500 for entry in entries)

    def test_bytes_are_visible(self) -> None:
        """Line ends and other bytes that cannot be seen are written out."""
        transcript = Transcript()
        transcript.sent("c1", b"A\t\x00\xff\\\r\n")
        assert transcript.entries()[0].endswith(r"c1 > A\t\x00\xff\\\r\n")


@pytest.mark.parametrize(
    ("times", "wrong"),
    [
        ([n * 0.2 for n in range(40)], ""),
        ([round(n * 0.05 / 0.004) * 0.004 for n in range(160)], ""),
        ([n * 0.2 for n in range(40) if n != 17], "missing"),
        ([n * 0.2 for n in range(40) if n % 4], "missing"),
        ([n * 0.2 for n in (*range(17), 16, *range(17, 40))], "too many"),
    ],
)
def test_streams_are_regular_or_not(times: list[float], wrong: str) -> None:
    """A report that is left out, or comes twice, is told; time steps that alternate are not."""
    found = irregular(sorted(times))
    assert (wrong in found) if wrong else not found
