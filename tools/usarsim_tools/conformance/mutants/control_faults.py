"""What the small server of the control port can get wrong, and which check is meant to notice."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Callable

from usarsim_tools.conformance.mutants.control_server import Session
from usarsim_tools.conformance.mutants.control_text import fixed, pairs_of, vector
from usarsim_tools.conformance.mutants.control_world import MiniBody

__all__ = ["FAULTS"]

Pairs = list[tuple[str, str]]

FAULTS: dict[str, tuple[type[Session], str, str]] = {}
"""By name: the faulty server, the check that is meant to notice, and the dialect to judge, empty
for all."""


def fault(check: str, dialect: str = "ut2004") -> Callable[[type[Session]], type[Session]]:
    """Enter a faulty server into `FAULTS` under the name of its class."""

    def enter(kind: type[Session]) -> type[Session]:
        FAULTS[kind.__name__] = (kind, check, dialect)
        return kind

    return enter


# Lines going out.


@fault("control.connection.crlf")
class EndsWithLf(Session):
    line_end = b"\n"


@fault("control.connection.no-empty-lines")
class EmptyLines(Session):
    line_end = b"\r\n\r\n"


@fault("control.connection.separation")
class GluedSegments(Session):
    def joined(self, head: str, *segments: tuple[str, str]) -> str:
        text = super().joined(head, *segments)
        return text.replace("} {", "}{") if head == "GEO" else text


@fault("control.connection.blanks")
class BlankAtTheEnd(Session):
    line_end = b" \r\n"


@fault("control.connection.braces")
class OpenBrace(Session):
    def joined(self, head: str, *segments: tuple[str, str]) -> str:
        text = super().joined(head, *segments)
        return text[:-1] if head == "STA" else text


@fault("control.connection.heads")
class LowerCaseHead(Session):
    def joined(self, head: str, *segments: tuple[str, str]) -> str:
        return super().joined("sen" if head == "SEN" else head, *segments)


@fault("control.connection.greeting")
class NoGreeting(Session):
    def greet(self) -> None:
        pass


@fault("control.connection.greeting")
class GreetsWithStartPoses(Session):
    def greet(self) -> None:
        self.send("NFO {StartPoses 0}")


@fault("control.connection.greeting-segments")
class GreetingWithoutLimit(Session):
    def greet(self) -> None:
        self.send("NFO {Gametype BotDeathMatch} {Level Mini}")


@fault("control.connection.greeting-level")
class LevelInfo(Session):
    def greet(self) -> None:
        self.send("NFO {Gametype BotDeathMatch} {Level Mini.LevelInfo0} {TimeLimit 20}")


@fault("control.connection.quiet")
class KeepsAlive(Session):
    async def serve(self) -> None:
        beat = asyncio.create_task(self._beat())
        try:
            await super().serve()
        finally:
            beat.cancel()

    async def _beat(self) -> None:
        while True:
            await asyncio.sleep(2.0)
            self.send("PING")


@fault("control.connection.whole-lines")
class TornLines(Session):
    tail = b""

    def send(self, text: str) -> None:
        data = text.encode() + b"\r\n"
        if self.tail:
            self.tail += data
        elif text.startswith("STA"):
            self.writer.write(data[:20])
            self.tail = data[20:]
            asyncio.get_running_loop().call_later(0.005, self._finish)
        else:
            self.writer.write(data)

    def _finish(self) -> None:
        if not self.writer.is_closing():
            self.writer.write(self.tail)
        self.tail = b""


@fault("control.connection.half-close")
class IgnoresHalfClose(Session):
    def leave(self) -> None:
        if self.reader.at_eof() and self.body is not None:
            asyncio.get_running_loop().call_later(8.0, super().leave)
        else:
            super().leave()


@fault("control.connection.again")
class KeepsNames(Session):
    taken: set[str] = set()  # noqa: RUF012  (shared on purpose)

    async def do_init(self, segments: Pairs) -> None:
        name = self.get(segments, "Name") or ""
        if name not in self.taken or name == "Survey":
            self.taken.add(name)
            await super().do_init(segments)


# Lines coming in.


@fault("control.input.lf")
class NeedsCr(Session):
    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        *lines, rest = re.split(rb"\r\n?", data)
        return [line.strip(b"\n") for line in lines if line.strip()], rest


@fault("control.input.cr")
class NeedsLf(Session):
    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        *lines, rest = data.split(b"\n")
        return [line.strip(b"\r") for line in lines if line.strip()], rest


@fault("control.input.split")
class NoBuffer(Session):
    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        return [line for line in re.split(rb"[\r\n]", data) if line], b""


@fault("control.input.packet")
class FirstOfAPacket(Session):
    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        lines, rest = super().cut(data)
        return lines[:1], rest


@fault("control.input.blank-lines")
class AnswersBlankLines(Session):
    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        lines, rest = super().cut(data)
        if data.endswith(b"\r\n\r\n") or data.isspace():
            self.send("ERROR")
        return lines, rest


@fault("control.input.glued")
class DropsGlued(Session):
    def split(self, line: str) -> list[str]:
        return [line]


@fault("control.input.outer-blanks")
class MindsBlanks(Session):
    async def obey(self, line: str) -> None:
        await super().obey(line)

    def split(self, line: str) -> list[str]:
        return [line]

    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        lines, rest = super().cut(data)
        return [line for line in lines if not line.startswith(b" ")], rest


@fault("control.grammar.case")
class SegmentsInOneCase(Session):
    segment_case = False


@fault("control.init.case")
class CommandsInCapitals(Session):
    command_case = False


@fault("control.grammar.unknown-command")
class AnswersUnknown(Session):
    def unknown(self, line: str) -> None:
        self.send("ERROR {Reason unknown command}")


@fault("control.grammar.bare-name")
class StopsAtBareName(Session):
    def segments(self, line: str) -> Pairs:
        found = pairs_of(line)
        bare = next((n for n, (_, value) in enumerate(found) if not value), len(found))
        return found[:bare]


@fault("control.grammar.first-wins")
class LastWins(Session):
    def segments(self, line: str) -> Pairs:
        return pairs_of(line)[::-1]


@fault("control.grammar.open-brace")
class NeedsAllBraces(Session):
    async def obey(self, line: str) -> None:
        if line.count("{") == line.count("}"):
            await super().obey(line)


@fault("control.grammar.booleans")
class LowerCaseTrue(Session):
    async def do_drive(self, segments: Pairs) -> None:
        await super().do_drive(segments)
        light = self.get(segments, "Light")
        self.light = light == "true" if light is not None else self.light


@fault("control.grammar.numbers")
class NoDecimalComma(Session):
    def number(self, text: str) -> float:
        return super().number(text.partition(",")[0])


@fault("control.grammar.number-junk")
class StrictNumbers(Session):
    def number(self, text: str) -> float:
        return super().number(text) if re.fullmatch(r"[-+.,\de]+", text) else 0.0


@fault("control.grammar.not-finite")
class TakesNan(Session):
    def number(self, text: str) -> float:
        return math.nan if "nan" in text.lower() else super().number(text)

    def limited(self, speed: float) -> float:
        if math.isnan(speed) and self.body is not None:
            self.body.location[0] = speed
        return super().limited(speed)


@fault("control.grammar.vector-blanks")
class VectorsNeedCommas(Session):
    def vector(self, text: str) -> list[float]:
        return super().vector(text) if "," in text else [0.0, 0.0, 0.0]


@fault("control.grammar.vector-zeros")
class OctalNumbers(Session):
    def vector(self, text: str) -> list[float]:
        octal = re.search(r"(?<![\d.])-?0\d", text)
        return [0.0, 0.0, 0.0] if octal else super().vector(text)


@fault("control.robust.garbage")
class ClosesOnGarbage(Session):
    def unknown(self, line: str) -> None:
        self.writer.close()


@fault("control.robust.long-line")
class ShortLines(Session):
    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        lines, rest = super().cut(data)
        return [line for line in lines if len(line) < 4096], rest


@fault("control.robust.request-flood")
class DropsReplies(Session):
    def reply(self, head: str, *segments: tuple[str, str]) -> None:
        if self.writer.transport.get_write_buffer_size() == 0 and not self._often():
            super().reply(head, *segments)

    def _often(self) -> bool:
        self.count = getattr(self, "count", 0) + 1
        return self.count > 50


@fault("control.robust.slow-reader")
class WaitsForReaders(Session):
    lock = asyncio.Lock()

    async def stream(self, head: str, *segments: tuple[str, str]) -> None:
        async with self.lock:
            self.send(self.joined(head, *segments))
            await self.writer.drain()

    def send(self, text: str) -> None:
        self.writer.transport.set_write_buffer_limits(high=1)
        super().send(text)


@fault("control.robust.isolated")
class TellsEverybody(Session):
    everybody: set[Session] = set()  # noqa: RUF012  (shared on purpose)

    def greet(self) -> None:
        super().greet()
        self.everybody.add(self)

    def reply(self, head: str, *segments: tuple[str, str]) -> None:
        if head != "CONF":
            super().reply(head, *segments)
            return
        for one in self.everybody:
            one.send(self.joined(head, *segments))


# INIT.


@fault("control.init.spawns")
class NoRobots(Session):
    async def do_init(self, segments: Pairs) -> None:
        pass


@fault("control.init.silent")
class AnswersInit(Session):
    async def do_init(self, segments: Pairs) -> None:
        await super().do_init(segments)
        self.send("RES {Time 0.00} {Type Robot} {Status OK}")


@fault("control.init.quiet-period")
class NoQuiet(Session):
    quiet = 0.02


@fault("control.init.prompt")
class SlowStart(Session):
    quiet = 2.3


@fault("control.init.unknown-class")
class ClosesOnUnknownClass(Session):
    async def do_init(self, segments: Pairs) -> None:
        await super().do_init(segments)
        if self.body is None:
            self.writer.close()


@fault("control.init.no-package")
class NeedsPackage(Session):
    def knows(self, class_name: str) -> bool:
        return "." in class_name and super().knows(class_name)


@fault("control.init.class-case")
class ClassesInOneCase(Session):
    def knows(self, class_name: str) -> bool:
        return class_name == class_name.replace("p2at", "") and super().knows(class_name)


@fault("control.init.no-name")
class NeedsName(Session):
    async def do_init(self, segments: Pairs) -> None:
        if self.get(segments, "Name"):
            await super().do_init(segments)


@fault("control.init.start")
class StartsInOneCase(Session):
    async def do_init(self, segments: Pairs) -> None:
        tags = [tag for tag, _ in self.world.starts]
        await super().do_init([pair for pair in segments if pair[0] != "Start" or pair[1] in tags])


@fault("control.init.second")
class SecondRobot(Session):
    async def do_init(self, segments: Pairs) -> None:
        if self.body is not None and self.flow is not None:
            self.flow.cancel()
            self.world.bodies.remove(self.body)
            self.body = None
        await super().do_init(segments)


@fault("control.init.battery")
class IgnoresBattery(Session):
    async def do_init(self, segments: Pairs) -> None:
        await super().do_init([pair for pair in segments if pair[0] != "Battery"])


@fault("control.init.start-poses-count")
class MiscountsPoses(Session):
    def reply(self, head: str, *segments: tuple[str, str]) -> None:
        if segments[0][0] == "StartPoses":
            segments = (("StartPoses", "3"), *segments[1:])
        super().reply(head, *segments)


@fault("control.init.location")
class DropsNear(Session):
    async def do_init(self, segments: Pairs) -> None:
        await super().do_init(segments)
        if self.body is not None and self.get(segments, "Start") is None:
            self.body.location[0] += 0.3


# Dialects.


@fault("control.dialect.classname", "")
class ClassnameIsClassName(Session):
    def choose_dialect(self, segments: Pairs) -> None:
        super().choose_dialect([pair for pair in segments if pair[0] == "Dialect"])


@fault("control.dialect.actuator", "")
class ActuatorIsNoSign(Session):
    def switch(self) -> None:
        pass


# STA.


@fault("control.status.ground-ut2004")
class StatusOrder(Session):
    def status(self, when: float) -> Pairs:
        found = super().status(when)
        return [found[1], found[6], found[0], *found[2:6], found[7]]


@fault("control.status.integers")
class BatteryWithPoint(Session):
    def status(self, when: float) -> Pairs:
        return [
            (name, f"{value}.00" if name == "Battery" else value)
            for name, value in super().status(when)
        ]


@fault("control.status.time")
class StatusWithoutTime(Session):
    def status(self, when: float) -> Pairs:
        if self.body is not None and self.body.age > 0.5:
            return [pair for pair in super().status(when) if pair[0] != "Time"]
        return super().status(when)


@fault("control.status.rate")
class SlowStatus(Session):
    sta_every = {"ut2004": 5, "udk": 5}  # noqa: RUF012


@fault("control.status.light")
class NoLight(Session):
    async def do_drive(self, segments: Pairs) -> None:
        await super().do_drive([pair for pair in segments if pair[0] != "Light"])


@fault("control.status.light-moves-nothing")
class LightDrives(Session):
    async def do_drive(self, segments: Pairs) -> None:
        await super().do_drive(segments)
        if self.body is not None and self.get(segments, "Light"):
            self.body.left = self.body.right = 2.0


@fault("control.status.battery-dead")
class SensesForEver(Session):
    async def moment(self, tick: int) -> None:
        await super().moment(tick)
        if self.body is not None and self.body.dead:
            await self.report("Touch", self.now())


# Sensors.


@fault("control.sensors.timed")
class SonarWithoutTime(Session):
    def timed(self, type: str) -> bool:
        return type != "Sonar" and super().timed(type)


@fault("control.sensors.untimed")
class EverythingTimed(Session):
    def timed(self, type: str) -> bool:
        return True


@fault("control.sensors.timed-udk", "udk")
class NothingTimed(Session):
    def timed(self, type: str) -> bool:
        return False


@fault("control.sensors.order")
class NameBeforeType(Session):
    def joined(self, head: str, *segments: tuple[str, str]) -> str:
        found = list(segments)
        if head == "SEN" and found[0][0] == "Type":
            found[0], found[1] = found[1], found[0]
        return super().joined(head, *found)


@fault("control.sensors.named")
class NamelessSensor(Session):
    def joined(self, head: str, *segments: tuple[str, str]) -> str:
        if ("Type", "INS") in segments:
            segments = tuple(pair for pair in segments if pair[0] != "Name")
        return super().joined(head, *segments)


@fault("control.sensors.batched")
class NeverBatched(Session):
    def batched(self, type: str) -> bool:
        return False


@fault("control.sensors.single", "udk")
class AlwaysBatched(Session):
    def batched(self, type: str) -> bool:
        return type == "Sonar"


@fault("control.sensors.scan-right-first")
class ScanFromTheLeft(Session):
    def scan(self, body: MiniBody) -> Pairs:
        *first, (name, text) = super().scan(body)
        return [*first, (name, ",".join(text.split(",")[::-1]))]


@fault("control.sensors.scan-count")
class OneRangeTooMany(Session):
    def scan(self, body: MiniBody) -> Pairs:
        *first, (name, text) = super().scan(body)
        return [*first, (name, f"{text},{text}")]


@fault("control.sensors.scan-order")
class FovInLowerCase(Session):
    def scan(self, body: MiniBody) -> Pairs:
        return [("Fov" if name == "FOV" else name, text) for name, text in super().scan(body)]


@fault("control.sensors.scan-numbers")
class CommasMissing(Session):
    def scan(self, body: MiniBody) -> Pairs:
        *first, (name, text) = super().scan(body)
        return [*first, (name, text.replace(",", " "))]


@fault("control.sensors.scan-miss")
class MissIsFarAway(Session):
    def scan(self, body: MiniBody) -> Pairs:
        *first, (name, text) = super().scan(body)
        return [*first, (name, text.replace("20.0000", "99.0000"))]


@fault("control.sensors.encoder-forward")
class EncoderBackwards(Session):
    def data(self, type: str, index: int) -> Pairs:
        found = super().data(type, index)
        return [("Tick", str(-int(found[0][1])))] if type == "Encoder" else found


@fault("control.sensors.odometry-clockwise")
class OdometryAnticlockwise(Session):
    def data(self, type: str, index: int) -> Pairs:
        if type == "Odometry" and self.body is not None:
            x, y, theta = self.body.reckoned
            return [("Pose", vector([x, -y, -theta], 4))]
        return super().data(type, index)


@fault("control.sensors.odometry-start")
class OdometryInTheWorld(Session):
    def data(self, type: str, index: int) -> Pairs:
        if type == "Odometry" and self.body is not None:
            return [("Pose", vector([*self.body.location[:2], self.body.angles[2]], 4))]
        return super().data(type, index)


@fault("control.digits.groundtruth")
class FourDigits(Session):
    def data(self, type: str, index: int) -> Pairs:
        if type == "GroundTruth" and self.body is not None:
            return [("Location", vector(self.body.location, 4)), *super().data(type, index)[1:]]
        return super().data(type, index)


@fault("control.numbers.plain")
class Exponents(Session):
    def data(self, type: str, index: int) -> Pairs:
        return [("Range", "5.0e+00")] if type == "Sonar" else super().data(type, index)


@fault("control.numbers.vectors")
class BlanksInVectors(Session):
    def told_pose(self, type: str, body: MiniBody) -> tuple[list[float], list[float]]:
        return super().told_pose(type, body)

    def data(self, type: str, index: int) -> Pairs:
        return [(name, text.replace(",", ", ")) for name, text in super().data(type, index)]


@fault("control.numbers.booleans")
class LowerCaseFalse(Session):
    def data(self, type: str, index: int) -> Pairs:
        return [("Touch", "false")] if type == "Touch" else super().data(type, index)


# Frames and time.


class _Posed(Session):
    """Tells another pose than that of the wire frame."""

    def changed(self, location: list[float], angles: list[float]) -> None:
        """Spoil location and angles in place."""

    def told_pose(self, type: str, body: MiniBody) -> tuple[list[float], list[float]]:
        location, angles = (list(values) for values in super().told_pose(type, body))
        self.changed(location, angles)
        return location, angles


@fault("control.frames.down")
class PointsUp(_Posed):
    def changed(self, location: list[float], angles: list[float]) -> None:
        location[2] = -location[2]


@fault("control.frames.clockwise")
class YawAnticlockwise(_Posed):
    def changed(self, location: list[float], angles: list[float]) -> None:
        angles[2] = -angles[2] % math.tau


@fault("control.frames.right")
class LeftHandY(_Posed):
    def changed(self, location: list[float], angles: list[float]) -> None:
        location[1] = -location[1]


@fault("control.frames.pitch")
class NoseDownIsPositive(_Posed):
    def changed(self, location: list[float], angles: list[float]) -> None:
        angles[1] = -angles[1] % math.tau


@fault("control.frames.roll")
class LeftDownIsPositive(_Posed):
    def changed(self, location: list[float], angles: list[float]) -> None:
        angles[0] = -angles[0] % math.tau


@fault("control.frames.facing")
class DegreesIn(Session):
    async def do_init(self, segments: Pairs) -> None:
        await super().do_init(segments)
        if self.body is not None:
            self.body.angles = [math.radians(angle) for angle in self.body.angles]


@fault("control.frames.ins-angles")
class SignedAngles(_Posed):
    def changed(self, location: list[float], angles: list[float]) -> None:
        angles[:] = [math.remainder(angle, math.tau) for angle in angles]


@fault("control.time.monotonic")
class TimeJumps(Session):
    async def report(self, type: str, when: float) -> None:
        await super().report(type, when - (0.5 if round(when * 10) % 4 == 0 else 0.0))


@fault("control.time.shared")
class OwnClock(Session):
    def now(self) -> float:
        self.zero = getattr(self, "zero", self.world.time)
        return self.world.time - self.zero


# CONF and GEO.


@fault("control.conf.ground")
class NameFirst(Session):
    def robot_conf(self) -> Pairs:
        first, second, *rest = super().robot_conf()
        return [second, first, *rest]


@fault("control.geo.ground")
class WheelsMissing(Session):
    def robot_geo(self) -> Pairs:
        return super().robot_geo()[:4]


@fault("control.conf.class-name")
class NameOfInit(Session):
    def robot_conf(self) -> Pairs:
        return [(name, "Kit" if name == "Name" else text) for name, text in super().robot_conf()]


@fault("control.conf.every-item")
class SilentItems(Session):
    def tell_items(self, head: str, told: str, type: str, items: list[str]) -> None:
        if type != "Touch":
            super().tell_items(head, told, type, items)


@fault("control.conf.by-type")
class OneLineEach(Session):
    def tell_items(self, head: str, told: str, type: str, items: list[str]) -> None:
        for item in items:
            super().tell_items(head, told, type, [item])


@fault("control.conf.named-item")
class AllWhateverTheName(Session):
    def tell_items(self, head: str, told: str, type: str, items: list[str]) -> None:
        super().tell_items(head, told, type, list(self.items(type)))


@fault("control.conf.no-match")
class BareReply(Session):
    def no_match(self, head: str, type: str) -> None:
        self.reply(head, ("Type", type))


@fault("control.conf.canonical")
class EchoesType(Session):
    def told_type(self, type: str, asked: str) -> str:
        return asked


@fault("control.geo.sensors-ut2004")
class GeoInSegments(Session):
    def item(self, head: str, type: str, name: str) -> Pairs:
        if head == "CONF":
            return super().item(head, type, name)
        place = vector(self.mount(), 4)
        return [
            ("Name", name),
            ("Location", place),
            ("Orientation", "0.0000,0.0000,0.0000"),
            ("Mount", "HARD"),
        ]


@fault("control.geo.body-frame")
class MountsInTheWorld(Session):
    def mount(self) -> tuple[float, float, float]:
        assert self.body is not None
        x, y, z = super().mount()
        cos, sin = math.cos(self.body.angles[2]), math.sin(self.body.angles[2])
        return cos * x - sin * y, sin * x + cos * y, z


@fault("control.conf.scanner")
class FovInCapitals(Session):
    def item_conf(self, type: str) -> Pairs:
        return [("FOV" if name == "Fov" else name, text) for name, text in super().item_conf(type)]


# Driving.


@fault("control.motion.forward")
class Backwards(Session):
    def limited(self, speed: float) -> float:
        return -super().limited(speed)


@fault("control.motion.clockwise")
class SidesSwapped(Session):
    def turn_wheels(
        self, body: MiniBody, left: str | None, right: str | None, percent: bool
    ) -> None:
        super().turn_wheels(body, right, left, percent)


@fault("control.motion.stops")
class ZeroIsNothing(Session):
    def turn_wheels(
        self, body: MiniBody, left: str | None, right: str | None, percent: bool
    ) -> None:
        if left is None or self.number(left) != 0.0:
            super().turn_wheels(body, left, right, percent)


@fault("control.motion.rests")
class Creeps(Session):
    async def moment(self, tick: int) -> None:
        await super().moment(tick)
        if self.body is not None:
            self.body.location[0] += 0.02


@fault("control.motion.speed")
class WheelsOfAnotherSize(Session):
    def robot_geo(self) -> Pairs:
        changed = {"WheelRadius": fixed(0.15, 4)}
        return [(name, changed.get(name, text)) for name, text in super().robot_geo()]


@fault("control.motion.persists")
class Watchdog(Session):
    async def moment(self, tick: int) -> None:
        await super().moment(tick)
        if self.body is not None and tick - getattr(self, "driven", tick) > 25:
            self.body.left = self.body.right = 0.0

    async def do_drive(self, segments: Pairs) -> None:
        await super().do_drive(segments)
        self.driven = math.floor(self.now() / 0.1)


@fault("control.motion.clamped")
class NoLimit(Session):
    def limited(self, speed: float) -> float:
        return max(-9.0, min(9.0, speed))


@fault("control.motion.normalized")
class PercentIgnored(Session):
    def percent(self, segments: Pairs) -> bool:
        return False


@fault("control.motion.normalized-once")
class PercentSticks(Session):
    def percent(self, segments: Pairs) -> bool:
        dialect, self.dialect = self.dialect, "udk"
        try:
            return super().percent(segments)
        finally:
            self.dialect = dialect


@fault("control.motion.one-side")
class NeedsBothSides(Session):
    def turn_wheels(
        self, body: MiniBody, left: str | None, right: str | None, percent: bool
    ) -> None:
        if left is not None and right is not None:
            super().turn_wheels(body, left, right, percent)


@fault("control.motion.flip-over")
class NoFlip(Session):
    async def do_drive(self, segments: Pairs) -> None:
        await super().do_drive([pair for pair in segments if pair[0] != "Flip"])


# SET.


@fault("control.set.odometry-reset")
class NoReset(Session):
    def reset(self) -> None:
        pass


@fault("control.set.result")
class NoResult(Session):
    def result(self, type: str, name: str) -> None:
        pass


@fault("control.set.no-result-udk", "udk")
class ResultInUdk(Session):
    def result(self, type: str, name: str) -> None:
        self.reply("RES", ("Time", "1.00"), ("Type", type), ("Name", name), ("Status", "OK"))


@fault("control.set.ins-pose")
class NoEstimate(Session):
    def estimate(self, params: str) -> None:
        pass
