"""Stand-ins for the tests of sensors: a robot that is moved by hand and a world of simple solids.

Everything is in the simulation frame (x forward, y left, z up) unless it says `wire`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import (
    DriveDescription,
    ItemDescription,
    RobotDescription,
    RobotReport,
    Wheel,
)
from usarsim_server.robots.families.base import find_family
from usarsim_server.sensors.base import Sensor, SensorContext, create_sensor
from usarsim_server.simulation.frames import IDENTITY, Pose, pose_from_wire
from usarsim_server.simulation.objects import ObjectFacts
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.worlds.description import GeographicOrigin, StartPose, WorldDescription

UT2004, UDK = Dialect.UT2004, Dialect.UDK

RADIUS, TRACK = 0.13, 0.4


@dataclass
class FakeRobot:
    """A `RobotState` whose every number can be set."""

    time: float = 0.0
    pose: Pose = IDENTITY
    linear_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wheel_angles: Any = field(default_factory=lambda: np.zeros(4))
    wheel_speeds: Any = field(default_factory=lambda: np.zeros(4))
    links: dict[str, Pose] = field(default_factory=dict)
    snapshot: Any = None

    def link_pose(self, link: str) -> Pose:
        return self.links[link.lower()]

    def joint_position(self, joint: str) -> float:
        raise KeyError(joint)

    def place(self, location: tuple[float, float, float], rotation=(0.0, 0.0, 0.0)) -> None:
        """Move to a wire location (m) and wire roll, pitch, yaw (rad)."""
        self.pose = pose_from_wire(location, rotation)

    def roll_wheels(self, left: float, right: float) -> None:
        """Turn the wheels of both sides (rad); part order is left, right, left, right."""
        self.wheel_angles = self.wheel_angles + np.array([left, right, left, right])


@dataclass
class Box:
    """Axis-aligned solid."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    glass: bool = False
    name: str | None = None

    def hit(self, origin, directions):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            near = (np.array(self.lower) - origin) / directions
            far = (np.array(self.upper) - origin) / directions
        entry = np.nan_to_num(np.minimum(near, far), nan=-math.inf)
        leave = np.nan_to_num(np.maximum(near, far), nan=math.inf)
        inside = (directions == 0.0) & (
            (origin < np.array(self.lower)) | (origin > np.array(self.upper))
        )
        first, last = entry.max(axis=1), leave.min(axis=1)
        distance = np.where(first > 0.0, first, last)
        hit = (first <= last) & (last > 0.0) & ~inside.any(axis=1)
        axis = entry.argmax(axis=1)
        normals = np.zeros_like(directions)
        rows = np.arange(len(directions))
        normals[rows, axis] = -np.sign(directions[rows, axis])
        return np.where(hit, distance, math.inf), normals


