"""Distances: what all sensors share that measure them, range finders and line lasers.

Range finders have one ray along the mount axis (robots reference 2.2). Line lasers report the
points of a fan of beams in the world (robots 2.3). Sonars are in `sonar.py`.

Directions of rays are computed once in the sensor's own frame and turned once per reading.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.protocol.dialects import FACETS, announced_angle
from usarsim_server.protocol.numbers import fixed, ranges, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import NOWHERE, Sensor, SensorContext, register
from usarsim_server.sensors.smoke import HOKUYO_BUDGET, MODELS, SmokeSight
from usarsim_server.simulation.frames import IDENTITY, Pose, flip_point, wire_from_pose
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

Array = NDArray[np.float64]


class Ranging(Sensor):
    """A sensor of distances.

    Every echo may have a Gaussian error. The original had none (robots reference 2.3).
    """

    min_range: float = field(default=0.1, low=0.0, unit="m")
    max_range: float = field(above=0.0, unit="m")
    noise: float = field(default=0.0, low=0.0, unit="m", help="standard deviation of every echo")
    noise_ratio: float = field(
        default=0.0, low=0.0, help="the same as a share of the distance; the larger of both counts"
    )

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        if self.max_range <= self.min_range:
            raise self.parameters.error(
                "max_range",
                f"{self.max_range!r} is out of range",
                f"write a number greater than min_range, {self.min_range:g}",
            )
        self._rng = context.rng

    def echoes(self, distances: Array) -> Array:
        """Distances with noise, misses and everything too far set to the maximum range."""
        ranges = np.minimum(distances, self.max_range)
        if self.noise > 0.0 or self.noise_ratio > 0.0:
            deviation = np.maximum(self.noise, self.noise_ratio * ranges)
            noisy = ranges + deviation * self._rng.standard_normal(ranges.shape)
            hit = distances < self.max_range
            ranges = np.where(hit, np.clip(noisy, 0.0, self.max_range), self.max_range)
        return ranges

    def echo(self, distance: float) -> float:
        """One distance, as `echoes` makes it."""
        if self.noise > 0.0 or self.noise_ratio > 0.0:
            return float(self.echoes(np.array([distance]))[0])
        return distance if distance < self.max_range else self.max_range

    def limits(self) -> tuple[Segment, ...]:
        """The MaxRange and MinRange segments of CONF."""
        return (("MaxRange", fixed(self.max_range, 4)), ("MinRange", fixed(self.min_range, 4)))


class LightRanging(Ranging):
    """A sensor whose beams are light: smoke gets in their way, and glass unless they pass it."""

    through_glass: ClassVar[bool] = False

    smoke: str = field(
        default="ignore", choices=MODELS, any_case=True, help="what thick air does to a beam"
    )
    smoke_budget: float = field(
        default=HOKUYO_BUDGET, above=0.0, help="density times metres after which a beam is lost"
    )

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._sight = SmokeSight(context, self.smoke, self.smoke_budget)

    def beams_of(self, robot: RobotState, directions: Array) -> tuple[RayFan]:
        """The fan of the next reading; its answer goes through `seen`."""
        pose = self.world_pose(robot)
        fan = fan_at(pose, directions, self.max_range, through_glass=self.through_glass)
        return (self._sight.send(fan, robot.time),)


class SingleRange(Ranging):
    """A sensor with one distance per reading: sonar, infrared, range finder."""

    batched: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UT2004})

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self.range = self.max_range

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the distance of the nearest accepted echo (m)."""
        self.range = self.distance(hits)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Range, four digits in both dialects (protocol reference 2.2)."""
        return (("Range", fixed(self.range, 4)),)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """MaxRange and MinRange."""
        return self.limits()

    @abstractmethod
    def distance(self, hits: Sequence[RayHits]) -> float:
        """The reading (m) that the ray answers amount to."""


_FLIP = np.array(flip_point((1.0, 1.0, 1.0)))

AHEAD: Array = np.array([[1.0, 0.0, 0.0]])
"""The one direction of a sensor that looks along its mount axis."""


def wire_directions(yaw: Array | float, pitch: Array | float = 0.0) -> Array:
    """Unit vectors (n, 3) in the simulation frame for wire yaw and pitch angles (rad).

    Wire yaw grows to the right, wire pitch grows upward (protocol reference 2.5).
    """
    yaw, pitch = np.broadcast_arrays(np.atleast_1d(yaw), np.atleast_1d(pitch))
    columns = (np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch))
    directions: Array = np.column_stack(columns) * _FLIP
    return directions


_SHARED: WeakValueDictionary[bytes, Array] = WeakValueDictionary()


def shared(directions: Array) -> Array:
    """An equal array that all sensors share; not to be written to.

    Those of a whole team are in the processor's cache then, and not one of each robot.
    """
    return _SHARED.setdefault(directions.tobytes(), directions)


def cone_directions(half_angle: float, cones: int, rays_per_cone: int) -> Array:
    """Axis and nested cones around it, (1 + cones * rays_per_cone, 3); the axis is row 0.

    Half-angles grow in equal steps up to `half_angle` (rad); the rays of a cone have equal
    distances in azimuth and start sideways, so every cone has rays in the horizontal plane.
    """
    opening = np.repeat(half_angle * np.arange(1, cones + 1) / max(cones, 1), rays_per_cone)
    azimuth = np.tile(math.tau * np.arange(rays_per_cone) / max(rays_per_cone, 1), cones)
    rings = np.column_stack(
        (np.cos(opening), np.sin(opening) * np.cos(azimuth), np.sin(opening) * np.sin(azimuth))
    )
    return np.vstack((AHEAD, rings))


def fan_at(
    pose: Pose,
    directions: Array,
    max_range: float,
    *,
    starts: Array | None = None,
    normals: bool = False,
    through_glass: bool = False,
    identify: bool = False,
) -> RayFan:
    """The fan of a sensor at a world pose.

    Args:
        pose: of the sensor in the world.
        directions: (n, 3) unit vectors in the sensor's frame.
        max_range: m.
        starts: (n, 3) start points in the sensor's frame, m; all in its origin if None.
        normals: also ask for surface normals.
        through_glass: do not see glass.
        identify: also ask what was hit.
    """
    turn = pose.matrix().T
    origin = np.array(pose.position)
    if starts is not None:
        origin = starts.dot(turn) + origin
    # `dot` gives what `@` gives, in two thirds of the time.
    return RayFan(origin, directions.dot(turn), max_range, normals, through_glass, identify)


@register("RangeSensor")
class RangeSensor(LightRanging, SingleRange):
    """One ray; the minimum range is announced but not applied.

    Source: RangeSensor.uc of robocup-usarsim, whose item type is `Range`.
    """

    wire_type: ClassVar[str] = "Range"
    max_range = 3.0

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """The single ray along the mount axis."""
        return self.beams_of(robot, AHEAD)

    def distance(self, hits: Sequence[RayHits]) -> float:
        """The distance as it is, or as smoke lets it appear."""
        distances = self._sight.receive(hits[0].distances)
        return float(self._sight.blank(self.echoes(distances))[0])


@register("IR", "IRSensor")
class InfraredSensor(RangeSensor):
    """Looks through glass and keeps its reading within both limits."""

    wire_type: ClassVar[str] = "IR"
    min_range = 0.2
    max_range = 1.5
    through_glass: ClassVar[bool] = True

    def distance(self, hits: Sequence[RayHits]) -> float:
        """The distance, at least the minimum range."""
        return max(super().distance(hits), self.min_range)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """The limits; UDK sent the pair twice (protocol reference 4.8), and so do we there."""
        return self.limits() * FACETS[dialect].infrared_limits


def wire_points(points: Array) -> Array:
    """Points (n, 3) of a simulation frame in the wire frame that belongs to it."""
    turned: Array = points * _FLIP
    return turned


def point_texts(points: Array, digits: int) -> list[str]:
    """Every point (n, 3) as `x,y,z`."""
    texts = ranges(points, digits).split(",")
    return [",".join(texts[i : i + 3]) for i in range(0, 3 * len(points), 3)]


@register("LineLaser")
class LineLaser(Ranging):
    """True pose of the sensor and the point of every beam, in the world frame.

    Beams run from -FOV/2, the left, to +FOV/2, both included. A beam without hit gives the point
    at the maximum range, so that the number of points is constant. The original measured once and
    repeated that text for ever. The pieces of line into which it grouped the
    points were drawn on its screen and never sent (LineLaser.uc of robocup-usarsim).
    """

    wire_type: ClassVar[str] = "LineLaser"
    timed: ClassVar[frozenset[Dialect]] = NOWHERE
    max_range = 5.0

    fov: float = field(default=1.570796, above=0.0, high=7.0, unit="rad")
    beams: int = field(default=120, low=2, high=10_000)
    literal: bool = field(default=False, help="measures once, as the original")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._directions = wire_directions(np.linspace(-self.fov / 2, self.fov / 2, self.beams))
        self._pose = IDENTITY
        self._points: Array | None = None

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray per beam; none once the literal sensor has measured."""
        if self.literal and self._points is not None:
            return ()
        return (fan_at(self.world_pose(robot), self._directions, self.max_range),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the pose and the points."""
        if hits:
            self._pose = self.world_pose(robot)
            along = self._directions * self.echoes(hits[0].distances)[:, None]
            self._points = along @ self._pose.matrix().T + np.array(self._pose.position)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Location and Orientation, four digits, and Points, three digits."""
        location, orientation = wire_from_pose(self._pose)
        points = np.zeros((0, 3)) if self._points is None else wire_points(self._points)
        return (
            ("Location", vector(location, 4)),
            ("Orientation", vector(orientation, 4)),
            ("Points", "".join(f"[{text}]" for text in point_texts(points, 3))),
        )

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Limits, FOV and the number of beams (protocol reference 4.8)."""
        fov = fixed(announced_angle(self.fov, dialect), 4)
        return (*self.limits(), ("FOV", fov), ("Resolution", str(self.beams)))
