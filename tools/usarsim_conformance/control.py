"""The control port as a client sees it: lines, replies, robots and where they are."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from usarsim_conformance.lines import Line, Lines
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Failed, Inconclusive, NotApplicable
from usarsim_conformance.wire import Hangup, Wire

Wanted = str | Callable[[Line], bool]
"""The line that is waited for: what it begins with, or a function that accepts it."""

REPLY = 10.0
"""s of simulated time in which an answer comes or never does; servers answer at once, but may have
to come to it."""

_STALE = 0.2
"""s of simulated time without reading after which older lines are waiting to be read."""
_EXACT = 1e-6
"""s; printed times are rounded, and so are their differences."""
_MOST_LINES = 50_000
"""Lines remembered of one connection."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a robot says it is: metres and radians in the frame of the wire."""

    location: tuple[float, float, float]  # x forward (world), y right, z down
    orientation: tuple[float, float, float]  # roll, pitch, yaw; yaw grows clockwise seen from above

    @property
    def yaw(self) -> float:
        """rad."""
        return self.orientation[2]

    def ahead(self, other: Pose) -> tuple[float, float]:
        """How far another place is ahead and to the right of this one, m."""
        dx, dy = (other.location[axis] - self.location[axis] for axis in (0, 1))
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return cos * dx + sin * dy, cos * dy - sin * dx


def turned(start: float, end: float) -> float:
    """From one angle to another the short way, rad in (-pi, pi]."""
    return math.remainder(end - start, math.tau)


class ControlClient:
    """A connection to the control port.

    Attributes:
        wire: the connection.
        lines: everything the server has said, in order.
        clock: simulated time; waiting methods take `within`, s of it.
        read_at: when a line was last taken, by the clock.
        least_wall: s of wall time that a wanted line has at least, see `Wire.read_exactly`.
    """

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.clock = wire.clock
        self.lines: list[Line] = []
        self._cutter = Lines()
        self._ready: deque[Line] = deque()
        self._last_command = ""
        self.read_at = self.clock.now
        self.least_wall = 0.0

    async def send(self, *commands: str, end: str = "\r\n") -> None:
        """Send commands in one write, each with the line end."""
        self._last_command = commands[-1] if commands else ""
        await self.wire.send("".join(command + end for command in commands).encode("latin-1"))

    async def send_bytes(self, data: bytes) -> None:
        """Send bytes as they are."""
        await self.wire.send(data)

    async def line(self, within: float = REPLY) -> Line | None:
        """The next line; None if none comes in time.

        Raises:
            Hangup: if the server closed the connection.
        """
        return await self._line_by(self.clock.after(within))

    async def _line_by(self, moment: float, least_wall: float = 0.0) -> Line | None:
        while not self._ready:
            data = await self.wire.read_by(moment, least_wall)
            if not data:
                return None
            self._ready.extend(self._cutter.feed(data))
        line = self._ready.popleft()
        self.read_at = self.clock.now
        if len(self.lines) < _MOST_LINES:
            self.lines.append(line)
        return line

    async def listen(self, seconds: float) -> list[Line]:
        """All lines that come within a time."""
        found, moment = [], self.clock.after(seconds)
        while (line := await self._line_by(moment)) is not None:
            found.append(line)
        return found

    async def maybe(self, wanted: Wanted, within: float = REPLY) -> Line | None:
        """The next line that is wanted; None if none comes in time; others are passed over."""
        accept = _acceptor(wanted)
        moment = self.clock.after(within)
        while (line := await self._line_by(moment, self.least_wall)) is not None:
            if accept(line):
                return line
        return None

    async def wait(self, wanted: Wanted, within: float = REPLY, what: str = "") -> Line:
        """The next line that is wanted.

        Args:
            wanted: what it begins with, or a function.
            within: s of simulated time.
            what: name of it for the report; the text itself by default.

        Raises:
            Failed: if none comes in time.
        """
        line = await self.maybe(wanted, within)
        if line is None:
            name = what or (wanted if isinstance(wanted, str) else "such line")
            after = f" after {self._last_command[:100]!r}" if self._last_command else ""
            raise Failed(f"no {name} within {within:g} s{after}")
        return line

    async def ask(
        self, command: str, wanted: Wanted, within: float = REPLY, what: str = ""
    ) -> Line:
        """Send a command and wait for its reply."""
        await self.send(command)
        return await self.wait(wanted, within, what)

    async def outcome(self, *commands: str, seconds: float = 0.5) -> list[Line]:
        """What is said after commands: until a question behind them is answered, so that they have
        been worked off, and for some time more; without that answer."""
        await self.send(*commands, "GETSTARTPOSES")
        found: list[Line] = []
        moment = self.clock.after(REPLY)
        while (line := await self._line_by(moment)) is not None:
            if line.head == "NFO" and "StartPoses" in line.names:
                break
            found.append(line)
        return [*found, *await self.listen(seconds)]

    async def is_alive(self, within: float = REPLY) -> bool:
        """Whether the connection still answers GETSTARTPOSES."""
        try:
            await self.send("GETSTARTPOSES")
            return await self.maybe("NFO {StartPoses", within) is not None
        except Hangup:
            return False

    @property
    def rest(self) -> bytes:
        """Bytes of a line that has not ended."""
        return self._cutter.rest

    def close(self) -> None:
        """Hang up."""
        self.wire.close()


