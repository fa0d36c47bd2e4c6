"""What the kit makes of what it reads: lines, places, simulated time, motion by GroundTruth."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_conformance.clock import SimulatedClock, Stalled
from usarsim_conformance.lines import Line, Lines, number, numbers
from usarsim_conformance.places import Place, place_from, read_start_poses, spaced
from usarsim_conformance.recordings import irregular
from usarsim_conformance.registry import Inconclusive, NotApplicable
from usarsim_conformance.survey import dialect_of
from usarsim_conformance.trips import Leg, moments_of, near, of_classes
from usarsim_conformance.wire import Transcript, Wire


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


Story = Callable[
    [SimulatedClock, asyncio.StreamWriter, Wire, asyncio.StreamWriter], Awaitable[None]
]


def told(story: Story, hangs: float = 60.0) -> None:
    """Tell a story with a clock, the server's end of the robot that it follows, and both ends of
    another connection."""

    async def run() -> None:
        ends: asyncio.Queue[asyncio.StreamWriter] = asyncio.Queue()
        done = asyncio.Event()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            ends.put_nowait(writer)
            await done.wait()
            writer.close()

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        clock = SimulatedClock(hangs)

        async def connected() -> Wire:
            return await Wire.open("127.0.0.1", port, Transcript(), "x", clock)

        wire = await connected()
        other = await ends.get()
        await clock.follow(connected)
        robot = await ends.get()
        try:
            await story(clock, robot, wire, other)
        finally:
            await clock.close()
            wire.close()
            done.set()
            server.close()

    asyncio.run(run())


def status(time: float) -> bytes:
    """A report."""
    return f"STA {{Type GroundVehicle}} {{Time {time:.2f}}}\r\n".encode()


async def tell(clock: SimulatedClock, robot: asyncio.StreamWriter, time: float) -> None:
    """Report, and wait until the kit has read it."""
    robot.write(status(time))
    await heard(clock, time)


async def heard(clock: SimulatedClock, time: float) -> None:
    """Wait until the kit has read a report."""
    for _ in range(60_000):
        if clock.told == time:
            return
        await asyncio.sleep(0.001)
    raise AssertionError(f"the clock has not heard of {time}")


def test_time_passes_when_it_is_told() -> None:
    """A wait ends when a report tells its moment, and not before."""

    async def story(clock: SimulatedClock, robot: asyncio.StreamWriter, *_: object) -> None:
        await tell(clock, robot, 100.0)
        waiting = asyncio.create_task(clock.sleep(1.0))
        await tell(clock, robot, 100.9)
        assert not waiting.done()
        robot.write(status(101.3))
        await waiting

    told(story)


def test_what_was_sent_before_counts() -> None:
    """A line that the server sent before it told the end of a wait is not missed, even if both come
    at once."""

    async def story(
        clock: SimulatedClock,
        robot: asyncio.StreamWriter,
        wire: Wire,
        other: asyncio.StreamWriter,
    ) -> None:
        await tell(clock, robot, 5.0)
        for count in range(50):
            waiting = asyncio.create_task(wire.read(0.1))
            await asyncio.sleep(0)
            other.write(b"late\r\n")
            robot.write(status(6.0 + count))
            assert await waiting == b"late\r\n"
            await heard(clock, 6.0 + count)

    told(story)


def test_silence_is_silence() -> None:
    """Nothing that comes until time has passed is told as nothing."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, *_: object
    ) -> None:
        await tell(clock, robot, 1.0)
        waiting = asyncio.create_task(wire.silence(2.0))
        await asyncio.sleep(0.05)
        assert not waiting.done()
        robot.write(status(9.0))
        assert await waiting == b""

    told(story)


def test_a_server_that_hangs() -> None:
    """If no time is told any more, whoever waits is told."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, *_: object
    ) -> None:
        robot.write(status(1.0))
        with pytest.raises(Stalled):
            await wire.silence(2.0)

    told(story, hangs=0.5)


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


def _report(time: float, x: float, y: float, yaw: float, roll: float = 0.0) -> Line:
    text = (
        f"SEN {{Time {time:.4f}}} {{Type GroundTruth}} {{Name G}} {{Location {x:.4f},{y:.4f},0}}"
        f" {{Orientation {roll % math.tau:.4f},0.0000,{yaw % math.tau:.4f}}}\r\n"
    )
    return Line(text.encode())


def _leg(lines: list[Line]) -> Leg:
    return Leg("DRIVE {Left 1} {Right 1}", lines, moments_of(lines))


def test_speed_along_an_arc() -> None:
    """On a circle to the right of 2 m at 1 m/s yaw grows by 0.5 rad/s, also past a full turn."""
    lines = []
    for step in range(40):
        time = step / 10.0
        angle = 6.0 + 0.5 * time
        lines.append(_report(time, 2.0 * math.sin(angle), -2.0 * math.cos(angle), angle))
    leg = _leg(lines)
    assert leg.speed == pytest.approx(1.0, abs=0.01)
    assert leg.turning == pytest.approx(0.5, abs=0.001)
    ahead, right, down = leg.velocity
    assert ahead > 0.9
    assert abs(right) < 0.05
    assert down == 0.0


def test_directions_are_those_of_the_robot() -> None:
    """A robot that faces +y and moves to -x goes to its right; backwards speed is negative."""
    half = math.pi / 2.0
    leg = _leg([_report(step / 10.0, -0.1 * step, 0.0, half, roll=-0.2) for step in range(10)])
    assert leg.velocity == pytest.approx((0.0, 1.0, 0.0), abs=1e-3)
    assert leg.gone == pytest.approx((0.0, 0.9), abs=1e-3)
    assert leg.roll == pytest.approx(-0.2, abs=1e-3)
    back = _leg([_report(step / 10.0, 0.0, -0.1 * step, half) for step in range(10)])
    assert back.speed == pytest.approx(-1.0, abs=1e-3)


def test_a_ramp_is_left_out() -> None:
    """Speeds are those of the later part, after a robot has sped up."""
    places = [0.5 * (step / 10.0) ** 2 if step < 10 else step / 10.0 - 0.5 for step in range(40)]
    leg = _leg([_report(step / 10.0, x, 0.0, 0.0) for step, x in enumerate(places)])
    assert leg.velocity[0] == pytest.approx(1.0, abs=0.01)
    assert leg.velocity_at_last(0.2)[0] == pytest.approx(1.0, abs=0.01)


def test_nothing_is_said_without_ground_truth() -> None:
    """A robot that does not tell where it is cannot be judged."""
    with pytest.raises(Inconclusive, match="no GroundTruth"):
        _ = _leg([]).velocity


def test_near_takes_the_larger_tolerance() -> None:
    """A share of the wanted number, or a least difference."""
    assert near(1.04, 1.0, 0.05)
    assert not near(1.06, 1.0, 0.05)
    assert near(0.009, 0.0, 0.05, 0.01)


def test_classes_that_are_missing_are_left_out() -> None:
    """Only if all are missing there is nothing to judge, and the reasons are told."""

    async def make(case: object, class_name: str) -> str:
        if class_name.startswith("No"):
            raise NotApplicable(f"no {class_name}")
        return class_name

    case = SimpleNamespace()
    assert asyncio.run(of_classes(case, ("NoCar", "Sedan"), make)) == ["Sedan"]  # type: ignore[arg-type]
    with pytest.raises(NotApplicable, match="no NoCar; no NoBus"):
        asyncio.run(of_classes(case, ("NoCar", "NoBus"), make))  # type: ignore[arg-type]
