"""Obstacles and what is measured on them (robots reference 3.3, V14 to V22; 5.3 #59 to #64)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usarsim_bench.fidelity.stage import Stage, tilt, turned, yaw_of
from usarsim_bench.fidelity.worlds import FIELD_START, POST, POSTS
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

TOUCH_DOWN = 0.3
"""s that a robot is given to settle on a slope before it gets its command."""
GLANCE = 0.2
"""s between two corrections of the course."""
AHEAD = 1.0
"""m ahead of the robot where it is steered to."""
FIELD_END = FIELD_START + POST * POSTS
"""x of the far edge of a step field, m."""


def climb(stage: Stage, speed: float, seconds: float = 5.0) -> float:
    """Way uphill (m, along the slope) of a robot that stands on it and drives straight ahead.

    The share of the way that the wheels rolled is not asked for: near the limit they slip.
    """
    stage.run(TOUCH_DOWN)
    begin = stage.state
    uphill = np.array(begin.pose.rotate((1.0, 0.0, 0.0)))
    stage.drive(speed, speed)
    stage.run(seconds)
    way = np.subtract(stage.state.pose.position, begin.pose.position)
    return float(way @ uphill)


def creep(stage: Stage, seconds: float = 10.0) -> float:
    """Mean speed (m/s) of a robot told to stand still on a slope; the first second is left out."""
    stage.drive(0.0, 0.0)
    begin = stage.settle()
    stage.run(seconds - 1.0)
    return math.dist(begin.pose.position, stage.state.pose.position) / (seconds - 1.0)


@dataclass(frozen=True, slots=True)
class Crossing:
    """A drive over an obstacle.

    Attributes:
        x, y: where the reference point ended, m.
        rise: its height above where it began, m.
        tilt: largest angle of the robot to the vertical, rad.
        depth: deepest overlap with anything, m.
        jump: longest way of the reference point within one step, m.
        own: whether two parts of the robot ever touched each other.
        warnings: warnings of the server, those of MuJoCo included.
    """

    x: float
    y: float
    rise: float
    tilt: float
    depth: float
    jump: float
    own: bool
    warnings: int


def cross(
    stage: Stage,
    speed: float,
    seconds: float,
    goal: float = math.inf,
    course: float = 0.0,
) -> Crossing:
    """Drive straight on over whatever comes, until x is beyond the goal or time is up.

    Args:
        stage: with a fresh robot that looks along x.
        speed: of the wheels, rad/s.
        seconds: at most.
        goal: x, m.
        course: how an operator keeps to the line y = 0: difference of the wheel speeds of both
            sides (rad/s) per rad off a heading that points to the line `AHEAD` metres ahead,
            corrected every `GLANCE` s. 0: not at all.
    """
    begin = stage.settle()
    probe = stage.probe()
    stage.drive(speed, speed)
    lean = depth = jump = 0.0
    own = False
    last: RobotBody = begin
    for number, state in enumerate(stage.steps(seconds)):
        if course and number % round(GLANCE / stage.timestep) == 0:
            turn = course * _off_course(state)
            stage.drive(speed - turn / 2.0, speed + turn / 2.0)
        contacts = probe.look(state.snapshot)
        depth, own = max(depth, contacts.depth), own or contacts.own
        lean = max(lean, tilt(state))
        jump = max(jump, math.dist(last.pose.position, state.pose.position))
        last = state
        if state.pose.position[0] > goal:
            break
    x, y, z = last.pose.position
    rise = z - begin.pose.position[2]
    return Crossing(x, y, rise, lean, depth, jump, own, len(stage.warnings))


def _off_course(state: RobotBody) -> float:
    """Angle (rad, anticlockwise) from the heading to the line y = 0, `AHEAD` metres ahead."""
    return turned(yaw_of(state), math.atan2(-state.pose.position[1], AHEAD))


@dataclass(frozen=True, slots=True)
class Push:
    """A push against a wall.

    Attributes:
        depth: deepest overlap with anything from the first touch on, m.
        rise: highest lift of the reference point above its rest height, m.
        speed: ground speed at the end, m/s.
        x: where the reference point ended, m.
    """

    depth: float
    rise: float
    speed: float
    x: float


def push_wall(stage: Stage, speed: float, seconds: float = 6.0) -> Push:
    """Drive into the wall of the scene and keep pushing."""
    begin = stage.settle()
    probe = stage.probe()
    stage.drive(speed, speed)
    depth = rise = 0.0
    for state in stage.steps(seconds):
        depth = max(depth, probe.look(state.snapshot).depth)
        rise = max(rise, state.pose.position[2] - begin.pose.position[2])
    end = stage.state
    return Push(depth, rise, math.hypot(*end.linear_velocity[:2]), end.pose.position[0])


def push_crate(stage: Stage, speed: float, way: float) -> tuple[float, float, float]:
    """Push the crate of the scene until it has moved a way (m) or half as much time again is over.

    Returns:
        How far the crate moved, and where it is then, ahead and aside of the robot (m).
    """
    stage.settle()
    crate = stage.probe().model.body("crate").id
    begin = np.array(stage.state.snapshot.xpos[crate])
    stage.drive(speed, speed)
    limit = 1.5 * (way + FIELD_START) / (speed * stage.robot.report.wheel_radius)
    moved, state = 0.0, stage.state
    while moved < way and state.time < limit:
        stage.run(0.1)
        state = stage.state
        moved = float(np.hypot(*(state.snapshot.xpos[crate] - begin)[:2]))
    x, y, z = state.snapshot.xpos[crate].tolist()
    back = state.pose.inverse()
    ahead, aside, _ = back.rotate(
        (x - state.pose.position[0], y - state.pose.position[1], z - state.pose.position[2])
    )
    return moved, ahead, aside


def slide_block(world: Path, timestep: float, speed: float) -> tuple[float, float]:
    """Give the block of the scene a speed (m/s) and let it slide.

    The block is no robot: it is pushed in the physics itself, below the protocol.

    Returns:
        The way on which it stops, and the peak to peak of its height (m).
    """
    description = load_world(world)
    engine = Engine(lambda: build_scene(description), PhysicsOptions(timestep=timestep))
    engine.advance(round(0.5 / timestep))
    data = engine.data
    begin = data.qpos[:3].copy()
    data.qvel[0] = speed
    heights = [float(begin[2])]
    for _ in range(round(2.0 / timestep)):
        engine.advance(1)
        heights.append(float(data.qpos[2]))
    return float(np.hypot(*(data.qpos[:2] - begin[:2]))), max(heights) - min(heights)
