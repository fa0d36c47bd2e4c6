"""A robot on a stage: driven by text through the whole server, watched in full precision."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from usarsim_server.logs import ROOT
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sessions.robots import Vehicle, robot_model
from usarsim_server.simulation.frames import (
    Pose,
    rpy_from_quaternion,
    wire_from_pose,
    wrap_signed,
)
from usarsim_server.simulation.model import PhysicsOptions, compile_world
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.testing import Closing, Rehearsal
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.scene import build_scene

SETTLE = 1.0
"""s that a robot is given to come to rest before a test."""


class StageError(Exception):
    """A test could not be carried through: no robot, or the robot was lost."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """What one robot touches at one instant.

    Attributes:
        wheels: number of its driven wheels that touch anything.
        depth: deepest overlap of the robot with anything else, m.
        own: whether two of its own parts touch each other.
    """

    wheels: int
    depth: float
    own: bool


class ContactProbe:
    """Finds contacts in snapshots, with a model of its own that never steps."""

    def __init__(self, world: WorldDescription, robot: RobotDescription) -> None:
        """Compile the world with one robot of a class, as the simulation does."""
        compiled = compile_world(
            lambda: build_scene(world), (robot_model(robot),), PhysicsOptions(), generation=0
        )
        self.model = compiled.model
        # Awake, so that contacts of resting bodies are found too.
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._data = mujoco.MjData(self.model)
        layout = compiled.layouts[0]
        self._robot = np.zeros(self.model.ngeom, dtype=bool)
        self._robot[layout.geoms] = True
        self._wheels = np.full(self.model.ngeom, -1)
        for number, dof in enumerate(layout.wheel_dof):
            body = self.model.dof_bodyid[dof]
            self._wheels[self.model.geom_bodyid == body] = number

    def look(self, snapshot: Snapshot) -> Contacts:
        """The contacts of the robot in a snapshot of the same world with that robot alone."""
        data = self._data
        data.qpos[:] = snapshot.qpos
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_collision(self.model, data)
        touching = data.contact.dist <= 0.0
        pairs = data.contact.geom[touching]
        members = self._robot[pairs].sum(axis=1)
        wheels = self._wheels[pairs]
        distances = data.contact.dist[touching][members == 1]
        return Contacts(
            wheels=len(set(wheels[wheels >= 0].tolist())),
            depth=float(-distances.min()) if distances.size else 0.0,
            own=bool((members == 2).any()),
        )


class Stage(Closing):
    """One robot in one world, in lockstep.

    Attributes:
        rehearsal: the server behind it.
        client: the connection that owns the robot.
        vehicle: the robot. robot: its class.
        warnings: what the server warned of, MuJoCo's numerical warnings included.
    """

    def __init__(
        self,
        world: Path,
        robot: str,
        timestep: float,
        pose: Pose | None = None,
        robots: Sequence[Path] = (),
        seed: int = 0,
    ) -> None:
        """Load a world, spawn a robot and let it come to rest.

        Args:
            world: world folder.
            robot: class name.
            timestep: s.
            pose: where to; by default at rest on a level floor at the origin.
            robots: folders with further robot files.
            seed: of all noise.

        Raises:
            StageError: if there is no such robot or no room for it.
        """
        self.warnings: list[str] = []
        self._ear = _Ear(self.warnings)
        logging.getLogger(ROOT).addHandler(self._ear)
        self.rehearsal = Rehearsal(
            world=str(world), timestep=timestep, robots=tuple(robots), seed=seed
        )
        self.timestep = timestep
        self.client = self.rehearsal.connect()
        try:
            self.vehicle = self._spawn(robot, pose)
        except StageError:
            self.close()
            raise
        self.robot = self.vehicle.description

    def _spawn(self, robot: str, pose: Pose | None) -> Vehicle:
        fleet = self.rehearsal.assembly.fleet
        description = fleet.describe(robot)
        if description is None:
            raise StageError(f"there is no robot class {robot}")
        pose = pose or Pose((0.0, 0.0, description.rest_height))
        location, rotation = wire_from_pose(pose)
        self.client.send(
            f"INIT {{ClassName USARBot.{robot}}} {{Name Tested}}"
            f" {{Location {_vector(location)}}} {{Rotation {_vector(rotation)}}}"
        )
        if not fleet.vehicles:
            raise StageError(f"{robot} was not spawned: {self.warnings}")
        return fleet.vehicles[0]

    # -- driving -----------------------------------------------------------------------------

    def drive(self, left: float, right: float) -> None:
        """Command the wheel speeds of both sides, rad/s."""
        self.client.send(f"DRIVE {{Left {left:.9g}}} {{Right {right:.9g}}}")

    def capped(self, speed: float) -> float:
        """A wheel speed (rad/s), or the highest that the robot can do."""
        return min(speed, self.robot.drive.max_wheel_speed)

    def settle(self) -> RobotBody:
        """Let the robot come to rest; returns its state."""
        self.run(SETTLE)
        return self.state

    def run(self, seconds: float) -> None:
        """Let simulated time pass."""
        self.rehearsal.run(seconds)

    def steps(self, seconds: float) -> Iterator[RobotBody]:
        """Let simulated time pass step by step; yields the state after each.

        Raises:
            StageError: if the robot is lost.
        """
        for _ in range(round(seconds / self.timestep)):
            self.rehearsal.run(self.timestep)
            yield self.state

    # -- watching ----------------------------------------------------------------------------

    @property
    def state(self) -> RobotBody:
        """The robot's present state.

        Raises:
            StageError: if it is lost.
        """
        state = self.vehicle.look()
        if state is None:
            raise StageError(f"the robot was lost: {self.warnings}")
        return state

    def probe(self) -> ContactProbe:
        """An instrument for the contacts of this robot."""
        return ContactProbe(self.rehearsal.assembly.world, self.robot)

    def close(self) -> None:
        """End it."""
        self.rehearsal.close()
        logging.getLogger(ROOT).removeHandler(self._ear)


class _Ear(logging.Handler):
    """Collects warnings of the server."""

    def __init__(self, heard: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._heard = heard

    def emit(self, record: logging.LogRecord) -> None:
        self._heard.append(record.getMessage())


def yaw_of(state: RobotBody) -> float:
    """Heading (rad) in the simulation frame, anticlockwise from +x, in (-pi, pi]."""
    return rpy_from_quaternion(state.pose.quaternion)[2]


def turned(before: float, after: float) -> float:
    """Change of heading (rad) between two looks less than half a turn apart."""
    return wrap_signed(after - before)


def tilt(state: RobotBody) -> float:
    """Angle (rad) between the robot's own z axis and the vertical."""
    return math.acos(max(-1.0, min(1.0, state.pose.rotate((0.0, 0.0, 1.0))[2])))


def _vector(values: Sequence[float]) -> str:
    return ",".join(f"{value:.9g}" for value in values)
