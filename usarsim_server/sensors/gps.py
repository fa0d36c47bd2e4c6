"""Satellite positioning (robots reference 2.6)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import NOWHERE, Sensor, SensorContext, register
from usarsim_server.simulation.frames import flip_point
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState
from usarsim_server.worlds.description import WorldDescription

Array = NDArray[np.float64]

METRES_PER_DEGREE_NORTH = 111_200.0
METRES_PER_DEGREE_EAST = 71_670.0
"""Constants of the original, whatever the latitude."""

EARTH_RADIUS = 6_378_137.0
ORBIT_RADIUS = 26_559_700.0
"""m; nominal GPS orbit (GPS SPS performance standard)."""

INCLINATION = math.radians(55.0)
SATELLITES_PER_PLANE = (5, 5, 5, 5, 5, 6)
PHASE_STEP = math.radians(40.0)
EPOCH = math.radians(100.0)
"""Turn of the earth at which the sky stands still. The original's table of satellites is a snapshot
as well; this phase and epoch show 11 satellites at its default origin and 12 at 0, 0, as its table
does, none of them within 4 degrees of the elevation mask."""

ELEVATION_MASK = math.radians(5.0)
SATELLITES_FOR_FIX = 4
SKY_RANGE = 5_000.0
"""m; a ray that hits nothing up to here has reached the sky."""


@register("GPS", "GPSSensor")
class Gps(Sensor):
    """Latitude, longitude, fix and number of satellites in sight.

    White Gaussian noise on both axes, the smaller the more satellites are in sight.
    """

    wire_type: ClassVar[str] = "GPS"
    timed: ClassVar[frozenset[Dialect]] = NOWHERE
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    announces_interval = True

    noise: bool = field(default=True, help="false switches it off")
    max_noise: float = field(
        default=2.5, low=0.0, unit="m", help="three standard deviations with 4 satellites"
    )
    min_noise: float = field(default=0.75, low=0.0, unit="m", help="likewise with 12")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._rng = context.rng
        self._origin = context.world.origin
        self._north, self._east, _ = _compass_axes(context.world)
        self._sky = sky_directions(context.world)
        self._position = (self._origin.latitude, self._origin.longitude)
        self.satellites = 0

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray toward each satellite above the elevation mask."""
        return (RayFan(np.array(self.world_pose(robot).position), self._sky, SKY_RANGE),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Count the satellites in sight and keep a position with noise."""
        self.satellites = int(np.count_nonzero(np.isinf(hits[0].distances)))
        place = np.array(self.world_pose(robot).position)
        error = np.zeros(2)
        if self.noise:
            deviation = fix_deviation(self.satellites, self.max_noise, self.min_noise)
            error = deviation * self._rng.standard_normal(2)
        north, east = float(place @ self._north), float(place @ self._east)
        self._position = (
            self._origin.latitude + (north + error[0]) / METRES_PER_DEGREE_NORTH,
            self._origin.longitude + (east + error[1]) / METRES_PER_DEGREE_EAST,
        )
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Latitude and Longitude if there is a fix, then Fix and Satellites."""
        satellites = ("Satellites", str(self.satellites))
        if self.satellites < SATELLITES_FOR_FIX:
            return (("Fix", "0"), satellites)
        latitude, longitude = self._position
        return (
            ("Latitude", _degrees_minutes(latitude, "N", "S")),
            ("Longitude", _degrees_minutes(_wrap_longitude(longitude), "E", "W")),
            ("Fix", "1"),
            satellites,
        )


def fix_deviation(satellites: int, max_noise: float = 2.5, min_noise: float = 0.75) -> float:
    """Standard deviation (m) per axis: a third of the line through the noise at 4 and at 12."""
    slope = (min_noise - max_noise) / 8.0
    return max(max_noise + slope * (satellites - 4), 0.0) / 3.0


def constellation() -> Array:
    """Positions (31, 3) of the satellites in an earth-fixed frame, m.

    Six circular orbits 60 degrees apart, evenly filled; x points to latitude and longitude 0, z to
    the north pole.
    """
    places = []
    for plane, count in enumerate(SATELLITES_PER_PLANE):
        node = math.radians(60.0) * plane - EPOCH
        for slot in range(count):
            angle = math.tau * slot / count + PHASE_STEP * plane
            along, across = math.cos(angle), math.sin(angle) * math.cos(INCLINATION)
            places.append(
                (
                    math.cos(node) * along - math.sin(node) * across,
                    math.sin(node) * along + math.cos(node) * across,
                    math.sin(angle) * math.sin(INCLINATION),
                )
            )
    return ORBIT_RADIUS * np.array(places)


def sky_directions(world: WorldDescription) -> Array:
    """Unit vectors (n, 3), simulation frame, to all satellites above the mask at a world's origin.

    A world is small against the orbits, so the directions hold everywhere in it.
    """
    latitude = math.radians(world.origin.latitude)
    longitude = math.radians(world.origin.longitude)
    sin_lat, cos_lat = math.sin(latitude), math.cos(latitude)
    sin_lon, cos_lon = math.sin(longitude), math.cos(longitude)
    north = np.array([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat])
    east = np.array([-sin_lon, cos_lon, 0.0])
    up = np.array([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat])
    lines = constellation() - EARTH_RADIUS * up
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    local = lines @ np.column_stack((north, east, up))
    visible = local[local[:, 2] > math.sin(ELEVATION_MASK)]
    directions: Array = visible @ np.vstack(_compass_axes(world))
    return directions


def _compass_axes(world: WorldDescription) -> tuple[Array, Array, Array]:
    """North, east and up of a world as unit vectors in the simulation frame."""
    cos, sin = math.cos(world.north), math.sin(world.north)
    wire_axes = ((cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, -1.0))
    north, east, up = (np.array(flip_point(axis)) for axis in wire_axes)
    return north, east, up


def _wrap_longitude(degrees: float) -> float:
    return degrees if -180.0 <= degrees <= 180.0 else (degrees + 180.0) % 360.0 - 180.0


def _degrees_minutes(degrees: float, positive: str, negative: str) -> str:
    """`d,m.mmmm,X` with minutes truncated; counted in whole 1e-4 minutes, so 60 never appears."""
    # The slack (0.2 mm) keeps 8.0273 from printing as 8.0272 for a binary fraction's sake.
    units = math.floor(abs(degrees) * 600_000.0 + 1e-3)
    whole, rest = divmod(units, 600_000)
    letter = negative if degrees < 0.0 else positive
    return f"{whole},{rest // 10_000}.{rest % 10_000:04d},{letter}"
