"""Robots with range finders in MuJoCo, in this process and this thread: no sockets, no text.

The world is an environment of `usarsim explore`, its walls bricks 2 m high. Model, rays and classes
are made once; `Stage.begin` puts everything back to the first step, and what follows is bit by bit
what would follow in a new world.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.worlds import World
from usarsim_exploration.worlds.physics import write_world
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.robots.description import ItemDescription, RobotDescription
from usarsim_server.sensors.base import SensorContext, create_sensor
from usarsim_server.sensors.scanners import RangeScanner
from usarsim_server.sensors.wheels import Odometry
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, axes_of, quaternion_from_rpy
from usarsim_server.simulation.growth import WorldParts
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.placement import Placement
from usarsim_server.simulation.rays.cast import cast_all, cast_scenery
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.query import PendingReport, RayHits
from usarsim_server.simulation.rays.scenery import StaticGeometry
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import robot_model
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

TICK = 0.1
"""Simulated s of a step."""
SETTLE = 0.3
"""Simulated s until a robot that was let down stands."""
LIFT = 0.005
"""m above the floor from which it is let down."""
Place = tuple[float, float, float]
"""x and y, m, and heading, rad."""
_SCANNERS = ("rangescanner", "sick", "hokuyo", "hokuyourg04lx")


class Rover:
    """One robot on its stage; x to the right, y up, headings counterclockwise, as in physics.

    Attributes:
        scanner: of the episode. state: at the last look. met: (n,) which beams met a wall.
        touching: it touches anything but the floor. works: it is in the world.
    """

    state: RobotBody
    met: NDArray[np.bool_]

    def __init__(self, scanner: RangeScanner, odometry: Odometry) -> None:
        """A robot that has not looked yet."""
        self.scanner, self._odometry = scanner, odometry
        self.touching, self.works = False, True
        beams = np.arange(scanner.beams, dtype=np.float64)
        self.angles: NDArray[np.float64] = scanner.resolution * beams - scanner.fov / 2
        """(n,) of the beams, from the right to the left, from the robot's heading, rad."""

    def look(self, state: RobotBody, hits: RayHits, walls: RayHits, touching: bool) -> None:
        """Scan and count the wheels.

        Args:
            state: of now. hits: what the beams meet; walls: what they would without robots.
        """
        self.state, self.touching = state, touching
        self.scanner.measure(state, [hits])
        self._odometry.measure(state, ())
        self.met = (walls.distances < self.scanner.max_range) & (hits.distances >= walls.distances)

    @property
    def place(self) -> Place:
        """The truth."""
        (x, y, _), quaternion = self.state.pose.position, self.state.pose.quaternion
        ahead = axes_of(*quaternion)[0]
        return x, y, math.atan2(ahead[1], ahead[0])

    @property
    def way(self) -> Place:
        """The same since the start by the wheels alone, ahead of the start and to its left."""
        x, y, clockwise = self._odometry.estimate
        return x, -y, -clockwise

    @property
    def velocity(self) -> tuple[float, float]:
        """Ahead, m/s, and counterclockwise, rad/s."""
        ahead = axes_of(*self.state.pose.quaternion)[0]
        speed = sum(a * b for a, b in zip(ahead, self.state.linear_velocity, strict=True))
        return speed, self.state.angular_velocity[2]


