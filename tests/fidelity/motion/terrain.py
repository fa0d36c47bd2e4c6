"""Obstacles, tracks, robots side by side, and what is measured on them.

Robots reference 3.3, V14 to V22; robots 59 to 64. Lanes hold many robots in one simulation, each
driven by itself below the protocol.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from motion import worlds
from motion.stage import Stage, turned, yaw_of
from motion.workshop import Workshop
from motion.worlds import FIELD_START, POST, POSTS, Scene
from usarsim_doctor.test_drive import tilt
from usarsim_server.robots.description import RobotDescription
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import robot_model
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

LANE = 4.0
"""m between the middles of two lanes."""
SETTLE = 2.0
"""s in which robots come to rest and flippers reach their angles."""
LANE_GLANCE = 5
"""Steps between two looks."""


@dataclass(frozen=True, slots=True)
class Lane:
    """What one robot does."""

    robot: RobotDescription  # of what class
    spin: float  # of its driven wheels, rad/s; a robot that backs stands the other way round
    posture: Mapping[str, float] = field(default_factory=dict)  # angles of joints, rad


@dataclass(frozen=True, slots=True)
class LaneRun:
    """How it went."""

    tilt: float  # largest angle of the robot to the vertical, rad
    ahead: float  # way of the reference point along the lane, m
    rise: float  # of the reference point, m


def drive_lanes(
    shop: Workshop, scene: Scene, lanes: Sequence[Lane], timestep: float, seconds: float
) -> list[LaneRun]:
    """Let all robots drive for some s along x, from x = 0, in lanes centred about y = 0, in a scene
    that is at least `LANE` wide for each of them; the time step is in s."""
    models = {lane.robot.model: robot_model(lane.robot) for lane in lanes}
    engine = Engine(
        shop.scenery(scene),
        PhysicsOptions(timestep=timestep),
        slots=tuple(models[lane.robot.model] for lane in lanes),
    )
    for number, lane in enumerate(lanes):
        aside = (number - (len(lanes) - 1) / 2.0) * LANE
        turned = quaternion_from_rpy(0.0, 0.0, 0.0 if lane.spin >= 0.0 else math.pi)
        engine.occupy(number, number, Pose((0.0, aside, lane.robot.rest_height), turned))
        orders = {name: JointOrder(Order.POSITION, angle) for name, angle in lane.posture.items()}
        engine.command_joints(number, orders)
    engine.advance(round(SETTLE / timestep))
    bases = [layout.base for layout in engine.world.layouts]
    begin = engine.data.xpos[bases].copy()
    for number, lane in enumerate(lanes):
        engine.drive(number, np.full(len(lane.robot.driven_wheels), lane.spin))
    upright = np.ones(len(lanes))
    for _ in range(round(seconds / timestep / LANE_GLANCE)):
        engine.advance(LANE_GLANCE)
        upright = np.minimum(upright, engine.data.xmat[bases, 8])
    way = engine.data.xpos[bases] - begin
    tilts = np.arccos(np.clip(upright, -1.0, 1.0))
    return [
        LaneRun(float(tilt), float(ahead), float(rise))
        for tilt, (ahead, _, rise) in zip(tilts, way, strict=True)
    ]


TOUCH_DOWN = 0.3
"""s that a robot is given to settle on a slope before it gets its command."""
GLANCE = 0.2
"""s between two corrections of the course."""
AHEAD = 1.0
"""m ahead of the robot where it is steered to."""
FIELD_END = FIELD_START + POST * POSTS
"""x of the far edge of a step field, m."""
BEYOND = 0.3
"""m behind a field where it counts as crossed."""
LOW_POSTS = tuple(n / 100 for n in range(7))


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
    """A drive over an obstacle."""

    x: float  # where the reference point ended, m
    y: float
    rise: float  # its height above where it began, m
    tilt: float  # largest angle of the robot to the vertical, rad
    depth: float  # deepest overlap with anything, m
    jump: float  # longest way of the reference point within one step, m
    own: bool  # whether two parts of the robot ever touched each other
    warnings: int  # warnings of the server, those of MuJoCo included

    @property
    def across(self) -> bool:
        """Whether it came out on the far side of a step field, not off its edge."""
        return self.x > FIELD_END + BEYOND and abs(self.y) < 0.6


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
        if course and number % round(GLANCE / stage.glance) == 0:
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
    """A push against a wall."""

    depth: float  # deepest overlap with anything from the first touch on, m
    rise: float  # highest lift of the reference point above its rest height, m
    speed: float  # ground speed at the end, m/s
    x: float  # where the reference point ended, m

    @property
    def before(self) -> float:
        """How far before the wall, m."""
        return FIELD_START - self.x


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
        How far the crate moved, and how far it is then ahead and aside of the robot (m).
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
    return moved, ahead, abs(aside)


def slide_block(world: Path, timestep: float, speed: float) -> float:
    """Give the block of the scene a speed (m/s); returns the way on which it stops (m).

    The block is no robot: it is pushed in the physics itself, below the protocol.
    """
    description = load_world(world)
    engine = Engine(lambda: build_scene(description), PhysicsOptions(timestep=timestep))
    engine.advance(round(0.5 / timestep))
    begin = engine.data.qpos[:2].copy()
    engine.data.qvel[0] = speed
    engine.advance(round(2.0 / timestep))
    return float(np.hypot(*(engine.data.qpos[:2] - begin)))


# -- tracks ----------------------------------------------------------------------------------------

RUN = 0.3
"""m/s of the belts in all these tests (robots reference 5.2 #47)."""
TRACKED = (
    *("Kenaf", "Tarantula", "TeleMax", "Talon"),
    *("Rugbot", "Matilda", "crawler_robot", "Soryu"),
)
PUSHES = (1.0, 0.3, -1.0)
"""Shares of their top speed at which robots run into a wall, the last one backwards."""
PUSHING = 10.0
"""s from the start to the end of a push."""
COURSE = 4.0
"""How sharply a robot is steered back to its line (see `cross`)."""
STAIRS_END = FIELD_START + worlds.STEPS * worlds.STEP_RUN
"""x of the edge of the landing, m."""
LOAD = 5.0
"""kg on the tip of a flipper (robots 46)."""
GRAVITY = 9.81


def spin(stage: Stage, belts: float = RUN) -> float:
    """Speed of the sprockets (rad/s) at which the belts run at a speed (m/s)."""
    return belts / stage.robot.driven_wheels[0].radius


def posture(stage: Stage, angles: Mapping[str, float]) -> None:
    """Bring flippers to angles (rad)."""
    groups = " ".join(f"{{{joint} {angle:g}}}" for joint, angle in angles.items())
    stage.client.send(f"MULTIDRIVE {groups}")
    stage.run(2.0)


def raised(front: float, rear: float = 0.0) -> dict[str, float]:
    """Angles of four flippers that are raised by so much (rad) in front and at the back.

    All of them turn about the same axis, so those in front go up with negative angles.
    """
    return {"FRFlipper": -front, "FLFlipper": -front, "RRFlipper": rear, "RLFlipper": rear}


def ground_speed(stage: Stage, seconds: float = 3.0) -> float:
    """Ground speed (m/s) with the belts at `RUN`, after two seconds."""
    stage.settle()
    stage.drive(spin(stage), spin(stage))
    stage.run(2.0)
    begin = stage.state.pose.position
    stage.run(seconds)
    return math.dist(begin[:2], stage.state.pose.position[:2]) / seconds


def flipper_error(
    shop: Workshop, robot: RobotDescription, joint: str, angle: float, timestep: float
) -> float:
    """Largest error (rad) of a flipper that holds an angle with a load hung on its outer roller.

    The load is no thing in the world: it pulls in the physics itself, below the protocol.
    """
    options = PhysicsOptions(timestep=timestep)
    engine = Engine(shop.scenery(worlds.flat()), options, slots=(robot_model(robot),))
    engine.occupy(0, 0, Pose((0.0, 0.0, robot.rest_height)))
    engine.command_joints(0, {joint: JointOrder(Order.POSITION, angle)})
    engine.advance(round(3.0 / timestep))
    layout = engine.world.layouts[0]
    model, data = engine.world.model, engine.data
    body = layout.links[joint.lower()]
    reach = max(
        (model.geom_pos[geom] for geom in layout.geoms if model.geom_bodyid[geom] == body),
        key=lambda place: abs(float(place[0])),
    )
    pull, nothing = np.array([0.0, 0.0, -LOAD * GRAVITY]), np.zeros(3)
    worst = 0.0
    for _ in range(round(2.0 / timestep)):
        point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ reach
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(model, data, pull, nothing, point, body, data.qfrc_applied)
        engine.advance(1)
        worst = max(worst, abs(float(data.qpos[layout.joint_qpos[joint.lower()]]) - angle))
    return worst


def stand_up(stage: Stage) -> tuple[float, float]:
    """Lower all flippers by 0.8 rad: largest error of an angle (rad), and rise of the body (m)."""
    wanted = raised(-0.8, -0.8)
    begin = stage.settle()
    posture(stage, wanted)
    stage.run(4.0)
    end = stage.state
    error = max(abs(end.joint_position(joint) - angle) for joint, angle in wanted.items())
    return error, end.pose.position[2] - begin.pose.position[2]


def tilts_at_wall(shop: Workshop, timestep: float) -> dict[str, float]:
    """Largest tilt (rad) of each class that runs into a wall and goes on, at any of `PUSHES`."""
    lanes = [
        Lane(robot, share * robot.drive.max_wheel_speed)
        for robot in map(shop.describe, TRACKED)
        for share in PUSHES
    ]
    scene = worlds.wall(LANE * len(lanes))
    outcomes = drive_lanes(shop, scene, lanes, timestep, PUSHING)
    worst = dict.fromkeys(TRACKED, 0.0)
    for lane, outcome in zip(lanes, outcomes, strict=True):
        worst[lane.robot.name] = max(worst[lane.robot.name], outcome.tilt)
    return worst
