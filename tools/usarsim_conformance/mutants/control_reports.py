"""What the small server tells of its robots: STA, SEN, CONF, GEO."""

from __future__ import annotations

import math

from usarsim_conformance.mutants.control_text import fixed, vector
from usarsim_conformance.mutants.control_world import (
    MASS,
    MAX_SPEED,
    RADIUS,
    SEPARATION,
    MiniBody,
    MiniWorld,
)

NAMES = {
    "RangeScanner": ("Scanner1",),
    "Sonar": tuple(f"{side}{number}" for side in "FR" for number in range(1, 9)),
    "Odometry": ("Odometry",),
    "INS": ("INS",),
    "GroundTruth": ("GroundTruth",),
    "Encoder": ("ECLeft", "ECRight"),
    "Touch": ("Bumper",),
}
"""Items of a robot by type."""
_BATCHED = ("Sonar", "Encoder", "Touch")
_FOV, _RESOLUTION, _REACH = 3.1415, 0.0872, 20.0


class Reports:
    """The half of a connection that writes; `control_server.Session` is the other one."""

    names = NAMES
    world: MiniWorld
    body: MiniBody | None
    dialect: str
    light: bool
    believed: list[float]

    def get(self, segments: list[tuple[str, str]], name: str) -> str | None:
        """The first segment of a name."""
        raise NotImplementedError

    def reply(self, head: str, *segments: tuple[str, str]) -> None:
        """Send an answer."""
        raise NotImplementedError

    async def stream(self, head: str, *segments: tuple[str, str]) -> None:
        """Send a report."""
        raise NotImplementedError

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
        if type == "Encoder":
            side = -0.5 if name == self.items(type)[0] else 0.5
            mount = (mount[0], side * SEPARATION, mount[2])
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
        if type == "Encoder":
            return [("Resolution", "0.0175")]
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
        if type == "INS":
            body.stray()
        digits = 3 if type == "GroundTruth" and self.dialect == "udk" else 2
        location, angles = self.told_pose(type, body)
        return [("Location", vector(location, digits)), ("Orientation", vector(angles, digits))]

    def told_pose(self, type: str, body: MiniBody) -> tuple[list[float], list[float]]:
        """Location and angles as GroundTruth or INS tell them."""
        if type == "GroundTruth" and self.dialect == "udk":
            return body.location, [math.remainder(angle, math.tau) for angle in body.angles]
        if type != "INS":
            return body.location, [angle % math.tau for angle in body.angles]
        location = [
            sum(parts) for parts in zip(body.location, self.believed, body.strayed[:3], strict=True)
        ]
        roll, pitch, yaw = body.angles
        return location, [angle % math.tau for angle in (roll, pitch, yaw + body.strayed[3])]

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