@dataclass
class Pole:
    """Endless vertical cylinder."""

    x: float
    y: float
    radius: float
    glass: bool = False
    name: str | None = None

    def hit(self, origin, directions):
        offset = np.broadcast_to(origin, directions.shape)[:, :2] - np.array([self.x, self.y])
        flat = directions[:, :2]
        a = np.einsum("ij,ij->i", flat, flat)
        b = np.einsum("ij,ij->i", flat, offset)
        root = b * b - a * (np.einsum("ij,ij->i", offset, offset) - self.radius**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (-b - np.sqrt(np.maximum(root, 0.0))) / a
        hit = (root > 0.0) & (distance > 0.0)
        safe = np.where(hit, distance, 0.0)
        points = offset + flat * safe[:, None]
        normals = np.column_stack((points / self.radius, np.zeros(len(points))))
        return np.where(hit, distance, math.inf), normals


def wall_ahead(distance: float, **options: Any) -> Box:
    """A large wall square to the x axis."""
    return Box((distance, -100.0, -100.0), (distance + 1.0, 100.0, 100.0), **options)


class Scene:
    """Answers fans as the ray caster does, and remembers what it was asked."""

    def __init__(self, *solids: Box | Pole) -> None:
        self.solids = solids
        self.asked: list[RayFan] = []

    def __call__(self, fans: Sequence[RayFan]) -> list[RayHits]:
        self.asked.extend(fans)
        return [self._answer(fan) for fan in fans]

    def _answer(self, fan: RayFan) -> RayHits:
        distances = np.full(len(fan.directions), math.inf)
        normals = np.zeros((len(fan.directions), 3))
        names: list[str | None] = [None] * len(fan.directions)
        for solid in self.solids:
            if solid.glass and fan.through_glass:
                continue
            way, facing = solid.hit(fan.origin, fan.directions)
            nearer = (way < distances) & (way <= fan.max_range)
            distances = np.where(nearer, way, distances)
            normals = np.where(nearer[:, None], facing, normals)
            names = [solid.name if new else old for new, old in zip(nearer, names, strict=True)]
        return RayHits(
            distances,
            normals if fan.normals else None,
            tuple(names) if fan.identify else None,
        )


def four_wheels() -> tuple[Wheel, ...]:
    """Part order left front, right front, left rear, right rear."""
    places = (("LeftFront", 0.12), ("RightFront", 0.12), ("LeftRear", -0.12), ("RightRear", -0.12))
    return tuple(
        Wheel(
            name=f"{name}Wheel",
            side="left" if name.startswith("Left") else "right",
            position=(x, TRACK / 2 if name.startswith("Left") else -TRACK / 2, -0.1),
            radius=RADIUS,
            width=0.05,
            mass=0.5,
        )
        for name, x in places
    )


def describe_robot(name: str = "P3AT", kind: Any = "skid_steer", **changes: Any):
    """A robot class with four driven wheels."""
    values: dict[str, Any] = {
        "name": name,
        "model": name,
        "kind": kind,
        "family": find_family(kind)(),
        "dialect": UDK,
        "description": "",
        "shapes": (),
        "wheels": four_wheels(),
        "casters": (),
        "rest_height": 0.2,
        "drive": DriveDescription(max_wheel_speed=6.0),
        "battery": None,
        "report": RobotReport(
            RADIUS, TRACK, 0.24, 12.0, "SkidSteered", (0.5, 0.4, 0.0), (0.0, 0.0, 0.0), 6.0, 60.0
        ),
        "items": (),
        "source": Path("robots/p3at.toml"),
    }
    return RobotDescription(**{**values, **changes})


def describe_world(north: float = 0.0, origin: GeographicOrigin | None = None) -> WorldDescription:
    """A world without anything in it."""
    return WorldDescription(
        name="yard",
        level="DM-yard",
        title="Yard",
        description="",
        folder=Path("worlds/yard"),
        scene=Path("worlds/yard/scene.xml"),
        starts=(StartPose("start", Pose()),),
        north=north,
        origin=origin or GeographicOrigin(),
    )


def describe_item(
    kind: str,
    name: str = "item",
    location: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0),
    link: str | None = None,
    **parameters: Any,
) -> ItemDescription:
    """An item at a wire mount pose."""
    where = f"robots/p3at.toml: [[sensor]] number 1 ({name})"
    return ItemDescription(kind, name, link, pose_from_wire(location, rotation), parameters, where)


def make(
    kind: str,
    name: str = "item",
    *,
    robot: RobotDescription | None = None,
    world: WorldDescription | None = None,
    seed: int = 1,
    objects: Callable[..., ObjectFacts | None] | None = None,
    **rest: Any,
) -> Any:
    """A sensor made through the registry; `rest` goes to `describe_item`."""
    known = {} if objects is None else {"objects": objects}
    context = SensorContext(
        robot or describe_robot(), world or describe_world(), np.random.default_rng(seed), **known
    )
    return create_sensor(describe_item(kind, name, **rest), context)


def read(sensor: Sensor, robot: FakeRobot | None = None, scene: Scene | None = None) -> bool:
    """Let a sensor take one reading."""
    robot, scene = robot or FakeRobot(), scene or Scene()
    fans = sensor.rays(robot)
    return sensor.measure(robot, scene(fans) if fans else [])


def values(sensor: Sensor, dialect: Dialect = UDK) -> dict[str, str]:
    """Data segments of the last reading by key."""
    return dict(sensor.data(dialect))


def numbers(text: str) -> list[float]:
    """A comma separated list."""
    return [float(part) for part in text.split(",")]


def text_of(segments: Iterable[tuple[str, str]]) -> str:
    """Segments as they stand in a line."""
    return " ".join(f"{{{key} {value}}}" for key, value in segments)
