"""Robots side by side in one simulation, each in a lane of its own, driven below the protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from usarsim_bench.fidelity.workshop import Workshop
from usarsim_bench.fidelity.worlds import Scene
from usarsim_server.robots.description import RobotDescription
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.testing import robot_model

LANE = 4.0
"""m between the middles of two lanes."""
SETTLE = 2.0
"""s in which robots come to rest and flippers reach their angles."""
GLANCE = 5
"""Steps between two looks."""


@dataclass(frozen=True, slots=True)
class Lane:
    """What one robot does."""

    robot: RobotDescription  # of what class
    spin: float  # of its driven wheels, rad/s; a robot that backs stands the other way round
    posture: Mapping[str, float] = field(default_factory=dict)  # angles of joints, rad


@dataclass(frozen=True, slots=True)
class Outcome:
    """How it went."""

    tilt: float  # largest angle of the robot to the vertical, rad
    ahead: float  # way of the reference point along the lane, m
    rise: float  # of the reference point, m


def drive_lanes(
    shop: Workshop, scene: Scene, lanes: Sequence[Lane], timestep: float, seconds: float
) -> list[Outcome]:
    """Let all robots drive along x, from x = 0, in lanes centred about y = 0.

    Args:
        shop: makes the world.
        scene: at least `LANE` wide for each robot.
        lanes: robots and what they do.
        timestep: s.
        seconds: that they drive.
    """
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
    for _ in range(round(seconds / timestep / GLANCE)):
        engine.advance(GLANCE)
        upright = np.minimum(upright, engine.data.xmat[bases, 8])
    way = engine.data.xpos[bases] - begin
    tilts = np.arccos(np.clip(upright, -1.0, 1.0))
    return [
        Outcome(float(tilt), float(ahead), float(rise))
        for tilt, (ahead, _, rise) in zip(tilts, way, strict=True)
    ]
