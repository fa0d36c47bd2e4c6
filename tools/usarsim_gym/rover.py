"""One robot with a range finder in MuJoCo, in this process and this thread: no sockets, no text.

The world is an environment of `usarsim explore`, its walls bricks 2 m high. Model, rays and classes
are made once; `begin` puts everything back to the first step, and what follows is bit by bit what
would follow in a new world.
"""

from __future__ import annotations

import math
import tempfile
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
from usarsim_server.simulation.rays.cast import cast_scenery
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
_SCANNERS = ("rangescanner", "sick", "hokuyo", "hokuyourg04lx")


class Rover:
    """The robot in its world; x to the right, y up, headings counterclockwise, as in physics.

    Attributes:
        engine: of the physics. scanner: of the episode. state: at the last look.
        touching: the robot touches anything but the floor.
    """

    def __init__(self, world: World, robot: str, speed: float, reach: float, noise: float) -> None:
        """Compile.

        Args:
            world: whose walls stand. robot: class, skid-steered and with a range finder.
            speed: m/s of its wheels at the most. reach, noise: of the range finder, m.

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
            model = robot_model(self._robot)
            self.engine = Engine(lambda: build_scene(self._world), self._options, [model])
        self._rays = StaticGeometry(self.engine.world)
        self._placement = Placement(self.engine.world, self._world.lower, self._world.upper)
        compiled, layout = self.engine.world.model, self.engine.world.layouts[0]
        self._own = np.zeros(compiled.ngeom, np.bool_)
        self._own[layout.geoms] = True
        self._solid = compiled.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE)
        self._ticks = round(TICK / self.engine.timestep)

    @property
    def beams(self) -> int:
        """Of the range finder."""
        context = self._context(np.random.default_rng(0))
        return _scanner(self._laser, context).beams

    def begin(self, x: float, y: float, heading: float, random: np.random.Generator) -> None:
        """A new episode.

        Args:
            x, y: wanted place, m; the nearest that is free is taken. heading: rad.
            random: draws the seed of the range finder's noise.
        """
        engine = self.engine
        engine.vacate(0)
        mujoco.mj_resetData(engine.world.model, engine.data)
        engine.parts, engine.steps = WorldParts(engine.world, self._options), 0
        context = self._context(np.random.default_rng(int(random.integers(2**63))))
        self.scanner = _scanner(self._laser, context)
        beams = np.arange(self.scanner.beams, dtype=np.float64)
        self._angles = self.scanner.resolution * beams - self.scanner.fov / 2
        odometry = create_sensor(self._odometer, context)
        assert isinstance(odometry, Odometry)
        self._odometry = odometry
        height = self._robot.rest_height + LIFT
        wanted = Pose((x, y, height), quaternion_from_rpy(0.0, 0.0, heading))
        engine.occupy(0, 0, self._placement.find(engine.snapshot(), 0, wanted))
        engine.advance(round(SETTLE / engine.timestep))
        self._look()

    def step(self, ahead: float, right: float) -> bool:
        """Drive for 0.1 s; whether the robot is still there, which only numbers can prevent.

        Args:
            ahead, right: parts of the full speed of the wheels, -1 to 1; the wheels of the left
                side get their sum, those of the right side their difference.
        """
        fast = self._robot.drive.max_wheel_speed
        sides = np.where(self._left, ahead + right, ahead - right)
        self.engine.drive(0, np.clip(sides, -1.0, 1.0) * fast)
        lost = self.engine.advance(self._ticks)
        if not lost:
            self._look()
        return not lost

    def _look(self) -> None:
        """Scan and count the wheels."""
        snapshot = self.engine.snapshot()
        self.state = RobotBody(snapshot, snapshot.layouts[0])
        fans = self.scanner.rays(self.state)  # nothing moves but the robot, which sees itself not
        self.scanner.measure(self.state, cast_scenery(fans, self._rays))
        self._odometry.measure(self.state, ())
        self.touching = self._touches()

    # -- what is known of the robot -----------------------------------------------------------

    @property
    def place(self) -> tuple[float, float, float]:
        """x and y of the reference point, m, and heading, rad: the truth."""
        (x, y, _), quaternion = self.state.pose.position, self.state.pose.quaternion
        ahead = axes_of(*quaternion)[0]
        return x, y, math.atan2(ahead[1], ahead[0])

    @property
    def way(self) -> tuple[float, float, float]:
        """The same since the start by the wheels alone, ahead of the start and to its left."""
        x, y, clockwise = self._odometry.estimate
        return x, -y, -clockwise

    @property
    def velocity(self) -> tuple[float, float]:
        """Ahead, m/s, and counterclockwise, rad/s."""
        ahead = axes_of(*self.state.pose.quaternion)[0]
        speed = sum(a * b for a, b in zip(ahead, self.state.linear_velocity, strict=True))
        return speed, self.state.angular_velocity[2]

    @property
    def sight(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
        """Ranges (n,) m from the right to the left, angles (n,) of the beams to the robot's
        heading, and where the range finder is ahead and to the left of the reference point, m."""
        mount = self.scanner.mount.position
        return self.scanner.scan, self._angles, mount[0], mount[1]

    def _touches(self) -> bool:
        contact = self.engine.data.contact
        pairs = contact.geom[contact.dist <= 0.0]
        own = self._own[pairs]
        others = ~own & self._solid[pairs]
        return bool((own.any(axis=1) & others.any(axis=1)).any())

    def _context(self, random: np.random.Generator) -> SensorContext:
        return SensorContext(robot=self._robot, world=self._world, rng=random)


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


def _scanner(item: ItemDescription, context: SensorContext) -> RangeScanner:
    found = create_sensor(item, context)
    assert isinstance(found, RangeScanner)
    return found
