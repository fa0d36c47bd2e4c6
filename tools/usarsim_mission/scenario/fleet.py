"""What the classes of robots mean for a mission: how much room they need, how fast they are, what
their scanners see."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

from usarsim_exploration.floor import Size
from usarsim_mission.model import Fan
from usarsim_server.robots.catalog import RobotCatalog, load_catalog
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sensors.base import TYPES
from usarsim_server.simulation.frames import rpy_from_quaternion

FLOORLESS = frozenset({"aerial", "underwater", "static"})
"""Kinds that do not drive on the floor."""

_SPARE = 0.02
"""m beside a robot."""
_HEADROOM = 0.3
"""m above the wheels, for what a robot carries."""
_CLIMB = 0.9
"""Wheel radii of a step that wheels get over, as in the acceptance trials of step fields."""
_LEAST_CLIMB, _MOST_CLIMB = 0.06, 0.25
_FLYING = 1.0
"""m/s: what has no wheels."""


@cache
def catalog(folders: tuple[Path, ...] = ()) -> RobotCatalog:
    """All classes, those of further folders, too.

    Raises:
        RobotDescriptionError: a file cannot be used.
    """
    return load_catalog(folders)


def size_of(robot: RobotDescription) -> Size:
    """The room that it needs, from its wheels, or else from the dimensions that it announces."""
    length, width, _ = robot.report.dimensions
    half = max((abs(w.position[1]) + w.width / 2.0 for w in robot.wheels), default=0.0)
    half = max(half, min(length, width) / 2.0, 0.1)
    radius = max((wheel.radius for wheel in robot.wheels), default=_LEAST_CLIMB)
    climb = min(max(_CLIMB * radius, _LEAST_CLIMB), _MOST_CLIMB)
    return Size(round(half + _SPARE, 3), round(radius + _HEADROOM, 3), round(climb, 3))


def speed_of(robot: RobotDescription) -> float:
    """m/s that it does at most, straight on."""
    radius = max((wheel.radius for wheel in robot.wheels), default=0.0)
    speed = robot.drive.max_wheel_speed * radius if robot.drive is not None else 0.0
    return speed or _FLYING


def fans_of(robot: RobotDescription) -> tuple[Fan, ...]:
    """What its flat scanners cover: range, opening and yaw of each."""
    found = []
    for item in robot.items:
        cls = TYPES.find(item.type, "")
        reach, fov = getattr(cls, "max_range", None), getattr(cls, "fov", None)
        reach = item.parameters.get("max_range", reach)
        fov = item.parameters.get("fov", fov)
        if not getattr(cls, "scans", False) or not isinstance(reach, int | float):
            continue
        if isinstance(fov, int | float):
            yaw = rpy_from_quaternion(item.pose.quaternion)[2]
            found.append(Fan(float(reach), min(float(fov), 6.3), round(yaw, 6)))
    return tuple(found)


def drivers(robots: Iterable[RobotDescription]) -> Sequence[RobotDescription]:
    """Those that drive on the floor."""
    return [robot for robot in robots if robot.kind not in FLOORLESS]
