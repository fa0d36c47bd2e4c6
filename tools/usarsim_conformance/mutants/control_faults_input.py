"""Faults in what the small server understands; the name of a class says what it does wrong."""

from __future__ import annotations

import asyncio
import math
import re

from usarsim_conformance.mutants.control_faults import Pairs, fault
from usarsim_conformance.mutants.control_server import Session
from usarsim_conformance.mutants.control_text import pairs_of

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
    quiet = 0


@fault("control.init.prompt")
class SlowStart(Session):
    quiet = 26


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
