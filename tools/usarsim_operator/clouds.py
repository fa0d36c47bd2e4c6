"""What range cameras and scanners of rows saw, as points in the frame of their robot; sans-IO.

A scanner of rows tells all of its points at once. A depth camera tells strips of rows, a rotating
scanner one row at a time: here the newest of each strip, and the rows of a turn, stay together with
what other sensors saw, each at the place in the world where it was seen, so that a robot that
drives does not smear them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_client import frames, readings
from usarsim_client.reports import ItemConfiguration
from usarsim_operator.mounts import Mounts
from usarsim_operator.telemetry import Pose

MOST = 8000
"""Points of a message; of more, every second, third ... one is told."""
TURN = 1.0
"""Simulated s of rows of a rotating scanner that stay."""
KINDS = ("RangeScanner3D", "3DRangeScanner", "RangeImager", "PCL", "RangeScanner", "IRScanner")
"""Types whose mounts and limits are worth asking for."""

Points = NDArray[np.float64]

_MOST_ROWS = 512  # of one rotating scanner
_MOST_SENSORS = 32


@dataclass(frozen=True, slots=True)
class _Part:
    """Points (n, 3) in the frame of the robot when it stood at a pose."""

    points: Points
    pose: Pose | None
    time: float


@dataclass(slots=True)
class _Sensor:
    limit: float = math.inf
    nods: bool = False
    parts: dict[float, _Part] = field(default_factory=dict)
    """What it saw: of a strip of a picture by its number, of a row by its time."""

    def saw(self, part: _Part, keep: float) -> None:
        """Add a row, and forget those that are older than so many simulated s."""
        self.parts[part.time] = part
        while len(self.parts) > _MOST_ROWS or next(iter(self.parts)) < part.time - keep:
            del self.parts[next(iter(self.parts))]


class Clouds:
    """All points of one robot.

    Attributes:
        depth: names of sensors that take a picture only when they are asked to.
    """

    def __init__(self, mounts: Mounts) -> None:
        """mounts: where the sensors are."""
        self.depth: set[str] = set()
        self._mounts = mounts
        self._sensors: dict[str, _Sensor] = {}

    def know_limits(self, kind: str, items: Iterable[ItemConfiguration]) -> None:
        """How far sensors of a type see, and which scanners nod instead of looking around."""
        for item in items:
            limit = item.number("MaxRange")
            nods = item.fields.get("tilting", "").lower() == "true" and kind == "RangeScanner"
            self._sensors[item.name] = _Sensor(limit if limit > 0.0 else math.inf, nods)
            if kind == "RangeImager":
                self.depth.add(item.name)

    def limit(self, name: str) -> float:
        """How far a sensor sees, m; infinite as long as nobody has told."""
        sensor = self._sensors.get(name)
        return math.inf if sensor is None else sensor.limit

    def nods(self, name: str) -> bool:
        """Whether a flat scanner sweeps from up to down, so that its scan is no plan."""
        sensor = self._sensors.get(name)
        return sensor is not None and sensor.nods

    def count(self, name: str) -> int:
        """Points that a sensor saw."""
        sensor = self._sensors.get(name)
        return 0 if sensor is None else sum(len(one.points) for one in sensor.parts.values())

    def feed(self, value: readings.Reading, pose: Pose | None) -> Points | None:
        """Take what a sensor tells.

        Args:
            value: any reading. pose: of the robot now; None if it tells none.

        Returns:
            All that these sensors saw, (n, 3) m in the frame of the robot; None if it is none of
            them, or saw nothing.
        """
        sensor = self._sensors.get(value.name) or _Sensor()
        place, part, keep = self._mounts.of(value.name), value.time, 0.0
        match value:
            case readings.Scan3D():
                seen = _grid(value, sensor.limit)
            case readings.DepthStrip():
                self.depth.add(value.name)
                if not len(value.ranges):
                    return None
                seen, part = _strip(value, sensor.limit), float(value.frame % 1024)
            case readings.PointCloud() if value.type.lower() == "linelaser":
                if pose is None:
                    return None
                seen, place = _from_world(value.points, pose), np.eye(4)
            case readings.PointCloud():
                far = np.linalg.norm(value.points, axis=1)
                seen, keep = value.points[_near(far, sensor.limit)], TURN
            case readings.LaserScan() if sensor.nods:
                good = _near(value.ranges, sensor.limit)
                pitch, reach = value.bearings[good], value.ranges[good]
                seen = np.stack((reach * np.cos(pitch), reach * 0.0, -reach * np.sin(pitch)), 1)
            case _:
                return None
        if len(self._sensors) < _MOST_SENSORS:
            self._sensors[value.name] = sensor
        found = _Part(_placed(place, seen), pose, value.time)
        if isinstance(value, readings.DepthStrip):
            sensor.parts[part] = found
        else:
            sensor.saw(found, keep)
        every = [
            _moved(one, pose) for each in self._sensors.values() for one in each.parts.values()
        ]
        points = np.concatenate(every)
        return points[:: max(1, -(-len(points) // MOST))]


def _placed(place: Points, points: Points) -> Points:
    """Points of a sensor in the frame of its robot."""
    placed: Points = points @ place[:3, :3].T + place[:3, 3]
    return placed


def _near(ranges: Points, limit: float) -> NDArray[np.bool_]:
    """Which ranges are echoes."""
    return np.isfinite(ranges) & (ranges > 0.0) & (ranges < limit - 0.02)


def _grid(scan: readings.Scan3D, limit: float) -> Points:
    """Points of a scan of rows, in the frame of its sensor."""
    rows = scan.rows
    if len(scan.fov) != 2 or len(scan.resolution) != 2:
        return np.zeros((0, 3))
    high, wide = rows.shape
    pitch = (scan.fov[0] / 2.0 - scan.resolution[0] * np.arange(high))[:, None]
    yaw = (scan.fov[1] / 2.0 - scan.resolution[1] * np.arange(wide))[None, :]
    places = np.stack(
        np.broadcast_arrays(
            rows * np.cos(yaw) * np.cos(pitch),
            rows * np.sin(yaw) * np.cos(pitch),
            -rows * np.sin(pitch),
        ),
        axis=-1,
    )
    return places[_near(rows, limit)]


def _strip(strip: readings.DepthStrip, limit: float) -> Points:
    """Points of a strip of a depth picture, in the frame of its sensor."""
    ranges, angles, size = strip.ranges, strip.fov, strip.resolution
    if not angles or not size or not angles[0] > 0.0 or not size[0] > 0.0:
        return np.zeros((0, 3))
    pair = len(angles) == 2 and len(size) == 2
    wide = round(size[0] if pair else angles[0] / size[0])
    if not 0 < wide <= len(ranges) or len(ranges) % wide:
        return np.zeros((0, 3))
    rows = ranges.reshape(-1, wide)
    high = len(rows) * max(strip.frames, 1)
    tall = angles[1] if pair else high * size[0]  # a line of one angle leaves square pixels
    first = strip.frame * len(rows)
    yaw = (angles[0] * (np.arange(wide) / wide - 0.5))[None, :]
    pitch = (tall * (0.5 - np.arange(first, first + len(rows)) / high))[:, None]
    places = np.stack((rows, rows * np.tan(yaw), -rows * np.tan(pitch) / np.cos(yaw)), axis=-1)
    return places[_near(rows, limit)]


def _moved(part: _Part, pose: Pose | None) -> Points:
    """Points of an earlier moment as they are seen from where the robot is now."""
    before = part.pose
    if before is None or pose is None or before == pose:
        return part.points
    return _from_world(frames.to_world(part.points, before[:3], before[3:]), pose)


def _from_world(points: Points, pose: Pose) -> Points:
    seen: Points = (points - np.array(pose[:3])) @ frames.rotation_matrix(pose[3:])
    return seen
