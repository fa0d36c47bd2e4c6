"""A small healthy server of the control port; faults override its methods one by one."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator, Sequence

from usarsim_conformance.mutants.control_reports import Reports
from usarsim_conformance.mutants.control_text import (
    fixed,
    pairs_of,
    read_number,
    read_vector,
    vector,
)
from usarsim_conformance.mutants.control_world import MAX_SPEED, MiniBody, MiniWorld
from usarsim_conformance.mutants.ticks import Ticks

_SPEED = 8.0
"""Simulated seconds per second, at most: checks take less time."""
_QUIET = 3
"""Ticks from INIT to the first report."""
_TICK = 0.1
_LONGEST = 131072
_MOST_WAITING = 1 << 20
_COMMANDS = (
    "INIT",
    "DRIVE",
    "SET",
    "GETCONF",
    "GETGEO",
    "GETSTARTPOSES",
    "GETPATHNODES",
    "CONTROL",
)
_CLASSES = ("p2at",)


class Session(Reports):
    """One connection. Every method is a decision that a fault may take otherwise."""

    line_end = b"\r\n"
    quiet = _QUIET
    command_case = True
    segment_case = True
    sta_every: dict[str, int] = {"ut2004": 2, "udk": 1}  # noqa: RUF012  (faults replace it)

    def __init__(
        self, world: MiniWorld, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self.world = world
        self.reader = reader
        self.writer = writer
        self.body: MiniBody | None = None
        self.dialect = "ut2004"
        self.decided = False
        self.light = False
        self.normalized = False
        self.believed = [0.0, 0.0, 0.0]
        self.flow: asyncio.Task[None] | None = None

    # The connection.

    async def serve(self) -> None:
        """Serve until the client leaves."""
        rest = b""
        try:
            self.greet()
            while data := await self.reader.read(65536):
                lines, rest = self.cut(rest + data)
                for line in lines:
                    for command in self.split(line.decode("latin-1").strip(" \t")):
                        await self.obey(command)
        finally:
            self.leave()

    def leave(self) -> None:
        """The robot goes with its connection."""
        if self.flow is not None:
            self.flow.cancel()
        if self.body in self.world.bodies:
            self.world.bodies.remove(self.body)
        self.writer.close()

    def greet(self) -> None:
        """The first line."""
        self.reply("NFO", ("Gametype", "BotDeathMatch"), ("Level", "Mini"), ("TimeLimit", "20"))

    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        """Whole lines and the rest."""
        *lines, rest = re.split(rb"[\r\n]", data)
        return [line for line in lines if line], rest if len(rest) < _LONGEST else b"x"

    def split(self, line: str) -> list[str]:
        """Commands glued together on a line."""
        words = "|".join(_COMMANDS)
        return re.split(rf"(?<=\}})(?=\s*(?:{words})\s*\{{)", line, flags=re.IGNORECASE)

    def send(self, text: str) -> None:
        """A line, at once and whole."""
        if not self.writer.is_closing():
            self.writer.write(text.encode("latin-1") + self.line_end)

    def joined(self, head: str, *segments: tuple[str, str]) -> str:
        """Head and segments."""
        return " ".join([head, *(f"{{{f'{name} {value}'.strip()}}}" for name, value in segments)])

    def reply(self, head: str, *segments: tuple[str, str]) -> None:
        """Send an answer."""
        self.send(self.joined(head, *segments))

    async def stream(self, head: str, *segments: tuple[str, str]) -> None:
        """Send a report, or drop it if the client does not read."""
        if self.writer.transport.get_write_buffer_size() < _MOST_WAITING:
            self.send(self.joined(head, *segments))

    # Commands.

    async def obey(self, line: str) -> None:
        """Execute a command."""
        word = line.partition("{")[0].replace("}", " ").strip()
        segments = self.segments(line)
        method = getattr(self, f"do_{word.lower()}", None)
        if method is None or (not self.command_case and word != word.upper()):
            self.unknown(line)
        elif self.body is not None or word.upper() in ("INIT", "GETSTARTPOSES", "GETPATHNODES"):
            await method(segments)

    def unknown(self, line: str) -> None:
        """Silence."""

    def segments(self, line: str) -> list[tuple[str, str]]:
        """Arguments of a command."""
        return pairs_of(line)

    def get(self, segments: Sequence[tuple[str, str]], name: str) -> str | None:
        """The first segment of a name."""
        if not self.segment_case:
            return next((value for key, value in segments if key == name), None)
        return next((value for key, value in segments if key.lower() == name.lower()), None)

    def number(self, text: str) -> float:
        """A number of a command."""
        return read_number(text)

    def vector(self, text: str) -> list[float]:
        """A vector of a command."""
        return read_vector(text)

    async def do_getstartposes(self, segments: list[tuple[str, str]]) -> None:
        """Start poses in the flat form."""
        poses = [f"{tag} {vector(place, 4)} {vector((0, 0, 0), 4)}" for tag, place in self.starts()]
        self.reply("NFO", ("StartPoses", str(len(self.starts()))), (" ".join(poses), ""))

    def starts(self) -> list[tuple[str, tuple[float, float, float]]]:
        """Start poses of the map."""
        return self.world.starts

    async def do_getpathnodes(self, segments: list[tuple[str, str]]) -> None:
        """There are none."""
        self.reply("NFO", ("PathNodes", "0"))

    async def do_init(self, segments: list[tuple[str, str]]) -> None:
        """A robot, unless there is one."""
        if self.body is not None or not self.knows(self.get(segments, "ClassName") or ""):
            return
        start = (self.get(segments, "Start") or "").lower()
        places = {tag.lower(): place for tag, place in self.world.starts}
        location = list(places.get(start, self.vector(self.get(segments, "Location") or "")))
        angles = [0.0] * 3 if start else self.vector(self.get(segments, "Rotation") or "")
        battery = self.number(self.get(segments, "Battery") or "1200")
        self.body = MiniBody(self.get(segments, "Name") or "", location, angles, battery)
        self.world.bodies.append(self.body)
        self.choose_dialect(segments)
        self.flow = asyncio.get_running_loop().create_task(self.run())

    def knows(self, class_name: str) -> bool:
        """Whether there are robots of a class."""
        return class_name.lower().rpartition(".")[2] in _CLASSES

    def choose_dialect(self, segments: list[tuple[str, str]]) -> None:
        """What the client asks for, or how it spells."""
        asked = self.get(segments, "Dialect")
        if asked in ("ut2004", "udk"):
            self.dialect, self.decided = asked, True
        elif any(name == "Classname" for name, _ in segments):
            self.dialect, self.decided = "udk", True

    async def do_drive(self, segments: list[tuple[str, str]]) -> None:
        """Wheels and light."""
        body = self.body
        assert body is not None
        light, flip = self.get(segments, "Light"), self.get(segments, "Flip")
        if light is not None:
            self.light = light.lower() in ("true", "1")
        if flip is not None and not body.upright:
            body.angles = [0.0, 0.0, body.angles[2]]
        left, right = self.get(segments, "Left"), self.get(segments, "Right")
        groups = [value for name, value in segments if name.lower() == "wheelspeed"]
        if groups:
            left = right = groups[0]
        self.turn_wheels(body, left, right, self.percent(segments))

    def percent(self, segments: list[tuple[str, str]]) -> bool:
        """Whether speeds are in percent: sticky in udk, for one command in ut2004."""
        text = self.get(segments, "Normalized")
        if text is None:
            return self.normalized and self.dialect == "udk"
        self.normalized = text.lower() in ("true", "1")
        return self.normalized

    def turn_wheels(
        self, body: MiniBody, left: str | None, right: str | None, percent: bool
    ) -> None:
        """Set wheel speeds; in udk one alone does nothing."""
        if self.dialect == "udk" and (left is None) != (right is None):
            return
        scale = MAX_SPEED / 100.0 if percent else 1.0
        if left is not None:
            body.left = self.limited(self.number(left) * scale)
        if right is not None:
            body.right = self.limited(self.number(right) * scale)

    def limited(self, speed: float) -> float:
        """A wheel speed that can be had."""
        return max(-MAX_SPEED, min(MAX_SPEED, speed))

    async def do_set(self, segments: list[tuple[str, str]]) -> None:
        """RESET, SCAN, POSE."""
        type = (self.get(segments, "Type") or "").lower()
        opcode = (self.get(segments, "Opcode") or "").upper()
        if (type, opcode) == ("odometry", "RESET"):
            self.reset()
        elif (type, opcode) == ("rangescanner", "SCAN"):
            await self.report("RangeScanner", self.world.time)
        elif (type, opcode) == ("ins", "POSE"):
            self.estimate(self.get(segments, "Params") or "")
        else:
            return
        self.result(self.get(segments, "Type") or "", self.get(segments, "Name") or "")

    def estimate(self, params: str) -> None:
        """INS believes to be somewhere else."""
        assert self.body is not None
        believed = [self.number(word) for word in params.split(",")[:3]]
        self.believed = [a - b for a, b in zip(believed, self.body.location, strict=True)]

    def reset(self) -> None:
        """Odometry to zero."""
        assert self.body is not None
        self.body.reckoned = [0.0, 0.0, 0.0]

    def result(self, type: str, name: str) -> None:
        """RES, in ut2004 only."""
        if self.dialect == "ut2004":
            now = fixed(self.world.time, 2)
            self.reply("RES", ("Time", now), ("Type", type), ("Name", name), ("Status", "OK"))

    async def do_getconf(self, segments: list[tuple[str, str]]) -> None:
        """CONF of the robot or of sensors."""
        if (self.get(segments, "Type") or "").lower() in ("actuator", "gripper"):
            self.switch()
        await self.describe("CONF", segments)

    def switch(self) -> None:
        """A client of UDK has given itself away."""
        if not self.decided:
            self.dialect, self.decided = "udk", True

    async def do_getgeo(self, segments: list[tuple[str, str]]) -> None:
        """GEO of the robot or of sensors."""
        await self.describe("GEO", segments)

    # Reports.

    async def run(self) -> None:
        """Stream reports, every 0.1 s of simulated time; none is left out."""
        ticks = self.world.ticks
        await ticks.sleep((self.quiet + 1) * _TICK)
        while True:
            await self.moment(ticks.count)
            await ticks.next()

    def now(self) -> float:
        """Simulated s, as this connection is told."""
        return self.world.time

    async def moment(self, tick: int) -> None:
        """What is due at a moment."""
        body = self.body
        assert body is not None
        body.advance(_TICK)
        when = self.now()
        if tick % self.sta_every[self.dialect] == 0:
            await self.stream("STA", *self.status(when))
        if body.dead:
            return
        for type in self.names:
            if type != "RangeScanner" or tick % 2 == 0:
                await self.report(type, when)


@contextlib.asynccontextmanager
async def control_server(kind: type[Session] = Session) -> AsyncIterator[int]:
    """A server while inside; its port.

    Args:
        kind: what serves each connection; a fault, or the healthy `Session`.
    """
    ticks = Ticks(_TICK, _SPEED)
    world = MiniWorld(ticks)
    flow = asyncio.create_task(ticks.run())
    serving: set[asyncio.Task[None]] = set()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        serving.add(task)
        try:
            with contextlib.suppress(ConnectionError):
                await kind(world, reader, writer).serve()
        except asyncio.CancelledError:
            pass  # the server ends
        finally:
            serving.discard(task)

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        flow.cancel()
        for task in list(serving):
            task.cancel()
        await asyncio.gather(*serving, return_exceptions=True)
