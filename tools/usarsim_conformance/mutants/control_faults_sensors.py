"""Faults in what sensors of the small server tell; the name of a class says what is wrong."""

from __future__ import annotations

import math

from usarsim_conformance.mutants.control_faults import Pairs, fault
from usarsim_conformance.mutants.control_server import Session
from usarsim_conformance.mutants.control_text import vector
from usarsim_conformance.mutants.control_world import MiniBody

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


@fault("control.sensors.interval")
class LosesScans(Session):
    async def report(self, type: str, when: float) -> None:
        if type != "RangeScanner" or self.world.ticks.count % 24:
            await super().report(type, when)


@fault("control.sensors.interval")
class LosesOdometry(Session):
    async def report(self, type: str, when: float) -> None:
        if type != "Odometry" or self.world.ticks.count % 31:
            await super().report(type, when)


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
