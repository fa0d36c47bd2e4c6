"""A machine that only listens, for tests of what families make of DRIVE."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import mujoco
import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from sharing import shipped_robots

from usarsim_server.protocol.requests import Drive, WheelTarget
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import DriveController, StatusFacts
from usarsim_server.robots.families.steered import SteeredFamily
from usarsim_server.robots.families.tracked import Tracked
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.model import CompiledWorld, PhysicsOptions, compile_world
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.simulation.snapshot import RobotBody

UT, UDK = Dialect.UT2004, Dialect.UDK


class FakeMachine(BodyHandle):
    """Remembers what it was told.

    Attributes:
        description: its class.
        wheels: last wheel speeds, None before the first. law: last command of the law, likewise.
        positions: last wanted position of every joint.
        orders: how many calls there were.
    """

    def __init__(self, description: RobotDescription) -> None:
        self.description = description
        self.wheels: NDArray[np.float64] | None = None
        self.law: NDArray[np.float64] | None = None
        self.positions: dict[str, float] = {}
        self.orders = 0

    def drive(self, targets: NDArray[np.float64]) -> None:
        """Take wheel speeds."""
        self.wheels = targets.copy()
        self.orders += 1

    def command_joints(self, orders: Mapping[str, JointOrder]) -> None:
        """Take orders to joints; only positions are expected."""
        assert all(one.order is Order.POSITION for one in orders.values())
        self.positions.update({name: one.value for name, one in orders.items()})
        self.orders += 1

    def command_law(self, values: NDArray[np.float64]) -> None:
        """Take the command of a law."""
        self.law = values.copy()
        self.orders += 1


class Driver:
    """A robot's conduct and the machine that it drives, in one dialect."""

    def __init__(self, description: RobotDescription, dialect: Dialect = UT) -> None:
        self.machine = FakeMachine(description)
        self.drive_controller: DriveController = description.family.drive_controller(
            description, self.machine
        )
        self.dialect = dialect

    def send(self, **segments: Any) -> bool:
        """Send a DRIVE; whether the machine was told anything."""
        return self.obey(Drive(**segments))

    def obey(self, drive: Drive) -> bool:
        """The same with a request."""
        before = self.machine.orders
        if drive.light is not None:
            self.drive_controller.light = drive.light
        self.drive_controller.steer(drive, self.dialect)
        return self.machine.orders > before

    def status(self, joints: Mapping[str, float] | None = None, battery: int = 1200) -> str:
        """The STA line at 12.5 s while joints are where they are."""
        positions = dict(joints or {})
        facts = StatusFacts(
            state=cast(RobotBody, FakeState(positions)),
            joints=tuple(positions.items()),
            battery=battery,
        )
        return self.drive_controller.status(facts, self.dialect)


class FakeState:
    """A body at 12.5 s whose joints are at given places."""

    time = 12.5

    def __init__(self, positions: Mapping[str, float]) -> None:
        self._positions = positions

    def joint_position(self, joint: str) -> float:
        """Position of a joint."""
        return self._positions[joint]


_values = st.none() | st.floats() | st.sampled_from([1e300, -1e300, 1e9, 0.5, -0.5, 50.0])

wild_drives = st.builds(
    Drive,
    normalized=st.none() | st.booleans(),
    light=st.none() | st.booleans(),
    left=_values,
    right=_values,
    speed=_values,
    front_steer=_values,
    rear_steer=_values,
    altitude_velocity=_values,
    linear_velocity=_values,
    lateral_velocity=_values,
    rotational_velocity=_values,
    pitch_angle=_values,
    roll_angle=_values,
    propeller=_values,
    rudder=_values,
    stern_plane=_values,
    name=st.none() | st.sampled_from(["LeftFWheel", "LeftFSteer", "nobody"]),
    value=_values,
    order=st.integers(-1, 12),
    steer=st.integers(0, 1),
    wheels=st.lists(st.builds(WheelTarget, st.integers(-2, 9), _values, _values), max_size=3).map(
        tuple
    ),
)
"""Commands with members of all families, absent, enormous and nonsensical ones among them."""


def floor() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(
        '<mujoco><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>'
    )


def compiled(robot: RobotDescription, copies: int = 1) -> CompiledWorld:
    return compile_world(floor, (robot_model(robot),) * copies, PhysicsOptions(), 0)


CATALOG = shipped_robots()
ROBOTS = {robot.name: robot for robot in CATALOG.descriptions()}
TRACKED = ["Kenaf", "Tarantula", "TeleMax", "Rugbot", "Talon", "Matilda", "crawler_robot", "Soryu"]


def shipped(name: str) -> RobotDescription:
    """A shipped class by any of its names."""
    robot = CATALOG.find(name)
    assert robot is not None, name
    return robot


def tracked(robot: RobotDescription) -> Tracked:
    """What a robot has that runs on belts."""
    assert isinstance(robot.family, Tracked)
    return robot.family


def steering(name: str) -> SteeredFamily:
    """The steering of a shipped car."""
    family = ROBOTS[name].family
    assert isinstance(family, SteeredFamily)
    return family


def angles_of(driver: Driver) -> dict[str, float]:
    """SteeredFamily angles that a machine was told, rad, positive to the right."""
    family = driver.machine.description.family
    assert isinstance(family, SteeredFamily)
    return {
        wheel.joint: -wheel.sense * driver.machine.positions[wheel.joint]
        for wheel in family.wheels
        if wheel.joint is not None
    }
