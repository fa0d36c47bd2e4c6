"""A small healthy server of the control port; faults override its methods one by one."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from collections.abc import AsyncIterator, Sequence

from usarsim_tools.conformance.mutants.control_text import (
    fixed,
    pairs_of,
    read_number,
    read_vector,
    vector,
)
from usarsim_tools.conformance.mutants.control_world import (
    MASS,
    MAX_SPEED,
    RADIUS,
    SEPARATION,
    MiniBody,
    MiniWorld,
)

__all__ = ["SPEED", "Session", "control_server"]

SPEED = 4.0
"""Simulated seconds per second: checks take less time."""
_QUIET = 0.27
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
_NAMES = {
    "RangeScanner": ("Scanner1",),
    "Sonar": tuple(f"{side}{number}" for side in "FR" for number in range(1, 9)),
    "Odometry": ("Odometry",),
    "INS": ("INS",),
    "GroundTruth": ("GroundTruth",),
    "Encoder": ("ECLeft", "ECRight"),
    "Touch": ("Bumper",),
}
_BATCHED = ("Sonar", "Encoder", "Touch")
_FOV, _RESOLUTION, _REACH = 3.1415, 0.0872, 20.0


class Session:
    """One connection. Every method is a decision that a fault may take otherwise."""

    line_end = b"\r\n"
    quiet = _QUIET
    command_case = True
    segment_case = True
    sta_every: dict[str, int] = {"ut2004": 2, "udk": 1}  # noqa: RUF012  (faults replace it)
    names = _NAMES

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

    async def describe(self, head: str, segments: list[tuple[str, str]]) -> None:
        """Answer GETCONF or GETGEO."""
        asked, name = self.get(segments, "Type") or "", self.get(segments, "Name")
        if asked.lower() == "robot":
            self.reply(head, *(self.robot_conf() if head == "CONF" else self.robot_geo()))
            return
        type = next((known for known in self.names if known.lower() == asked.lower()), "")
        items = [one for one in self.items(type) if name in (None, one)]
        if not items:
            self.no_match(head, asked)
            return
        self.tell_items(head, self.told_type(type, asked), type, items)

    def told_type(self, type: str, asked: str) -> str:
        """The spelling of a type in replies."""
        return type

    def no_match(self, head: str, type: str) -> None:
        """Silence."""

    def tell_items(self, head: str, told: str, type: str, items: list[str]) -> None:
        """All items in one line."""
        segments = [part for name in items for part in self.item(head, type, name)]
        self.reply(head, ("Type", told), *segments)

    def items(self, type: str) -> tuple[str, ...]:
        """Names of the items of a type."""
        if type == "Encoder" and self.dialect == "udk":
            return ("W0", "W1")
        return self.names.get(type, ())

    def robot_conf(self) -> list[tuple[str, str]]:
        """What the robot is."""
        zero = "0" if self.dialect == "udk" else "0.0000"
        first = [("Type", "GroundVehicle"), ("Name", "P2AT")]
        return [
            *(first if self.dialect == "ut2004" else first[::-1]),
            ("SteeringType", "SkidSteered"),
            ("Mass", fixed(MASS, 4)),
            ("MaxSpeed", fixed(MAX_SPEED, 4)),
            ("MaxTorque", "60.0000"),
            ("MaxFrontSteer", zero),
            ("MaxRearSteer", zero),
        ]

    def robot_geo(self) -> list[tuple[str, str]]:
        """How large the robot is."""
        return [
            ("Type", "GroundVehicle"),
            ("Name", "P2AT"),
            ("Dimensions", "0.5000,0.4000,0.3000"),
            ("COG", "0.0000,0.0000,0.0000"),
            ("WheelRadius", fixed(RADIUS, 4)),
            ("WheelSeparation", fixed(SEPARATION, 4)),
            ("WheelBase", "0.3000"),
        ]

    def item(self, head: str, type: str, name: str) -> list[tuple[str, str]]:
        """What one sensor is, or where."""
        if head == "CONF":
            return [("Name", name), *self.item_conf(type)]
        mount = self.mount()
        if self.dialect == "ut2004":
            place, turn = vector(mount, 4), vector((0, 0, 0), 4)
            return [("Name", f"{name} Location {place} Orientation {turn} Mount HARD")]
        return [
            ("Name", name),
            ("Location", vector(mount, 2)),
            ("Orientation", vector((0, 0, 0), 2)),
            ("Mount", "P2AT"),
        ]

    def mount(self) -> tuple[float, float, float]:
        """Where sensors sit on the body."""
        return (0.1, 0.05, -0.1)

    def item_conf(self, type: str) -> list[tuple[str, str]]:
        """Ranges and the like."""
        limits = [("MaxRange", "5.0000"), ("MinRange", "0.1000")]
        if type == "Sonar":
            return limits
        if type != "RangeScanner":
            return []
        flag = "Paning" if self.dialect == "ut2004" else "Panning"
        return [
            ("MaxRange", fixed(_REACH, 4)),
            ("MinRange", "0.1000"),
            ("Resolution", fixed(_RESOLUTION, 4)),
            ("Fov", fixed(_FOV, 4)),
            (flag, "True"),
            ("Tilting", "False"),
        ]

    # Reports.

    async def run(self) -> None:
        """Stream reports, every 0.1 s of simulated time; none is left out."""
        assert self.body is not None
        await asyncio.sleep(self.quiet)
        tick = math.floor(self.now() / _TICK)
        while True:
            await asyncio.sleep(max(0.0, tick * _TICK - self.now()) / SPEED)
            await self.moment(tick)
            tick += 1

    def now(self) -> float:
        """Simulated s, as this connection is told."""
        return self.world.time

    async def moment(self, tick: int) -> None:
        """What is due at a moment."""
        body = self.body
        assert body is not None
        body.advance(_TICK)
        when = tick * _TICK
        if tick % self.sta_every[self.dialect] == 0:
            await self.stream("STA", *self.status(when))
        if body.dead:
            return
        for type in self.names:
            if type != "RangeScanner" or tick % 2 == 0:
                await self.report(type, when)

    def status(self, when: float) -> list[tuple[str, str]]:
        """Segments of STA."""
        assert self.body is not None
        digits = 2 if self.dialect == "ut2004" else 4
        battery = max(0, math.floor(self.body.battery - self.body.age))
        return [
            ("Type", "GroundVehicle"),
            ("Time", fixed(when, digits)),
            ("FrontSteer", "0.0000"),
            ("RearSteer", "0.0000"),
            ("LightToggle", str(self.light)),
            ("LightIntensity", "100" if self.light or self.dialect == "udk" else "0"),
            ("Battery", str(battery)),
            ("View", "-1"),
        ]

    def timed(self, type: str) -> bool:
        """Whether reports of a type have a Time."""
        if self.dialect == "udk":
            return type != "INS"
        return type in ("Sonar", "RangeScanner", "GroundTruth")

    def batched(self, type: str) -> bool:
        """Whether all items of a type share a line."""
        return self.dialect == "ut2004" and type in _BATCHED

    async def report(self, type: str, when: float) -> None:
        """SEN of all items of a type."""
        digits = 2 if type == "RangeScanner" and self.dialect == "ut2004" else 4
        first = [("Time", fixed(when, digits))] if self.timed(type) else []
        first.append(("Type", type))
        items = [(name, self.data(type, index)) for index, name in enumerate(self.items(type))]
        if self.batched(type):
            data = [("Name", " ".join([name, *pair])) for name, pairs in items for pair in pairs]
            await self.stream("SEN", *first, *data)
            return
        for name, pairs in items:
            await self.stream("SEN", *first, ("Name", name), *pairs)

    def data(self, type: str, index: int) -> list[tuple[str, str]]:
        """What an item measures."""
        body = self.body
        assert body is not None
        match type:
            case "RangeScanner":
                return self.scan(body)
            case "Sonar":
                return [("Range", "5.0000")]
            case "Odometry":
                return [("Pose", vector(body.reckoned, 4))]
            case "Encoder":
                ticks = math.trunc(math.degrees(body.rolled[index]))
                return [
                    ("Tick", str(int(math.fmod(ticks, 360)) if self.dialect == "udk" else ticks))
                ]
            case "Touch":
                return [("Touch", "False")]
        digits = 3 if type == "GroundTruth" and self.dialect == "udk" else 2
        location, angles = self.told_pose(type, body)
        return [("Location", vector(location, digits)), ("Orientation", vector(angles, digits))]

    def told_pose(self, type: str, body: MiniBody) -> tuple[list[float], list[float]]:
        """Location and angles as GroundTruth or INS tell them."""
        if type == "GroundTruth" and self.dialect == "udk":
            return body.location, [math.remainder(angle, math.tau) for angle in body.angles]
        offset = self.believed if type == "INS" else (0.0, 0.0, 0.0)
        location = [a + b for a, b in zip(body.location, offset, strict=True)]
        return location, [angle % math.tau for angle in body.angles]

    def scan(self, body: MiniBody) -> list[tuple[str, str]]:
        """A scan, from the right to the left."""
        count = math.floor(_FOV / _RESOLUTION) + 1
        ranges = self.world.ranges(body, _FOV, count, _REACH)
        digits = 4 if self.dialect == "ut2004" else 2
        return [
            ("Resolution", fixed(_RESOLUTION, 4)),
            ("FOV", fixed(_FOV, 4)),
            ("Range", vector(ranges, digits)),
        ]


@contextlib.asynccontextmanager
async def control_server(kind: type[Session] = Session) -> AsyncIterator[int]:
    """A server while inside; its port.

    Args:
        kind: what serves each connection; a fault, or the healthy `Session`.
    """
    world = MiniWorld(SPEED)
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
        for task in list(serving):
            task.cancel()
        await asyncio.gather(*serving, return_exceptions=True)
