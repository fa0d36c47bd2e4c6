"""A robot on a stage: driven by text through the whole server, watched in full precision."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

from usarsim_doctor.test_drive import ContactProbe
from usarsim_server.base.logs import ROOT
from usarsim_server.simulation.frames import (
    Pose,
    rpy_from_quaternion,
    wire_from_pose,
    wrap_signed,
)
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import Closing, Rehearsal, Vehicle

SETTLE = 1.0
"""s that a robot is given to come to rest before a test."""


class StageError(Exception):
    """A test could not be carried through: no robot, or the robot was lost."""


class Stage(Closing):
    """One robot in one world, in lockstep.

    Attributes:
        rehearsal: the server behind it.
        client: the connection that owns the robot.
        vehicle: the robot. robot: its class.
        every: steps between two looks. glance: s between them.
        warnings: what the simulation warned of, MuJoCo's numerical warnings included.
    """

    def __init__(
        self,
        world: Path,
        robot: str,
        timestep: float,
        pose: Pose | None = None,
        robots: Sequence[Path] = (),
        every: int = 1,
    ) -> None:
        """Load a world folder, with further folders of robot files, and spawn a robot of a class.
        It is looked at after every so many steps.

        Without a pose it stands at rest on a level floor at the origin; time steps are in s.

        Raises:
            StageError: if there is no such robot or no room for it.
        """
        self.warnings: list[str] = []
        self._ear = _Ear(self.warnings)
        logging.getLogger(ROOT).addHandler(self._ear)
        self.rehearsal = Rehearsal(world=str(world), timestep=timestep, robots=tuple(robots))
        self.every, self.glance = every, timestep * every
        self.client = self.rehearsal.connect()
        try:
            self.vehicle = self._spawn(robot, pose)
        except StageError:
            self.close()
            raise
        self.robot = self.vehicle.description

    def _spawn(self, robot: str, pose: Pose | None) -> Vehicle:
        all_robots = self.rehearsal.assembly.robots
        description = all_robots.describe(robot)
        if description is None:
            raise StageError(f"there is no robot class {robot}")
        pose = pose or Pose((0.0, 0.0, description.rest_height))
        location, rotation = wire_from_pose(pose)
        self.client.send(
            f"INIT {{ClassName USARBot.{robot}}} {{Name Tested}}"
            f" {{Location {_vector(location)}}} {{Rotation {_vector(rotation)}}}"
        )
        if not all_robots.vehicles:
            raise StageError(f"{robot} was not spawned: {self.warnings}")
        return all_robots.vehicles[0]

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
        """Let simulated time pass; yields the state at every look.

        Raises:
            StageError: if the robot is lost.
        """
        for _ in range(round(seconds / self.glance)):
            self.rehearsal.run(self.glance)
            yield self.state

    # -- watching ----------------------------------------------------------------------------

    @property
    def state(self) -> RobotBody:
        """The robot's present state.

        Raises:
            StageError: if it is lost.
        """
        state = self.vehicle.body.look()
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
    """Collects warnings of the simulation; a robot that is told to drive into a wall is none."""

    def __init__(self, heard: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._heard = heard

    def emit(self, record: logging.LogRecord) -> None:
        if record.name != f"{ROOT}.robot":
            self._heard.append(record.getMessage())


def yaw_of(state: RobotBody) -> float:
    """Heading (rad) in the simulation frame, anticlockwise from +x, in (-pi, pi]."""
    return rpy_from_quaternion(state.pose.quaternion)[2]


def turned(before: float, after: float) -> float:
    """Change of heading (rad) between two looks less than half a turn apart."""
    return wrap_signed(after - before)


def _vector(values: Sequence[float]) -> str:
    return ",".join(f"{value:.9g}" for value in values)
