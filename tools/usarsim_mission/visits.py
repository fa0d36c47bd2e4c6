"""Robots as the referee sees them: where each is, who moves it, and how clean its visit is.

A visit of a zone begins when the robot's centre enters and ends when it leaves. It stays clean
while nobody moves the robot in a way that the zone does not allow, outside of a blue band. What
moves a robot is the last command that it got: one given in the band that still moves it beyond
counts there. A command that stops it, looking through its camera and marks on the map count for
nothing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from usarsim_mission import records
from usarsim_mission.model import Zone
from usarsim_mission.records import Record
from usarsim_mission.scoring import Mode, ZoneRules
from usarsim_mission.zones import ZoneMap, contains, distance, edges

CROSSED = 0.01
"""m that a robot has to be past a border: one that stands on it does not cross by trembling."""

_SOURCES: dict[str, Mode] = {
    "operator": "teleoperated",
    "timed_move": "teleoperated",
    "autonomy": "autonomous",
    "controller": "autonomous",
}
"""Who is behind a command; a watchdog only ever stops."""
_DRIVE = re.compile(r"\s*(DRIVE|WAYPOINT)\b", re.IGNORECASE)
_NUMBER = re.compile(r"(?<=[\s,])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


@dataclass(slots=True)
class Robot:
    """One robot.

    Attributes:
        pos: of its centre, m; None before the first row.
        yaw: rad, left positive.
        upright: cosine of how far it leans: 1 upright, 0 on its side.
        mode: what the operator set, or who moved it last.
        moved_by: as what it is moved at the moment; None if it was told to stand.
        visited: as what it was moved outside of bands since it entered its zone.
        zone: that holds its centre. bands: names of the blue ones that do.
        linked: whether its link is up. signal: of it, dBm.
        seen: time of the newest row that tells of it, s.
    """

    name: str
    pos: tuple[float, float, float] | None = None
    yaw: float = 0.0
    upright: float = 1.0
    mode: str = "stopped"
    moved_by: Mode | None = None
    visited: set[Mode] = field(default_factory=set)
    zone: Zone | None = None
    bands: frozenset[str] = frozenset()
    in_band: bool = False
    linked: bool = True
    signal: float | None = None
    seen: float = 0.0


class Visits:
    """All robots, and the zones that they visit.

    Attributes:
        robots: by name, in the order in which they came.
    """

    def __init__(self, zones: ZoneMap, rules: ZoneRules) -> None:
        self.robots: dict[str, Robot] = {}
        self._zones, self._rules = zones, rules

    def robot(self, name: str) -> Robot:
        """One by name; a new one if nothing was heard of it."""
        if name not in self.robots:
            self.robots[name] = Robot(name)
        return self.robots[name]

    # -- who moves whom -----------------------------------------------------------------------

    def command(self, record: Mapping[str, Any]) -> None:
        """A robot is told how to move, or something else."""
        said = records.text(record, "text")
        if said and not _DRIVE.match(said):
            return
        robot = self.robot(records.text(record, "robot"))
        by = _SOURCES.get(records.text(record, "source"))
        robot.moved_by = by if by is not None and _moves(record, said) else None
        if by is not None and robot.mode == "stopped":
            robot.mode = by
        self._touch(robot)

    def mode(self, record: Mapping[str, Any]) -> None:
        """A robot changes hands; whoever gets it has yet to move it."""
        robot = self.robot(records.text(record, "robot"))
        robot.mode = records.text(record, "mode")
        robot.moved_by = None

    def stop(self, name: str | None = None) -> None:
        """One robot, or all, stand."""
        for robot in self.robots.values():
            if name in (None, robot.name):
                robot.moved_by = None

    def link(self, record: Mapping[str, Any]) -> None:
        """A link comes or goes."""
        robot = self.robot(records.text(record, "robot"))
        robot.linked = records.text(record, "state") != "lost"
        signal = record.get("signal_dbm")
        robot.signal = signal if isinstance(signal, int | float) else None

    # -- where they are -----------------------------------------------------------------------

    def row(self, row: Mapping[str, Any], time: float) -> Iterator[Record]:
        """A robot is somewhere; yields the zones that it left and entered."""
        robot = self.robot(records.text(row, "name"))
        pos = records.place(row, "pos")
        robot.seen = time
        if pos is None:
            return
        if pos != robot.pos:
            robot.pos = pos
            yield from self._moved(robot, time)
        w, x, y, z = _quaternion(row)
        robot.yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        robot.upright = 1.0 - 2.0 * (x * x + y * y)
        self._touch(robot)

    def begin(self, time: float) -> Iterator[Record]:
        """The trial begins: all visits do."""
        for robot in self.robots.values():
            robot.visited.clear()
            self._touch(robot)
            for name, colour in self._held(robot):
                yield _crossing(robot, name, colour, True, time)

    def allows(self, zone: Zone | None, robot: Robot) -> bool:
        """Whether what a robot finds in a zone counts.

        In the zone itself its visit has to be clean. A robot that looks in from elsewhere has to be
        in a mode that the zone allows.
        """
        rule = self._rules.of(None if zone is None else zone.colour)
        if rule.open:
            return True
        if zone is not None and robot.zone is zone:
            return all(mode in rule.modes for mode in robot.visited)
        return (robot.moved_by or robot.mode) in rule.modes

    def _moved(self, robot: Robot, time: float) -> Iterator[Record]:
        assert robot.pos is not None
        x, y, _ = robot.pos
        before = dict(self._held(robot))
        zone = self._zones.zone(x, y)
        if zone is not robot.zone and not _trembles(robot.zone, zone, x, y):
            robot.zone = zone
            robot.visited = set()
        robot.bands = frozenset(
            one.name for one in self._zones.bands if _holds(one, x, y, one.name in robot.bands)
        )
        zone = robot.zone
        robot.in_band = (
            zone is not None
            and not self._rules.of(zone.colour).open
            and self._zones.in_band(zone, x, y)
        )
        after = dict(self._held(robot))
        for name, colour in before.items():
            if name not in after:
                yield _crossing(robot, name, colour, False, time)
        for name, colour in after.items():
            if name not in before:
                yield _crossing(robot, name, colour, True, time)

    def _held(self, robot: Robot) -> Iterator[tuple[str, str]]:
        """Name and colour of all that a robot is in."""
        if robot.zone is not None:
            yield robot.zone.name, robot.zone.colour
        for one in self._zones.bands:
            if one.name in robot.bands:
                yield one.name, one.colour

    def _touch(self, robot: Robot) -> None:
        """What moves it now belongs to its visit, unless it is in a band."""
        if robot.moved_by is not None and robot.zone is not None and not robot.in_band:
            robot.visited.add(robot.moved_by)


def _holds(band: Zone, x: float, y: float, before: bool) -> bool:
    """Whether a blue zone holds a place, once its border is crossed."""
    inside = contains(band.points, x, y)
    return before if inside != before and _near_edge(band, x, y) else inside


def _near_edge(zone: Zone, x: float, y: float) -> bool:
    return any(distance(edge, x, y) < CROSSED for edge in edges(zone.points))


def _trembles(before: Zone | None, after: Zone | None, x: float, y: float) -> bool:
    """Whether a place is beyond a border by so little that it is not crossed yet."""
    border = before or after
    return border is not None and _near_edge(border, x, y)


def _crossing(robot: Robot, zone: str, colour: str, enter: bool, time: float) -> Record:
    return {
        "kind": "zone",
        "t_sim": time,
        "robot": robot.name,
        "zone": zone,
        "colour": colour,
        "enter": enter,
        "mode": robot.mode,
    }


def _moves(record: Mapping[str, Any], said: str) -> bool:
    if said:
        return "waypoint" in said.lower() or any(float(one) for one in _NUMBER.findall(said))
    return any(bool(record.get(side)) for side in ("left", "right"))


def _quaternion(row: Mapping[str, Any]) -> tuple[float, float, float, float]:
    value = row.get("quat")
    if not isinstance(value, list | tuple) or len(value) != 4 or None in value:
        return 1.0, 0.0, 0.0, 0.0
    w, x, y, z = value
    return w, x, y, z
