"""RFID: readers of tags, readers of victims' tags, and what drops tags (robots reference 2.9).

Ranges are starting values: a client of the UT2004 generation quotes readings of tags 5.5 m away.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.base.fields import field
from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.robots.mounting import SetReply, SetResult
from usarsim_server.sensors.base import Sensor, SensorContext, register
from usarsim_server.sensors.people import in_sight, relative, sight_lines
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState
from usarsim_server.worlds.description import RfidTag
from usarsim_server.worlds.surroundings import LiveVictim

MAX_TAGS = 16
"""Most tags of one line, the nearest first: lines stay below 1024 bytes (protocol reference 6.7
number 107)."""

_ADDRESS = re.compile(r"\s*([0-9]{1,10})[ \t]?(.*)", re.DOTALL)
"""Number of a tag and, behind one blank, text with blanks."""


@register("RFID", "RFIDSensor", "RFIDReader")
class RfidReader(Sensor):
    """Reports all tags in range; reads and writes their memory on SET.

    Silent while no tag is in range. A single-shot tag is reported once.
    """

    wire_type: ClassVar[str] = "RFID"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    nicknames: ClassVar[tuple[str, ...]] = ("rfid", "rfidreader")
    most: ClassVar[int] = MAX_TAGS
    """Most tags that one line reports."""

    max_range: float = field(default=6.0, above=0.0, unit="m")
    single_shot_range: float = field(default=1.0, above=0.0, unit="m", help="of single-shot tags")
    line_of_sight: bool = field(default=False, help="walls stop it")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._life = context.life
        self._near: list[RfidTag] = []
        self._heard: list[tuple[RfidTag, str]] = []
        self._reachable: set[int] = set()
        self._spent: set[int] = set()

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray to each tag in range, if walls matter."""
        self._near = self._in_range(robot)
        if not self.line_of_sight:
            return ()
        return sight_lines(self.world_pose(robot), [tag.position for tag in self._near])

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the tags that answer; False if there is none."""
        pose = self.world_pose(robot)
        near = self._in_range(robot) if not self.line_of_sight else self._near
        if self.line_of_sight:
            free = in_sight(pose, [tag.position for tag in near], hits)
            near = [tag for tag, seen in zip(near, free, strict=True) if seen]
        self._reachable = {tag.id for tag in near}
        heard = [tag for tag in near if tag.id not in self._spent][: self.most]
        self._spent |= {tag.id for tag in heard if tag.single_shot}
        self._heard = [(tag, vector(relative(pose, tag.position), 2)) for tag in heard]
        return bool(self._heard)

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """ID, Location relative to the reader, and Mem (1: the tag holds text), again and again."""
        found = [
            (("ID", str(tag.id)), ("Location", place), ("Mem", "1" if tag.memory else "0"))
            for tag, place in self._heard
        ]
        return tuple(segment for group in found for segment in group)

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult | SetReply:
        """READ gives the memory of a tag, WRITE replaces it; the tag must be in range."""
        if opcode not in ("READ", "WRITE"):
            return SetResult.UNKNOWN
        address = _ADDRESS.match(params)
        tag = self._life.tag(int(address[1])) if address else None
        if address is None or tag is None or not self._reaches(tag, robot):
            return SetResult.FAILED
        if opcode == "READ":
            return SetReply(SetResult.OK, (("ID", str(tag.id)), ("Mem", tag.memory)))
        return SetResult.OK if self._life.write(tag.id, address[2]) else SetResult.FAILED

    def _in_range(self, robot: RobotState) -> list[RfidTag]:
        place = self.world_pose(robot).position
        reach = max(self.max_range, self.single_shot_range)
        return [tag for tag in self._life.tags(place, reach) if self._reaches(tag, robot, True)]

    def _reaches(self, tag: RfidTag, robot: RobotState, through_walls: bool = False) -> bool:
        """Whether a tag is near enough and, if walls matter, answered at the last reading."""
        if self.line_of_sight and not through_walls and tag.id not in self._reachable:
            return False
        reach = self.single_shot_range if tag.single_shot else self.max_range
        return math.dist(tag.position, self.world_pose(robot).position) <= reach


@register("RFIDTag")
class RfidTagReader(RfidReader):
    """The nearest tag in range, in the form that one client of the UT2004 generation reads."""

    wire_type: ClassVar[str] = "RFIDTag"
    most: ClassVar[int] = 1

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """ID and Location."""
        return super().data(dialect)[:2]


@register("VictRFID", "VictimRFID")
class VictimRfidReader(Sensor):
    """Reports a victim whose tag is in range; if there are several, one after the other.

    One victim per line, because RDK keeps only the last of a line. Silent while there is none.
    Clients of the 2006 competition read ID, Status and Location and take the victim's name for its
    ID.
    """

    wire_type: ClassVar[str] = "VictRFID"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    max_range: float = field(default=6.0, above=0.0, unit="m")
    keys: str = field(
        default="long", choices=("long", "short"), any_case=True, help="short: those of 2006"
    )

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._victims = [victim for victim in context.life.victims if victim.tag is not None]
        self._turn = 0
        self._found: tuple[LiveVictim, str] | None = None

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the next victim in range; False if there is none."""
        pose = self.world_pose(robot)
        near = [
            (victim, place)
            for victim, place in ((one, one.position(robot.time)) for one in self._victims)
            if math.dist(place, pose.position) <= self.max_range
        ]
        if not near:
            return False
        victim, place = near[self._turn % len(near)]
        self._turn += 1
        self._found = victim, vector(relative(pose, place), 2)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """VictimId, VictimName, VictimStatus and Location relative to the reader."""
        if self._found is None:
            return ()
        victim, place = self._found
        if self.keys == "short":
            return (("ID", victim.name), ("Status", victim.status), ("Location", place))
        return (
            ("VictimId", str(victim.tag)),
            ("VictimName", victim.name),
            ("VictimStatus", victim.status),
            ("Location", place),
        )


@register("RFIDReleaser")
class RfidReleaser(Sensor):
    """Drops a tag where it is on SET RELEASE; silent."""

    wire_type: ClassVar[str] = "RFIDReleaser"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.0, Dialect.UDK: 0.0}

    left: int = field(default=50, low=0, high=1000, key="capacity", help="tags on board")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._life = context.life

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Nothing to report."""
        return False

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """No data."""
        return ()

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult | SetReply:
        """RELEASE leaves a tag here; it fails when none is left."""
        if opcode != "RELEASE":
            return SetResult.UNKNOWN
        if self.left == 0 or self._life.drop(self.world_pose(robot).position) is None:
            return SetResult.FAILED
        self.left -= 1
        return SetResult.OK