def _acceptor(wanted: Wanted) -> Callable[[Line], bool]:
    if isinstance(wanted, str):
        # Without blanks, so that servers that glue segments are understood as well.
        plain = wanted.replace(" ", "")
        return lambda line: line.text.replace(" ", "").startswith(plain)
    return wanted


@dataclass
class Robot:
    """A robot in the world, and the connection that owns it."""

    client: ControlClient  # its connection
    name: str  # as in its INIT
    class_name: str  # likewise, without package
    place: Place  # where it was put
    first: Line  # its first STA
    _commanded: bool = False

    async def send(self, *commands: str) -> None:
        """Send commands."""
        self._commanded = True
        await self.client.send(*commands)

    async def wait(self, wanted: Wanted, within: float = REPLY, what: str = "") -> Line:
        """See `ControlClient.wait`."""
        return await self.client.wait(wanted, within, what)

    async def sensor(self, type: str, name: str | None = None, within: float = REPLY) -> Line:
        """The next line of a sensor type, of one item if named.

        Raises:
            Failed: if none comes in time.
        """
        return await self.client.wait(_report_of(type, name), within, f"SEN of type {type}")

    @property
    def now(self) -> float:
        """Simulated s, as far as it is known; from STA, which every dialect has."""
        for line in reversed(self.client.lines):
            if line.head == "STA" and not math.isnan(line.time):
                return line.time
        return self.first.time

    async def run(self, seconds: float) -> list[Line]:
        """Lines until an STA shows that this much simulated time has passed.

        If commands were sent before, or nothing was read for a while, time counts from now on:
        from when they have been executed, and lines from before that are passed over.

        Raises:
            Inconclusive: if simulated time does not pass, or far too slowly.
        """
        clock = self.client.clock
        if self._commanded or clock.now - self.client.read_at > _STALE:
            await self.catch_up()
        found: list[Line] = []
        start = await self._clock(found)
        latest = clock.after(seconds + REPLY)
        while clock.now < latest and (line := await self.client.line()) is not None:
            found.append(line)
            if line.head == "STA" and line.time - start >= seconds - _EXACT:
                return found
        raise Inconclusive(f"no STA has told that {seconds:g} s have passed")

    async def under(self, *commands: str, seconds: float) -> list[Line]:
        """Lines from when commands have been executed until this much simulated time later.

        The question by which that is known goes with them in one write: however busy the machine
        is, nothing that happens in between is missing.

        Raises:
            Inconclusive: if simulated time does not pass, or far too slowly.
        """
        await self.client.send(*commands, "GETSTARTPOSES")
        await self._answered()
        return await self.run(seconds)

    async def catch_up(self) -> None:
        """Read on to the reply to a request: all commands before it have been executed then, and
        what is read next was said after that."""
        await self.client.send("GETSTARTPOSES")
        await self._answered()

    async def _answered(self) -> None:
        self._commanded = False
        await self.client.maybe("NFO {StartPoses")

    async def _clock(self, found: list[Line]) -> float:
        line = await self.client.maybe(lambda line: line.head == "STA")
        if line is None or math.isnan(line.time):
            raise Inconclusive("there is no STA with a Time to measure simulated time by")
        found.append(line)
        return line.time

    async def pose(self) -> Pose:
        """Where it is, from its next GroundTruth line, or INS without that.

        Raises:
            NotApplicable: if it has no such sensor.
        """
        for type in ("GroundTruth", "INS"):
            line = await self.client.maybe(_report_of(type), 2.0)
            if line is not None:
                return pose_of(line)
        raise NotApplicable("the robot has no GroundTruth and no INS to tell where it is")

    async def odometry(self) -> tuple[float, ...]:
        """x, y, theta of its next Odometry line."""
        return (await self.sensor("Odometry")).numbers("Pose")

    def close(self) -> None:
        """Hang up; the robot leaves the world."""
        self.client.close()


def _report_of(type: str, name: str | None = None) -> Callable[[Line], bool]:
    def wanted(line: Line) -> bool:
        named = name is None or any(item.get("Name") == name for item in line.items())
        return line.head == "SEN" and line.type == type and named

    return wanted


def pose_of(line: Line) -> Pose:
    """The pose that a line with Location and Orientation tells.

    Raises:
        Failed: if it does not.
    """
    location, orientation = line.numbers("Location"), line.numbers("Orientation")
    if len(location) != 3 or len(orientation) != 3 or not all(map(math.isfinite, location)):
        raise Failed(f"Location or Orientation is not three numbers: {line}")
    return Pose(location, orientation)
