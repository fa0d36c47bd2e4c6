"""Faults in how robots of the small server obey; the name of a class says what is wrong."""

from __future__ import annotations

from usarsim_conformance.mutants.control_faults import Pairs, fault
from usarsim_conformance.mutants.control_server import Session
from usarsim_conformance.mutants.control_text import fixed
from usarsim_conformance.mutants.control_world import MiniBody

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
        self.driven = self.world.ticks.count


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