class Stage:
    """The world and its robots.

    Attributes:
        engine: of the physics. rovers: of the episode. beams: of each range finder.
    """

    def __init__(
        self, world: World, robot: str, count: int, speed: float, reach: float, noise: float
    ) -> None:
        """Compile.

        Args:
            world: whose walls stand. robot: class, skid-steered and with a range finder.
            count: how many. speed: m/s of its wheels at the most. reach, noise: of the range
                finder, m.

        Raises:
            UsarsimError: there is no such robot, or it is of another kind.
        """
        self._robot = _faster(_find(robot), speed)
        self._laser = _laser(self._robot, reach, noise)
        self._odometer = ItemDescription("Odometry", "Odometry", None, Pose())
        self._left = np.array([wheel.side == "left" for wheel in self._robot.driven_wheels])
        self._options = PhysicsOptions()
        with tempfile.TemporaryDirectory(prefix="usarsim-gym-") as name:
            write_world(world, Path(name) / "world")
            self._world = load_world(Path(name) / "world")
            models = [robot_model(self._robot)] * count
            self.engine = Engine(lambda: build_scene(self._world), self._options, models)
        compiled = self.engine.world
        self._rays = StaticGeometry(compiled)
        self._bodies = DynamicGeometry(compiled) if count > 1 else None
        self._placement = Placement(compiled, self._world.lower, self._world.upper)
        self._owner = np.full(compiled.model.ngeom, -1)
        for number, layout in enumerate(compiled.layouts):
            self._owner[layout.geoms] = number
        self._solid = compiled.model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE)
        self._ticks = round(TICK / self.engine.timestep)
        self.rovers = [self._rover(np.random.default_rng(0)) for _ in range(count)]
        self.beams = self.rovers[0].scanner.beams

    def begin(self, places: Sequence[Place], random: np.random.Generator) -> None:
        """A new episode.

        Args:
            places: wanted, of each robot; the nearest that is free is taken.
            random: draws the seeds of the range finders' noise.
        """
        engine = self.engine
        for number in range(len(self.rovers)):
            engine.vacate(number)
        mujoco.mj_resetData(engine.world.model, engine.data)
        engine.parts, engine.steps = WorldParts(engine.world, self._options), 0
        height = self._robot.rest_height + LIFT
        for number, (x, y, heading) in enumerate(places):
            seed = int(random.integers(2**63))
            self.rovers[number] = self._rover(np.random.default_rng(seed))
            wanted = Pose((x, y, height), quaternion_from_rpy(0.0, 0.0, heading))
            engine.occupy(number, number, self._placement.find(engine.snapshot(), number, wanted))
        engine.advance(round(SETTLE / engine.timestep))
        self._look()

    def step(self, told: Mapping[int, tuple[float, float]]) -> None:
        """Let 0.1 s pass.

        Args:
            told: robots by number; ahead and right, parts of the full speed of the wheels, -1 to
                1; the wheels of the left side get their sum, those of the right their difference.
        """
        fast = self._robot.drive.max_wheel_speed
        for number, (ahead, right) in told.items():
            sides = np.where(self._left, ahead + right, ahead - right)
            self.engine.drive(number, np.clip(sides, -1.0, 1.0) * fast)
        for number in self.engine.advance(self._ticks):
            self.rovers[number].works = False  # its numbers went beyond all sense
        self._look()

    def _look(self) -> None:
        snapshot = self.engine.snapshot()
        states = {number: RobotBody(snapshot, one) for number, one in snapshot.layouts.items()}
        reports = [
            PendingReport(snapshot, number, self.rovers[number].scanner.rays(state))
            for number, state in states.items()
        ]
        if not reports:
            return
        walls = cast_scenery([report.fans[0] for report in reports], self._rays)
        hits = walls
        if self._bodies is not None:
            hits = [one[0] for one in cast_all(reports, self._rays, self._bodies)]
        touching = self._touching()
        for (number, state), hit, wall in zip(states.items(), hits, walls, strict=True):
            self.rovers[number].look(state, hit, wall, number in touching)

    def _touching(self) -> set[int]:
        """Who touches anything but the floor and itself."""
        contact = self.engine.data.contact
        pairs = contact.geom[contact.dist <= 0.0]
        owners = self._owner[pairs]
        pairs = pairs[(owners[:, 0] != owners[:, 1]) & self._solid[pairs].all(axis=1)]
        return set(self._owner[pairs].ravel().tolist())

    def _rover(self, random: np.random.Generator) -> Rover:
        context = SensorContext(robot=self._robot, world=self._world, rng=random)
        scanner = create_sensor(self._laser, context)
        odometry = create_sensor(self._odometer, context)
        assert isinstance(scanner, RangeScanner)
        assert isinstance(odometry, Odometry)
        return Rover(scanner, odometry)


def _find(name: str) -> RobotDescription:
    catalog = load_catalog()
    found = catalog.find(name)
    if found is None:
        raise ExplorationError(f"robot: there is no class {name!r} (see usarsim robots)")
    if found.kind != "skid_steer":
        raise ExplorationError(
            f"robot: {name} is {found.kind} (name a skid_steer one, such as P3AT)"
        )
    return found


def _faster(robot: RobotDescription, speed: float) -> RobotDescription:
    if not 0.0 < speed <= 5.0:
        raise ExplorationError(f"speed: {speed} m/s (write a number above 0, up to 5)")
    radius = robot.driven_wheels[0].radius
    return replace(robot, drive=replace(robot.drive, max_wheel_speed=speed / radius))


def _laser(robot: RobotDescription, reach: float, noise: float) -> ItemDescription:
    """The first range finder of a class, with other limits."""
    for item in robot.items:
        if item.type.lower() in _SCANNERS:
            given = {**item.parameters, "max_range": reach, "noise": noise}
            return replace(item, parameters=given)
    raise ExplorationError(f"robot: {robot.name} has no range finder (name another, such as P3AT)")
