"""Faults in how the small server writes; the name of a class says what it does wrong."""

from __future__ import annotations

import asyncio
import math

from usarsim_conformance.mutants.control_faults import Pairs, fault
from usarsim_conformance.mutants.control_server import Session
from usarsim_conformance.mutants.control_text import vector

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
            await self.world.ticks.sleep(2.0)
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
        if self.body is None or not self.reader.at_eof():
            super().leave()


@fault("control.connection.again")
class KeepsNames(Session):
    taken: set[str] = set()  # noqa: RUF012  (shared on purpose)

    async def do_init(self, segments: Pairs) -> None:
        name = self.get(segments, "Name") or ""
        if name not in self.taken or name == "Survey":
            self.taken.add(name)
            await super().do_init(segments)


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


@fault("control.status.rate")
class StatusTooOften(Session):
    def status(self, when: float) -> Pairs:
        return super().status(round(when * 0.95, 2))


@fault("control.status.steady")
class LosesStatus(Session):
    async def moment(self, tick: int) -> None:
        self.sta_every = {"ut2004": 2 if tick % 26 else 99, "udk": 1}
        await super().moment(tick)


@fault("control.status.steady", "udk")
class StatusTwice(Session):
    async def moment(self, tick: int) -> None:
        await super().moment(tick)
        if tick % 30 == 0:
            await self.stream("STA", *self.status(self.now()))


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
