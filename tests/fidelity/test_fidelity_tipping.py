"""Wheeled robots stay on their wheels: spinning, reversing, pushing against each other.

All classes do it at the same time in one world (robots reference 3.3 V7, robots 27 and 36, which
name three classes; here all that have wheels).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from sharing import shipped_robots

from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.model import PhysicsOptions

ROBOTS = {
    robot.name: robot
    for robot in shipped_robots().descriptions()
    if robot.kind in {"skid_steer", "differential", "ackerman", "omni"}
    and robot.name == robot.model
}
SIDED = [robot for robot in ROBOTS.values() if robot.kind in {"skid_steer", "differential"}]
SHARES = (0.1, 0.35, 0.6, 1.0)
"""Of the wheel limit at which all turn in place."""
SPACING = 8.0
BATCH = 5
TIPPING = 20.0
"""Degrees; wheeled robots fall at 40 to 60."""
FAST = 10.0
"""m/s: cars that are faster are not run into each other."""
MEETINGS = (
    *((name, name) for name in ROBOTS),
    *(("P3AT_real", other) for other in ("P2AT", "P3AT", "KRobot", "Element", "Kurt2D", "Kurt3D")),
    *(("Kurt2D", other) for other in ("Lisa", "KRobot", "P2AT", "Kurt3D")),
    *(("youBot", other) for other in ("ATRVJr", "Lisa", "MDS", "SegwayRMPFifty")),
    *(("pioneer3at_with_sensors", other) for other in ("P2AT", "Kurt3D", "SegwayRMPFifty")),
    *(("ATRV", "ATRV2"), ("MDS", "SegwayRMPFifty"), ("P2DX", "pioneer2dx_with_sensors")),
)


@dataclass
class Crowd:
    """Robots in one world.

    Attributes:
        robots: the robots. engine: the world. tilts: largest tilt of each so far, degrees.
    """

    robots: Sequence[RobotDescription]
    engine: Engine
    tilts: NDArray[np.float64]

    def drive(self, share: float, turning: bool = False) -> None:
        """Command a share of the wheel limit to all, ahead or anticlockwise."""
        for number, robot in enumerate(self.robots):
            signs = [
                -1.0 if turning and wheel.side == "left" else 1.0 for wheel in robot.driven_wheels
            ]
            speeds = share * robot.drive.max_wheel_speed * np.array(signs)
            self.engine.drive(number, speeds)

    def run(self, seconds: float, look: Callable[[], None] = lambda: None) -> None:
        """Let time pass and watch."""
        for _ in range(round(seconds / self.engine.timestep / BATCH)):
            assert not self.engine.advance(BATCH)
            data = self.engine.data
            for number, layout in enumerate(self.engine.world.layouts):
                _, x, y, _ = data.qpos[layout.qpos + 3 : layout.qpos + 7]
                upright = 1.0 - 2.0 * (x * x + y * y)
                tilt = math.degrees(math.acos(max(-1.0, min(1.0, upright))))
                self.tilts[number] = max(self.tilts[number], tilt)
            look()

    def yaw_rates(self) -> NDArray[np.float64]:
        """Present yaw rates, rad/s, anticlockwise."""
        layouts = self.engine.world.layouts
        return np.array([self.engine.data.qvel[layout.dof + 5] for layout in layouts])

    def tipped(self) -> dict[str, float]:
        """Who has tilted far, and how far (degrees)."""
        return {
            f"{number} {robot.name}": round(tilt)
            for number, (robot, tilt) in enumerate(zip(self.robots, self.tilts, strict=True))
            if tilt > TIPPING
        }


def crowd(robots: Sequence[RobotDescription], poses: Sequence[Pose]) -> Crowd:
    """Put robots on an endless floor and let them come to rest."""

    def scenery() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
        return spec

    engine = Engine(scenery, PhysicsOptions(), [robot_model(robot) for robot in robots])
    for number, pose in enumerate(poses):
        engine.occupy(number, number, pose)
    found = Crowd(robots, engine, np.zeros(len(robots)))
    found.run(0.4)
    return found


def in_rows(robots: Sequence[RobotDescription]) -> list[Pose]:
    return [
        Pose((SPACING * (number % 6), SPACING * (number // 6), robot.rest_height))
        for number, robot in enumerate(robots)
    ]


@cache
def spun() -> tuple[NDArray[np.float64], dict[str, float]]:
    """Yaw rates (share, robot) of all that turn in place, and who tipped over."""
    rates = np.zeros((len(SHARES), len(SIDED)))
    everyone = crowd(SIDED, in_rows(SIDED))
    for number, share in enumerate(SHARES):
        everyone.drive(share, turning=True)
        everyone.run(2.0)
        seen: list[NDArray[np.float64]] = []
        everyone.run(0.6, lambda: seen.append(everyone.yaw_rates()))  # noqa: B023 - called at once
        rates[number] = np.mean(seen, axis=0)
    return rates, everyone.tipped()


def test_nobody_tips_over_in_a_turn() -> None:
    """Turning in place at 10 to 100 percent of its speed no robot tilts by 20 degrees."""
    assert spun()[1] == {}


@pytest.mark.parametrize("name", [robot.name for robot in SIDED])
def test_turns_grow_with_the_command(name: str) -> None:
    """Robots 27, V7: the yaw rate is proportional to the command within 0.02 of the turn ratio."""
    robot = ROBOTS[name]
    rates = spun()[0][:, SIDED.index(robot)]
    report = robot.report
    ideal = 2.0 * robot.drive.max_wheel_speed * report.wheel_radius / report.track_width
    ratios = rates / (ideal * np.array(SHARES))
    assert np.all(np.diff(rates) > 0.0)
    assert np.ptp(ratios) < 0.02, ratios


def test_nobody_tips_over_when_it_reverses() -> None:
    """From full speed ahead to full speed astern and to a halt no robot tilts by 20 degrees."""
    robots = [robot for robot in ROBOTS.values() if top_speed(robot) < FAST]
    everyone = crowd(robots, [Pose((0.0, 4.0 * n, r.rest_height)) for n, r in enumerate(robots)])
    for share in (1.0, -1.0, 0.0):
        everyone.drive(share)
        everyone.run(3.0)
    assert everyone.tipped() == {}


@pytest.mark.slow
def test_nobody_tips_over_head_on() -> None:
    """Two robots of similar size that meet at full speed, and go on pushing, stay upright."""
    meetings = [
        (ROBOTS[one], ROBOTS[other])
        for one, other in MEETINGS
        if max(top_speed(ROBOTS[one]), top_speed(ROBOTS[other])) < FAST
    ]
    robots, poses = [], []
    for number, pair in enumerate(meetings):
        way = sum(run_up(robot) for robot in pair)
        for robot, side in zip(pair, (-1.0, 1.0), strict=True):
            place = (side * (way + front(robot)), 4.0 * number, robot.rest_height)
            robots.append(robot)
            poses.append(Pose(place, quaternion_from_rpy(0.0, 0.0, math.pi * (side > 0.0))))
    everyone = crowd(robots, poses)
    everyone.drive(1.0)
    everyone.run(6.0)
    met = [
        abs(everyone.engine.pose(n).position[0] - everyone.engine.pose(n + 1).position[0])
        < front(robots[n]) + front(robots[n + 1]) + 0.1
        for n in range(0, len(robots), 2)
    ]
    assert everyone.tipped() == {}
    assert sum(met) > 0.9 * len(met)


def top_speed(robot: RobotDescription) -> float:
    """m/s."""
    return robot.drive.max_wheel_speed * robot.report.wheel_radius


def run_up(robot: RobotDescription) -> float:
    """Way (m) on which a robot reaches its top speed, and a little more."""
    speed = top_speed(robot)
    return 0.6 * speed**2 / (robot.drive.wheel_acceleration * robot.report.wheel_radius) + 0.05


@cache
def _reach(name: str) -> float:
    model = build_spec(ROBOTS[name]).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    solid = np.flatnonzero(model.geom_contype)
    boxes = model.geom_aabb[solid]
    turned = data.geom_xmat[solid].reshape(-1, 3, 3)[:, 0]
    middles = data.geom_xpos[solid, 0] + (turned * boxes[:, :3]).sum(axis=1)
    return float((middles + (np.abs(turned) * boxes[:, 3:]).sum(axis=1)).max())


def front(robot: RobotDescription) -> float:
    """How far a robot reaches ahead, m."""
    return _reach(robot.name)
