"""Small jointed robots and things to take hold of, for tests of joints and hands."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from sim_fakes import Scenery, add_box, add_crate, floor, run

from usarsim_server.simulation.articulation import (
    Grip,
    HandModel,
    JointModel,
    JointOrder,
    Order,
    ToolModel,
)
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import PhysicsOptions, RobotModel

Geom = mujoco.mjtGeom
LENGTH = 0.4
"""Length of a link, m."""
MASS = 0.5
"""Mass of a link, kg, evenly along its length."""
BASE = 0.6
"""Height of the shoulder over the floor, m."""
SERVO = {"solref_friction": (0.02, 1.0), "solimp_friction": (0.999, 0.999, 0.001, 0.5, 2.0)}


def link(
    carrier: mujoco.MjsBody,
    name: str,
    pos: tuple[float, ...],
    axis: tuple[float, ...],
    **joint: object,
) -> mujoco.MjsBody:
    """A rod along x on a joint with a servo."""
    body = carrier.add_body(name=name, pos=pos)
    body.add_joint(name=f"{name}_joint", axis=axis, armature=0.01, **SERVO, **joint)
    body.add_geom(
        type=Geom.mjGEOM_CAPSULE,
        fromto=[0.0, 0.0, 0.0, LENGTH, 0.0, 0.0],
        size=[0.02, 0.0, 0.0],
        mass=MASS,
        contype=0,
        conaffinity=0,
    )
    return body


def slider(
    body: mujoco.MjsBody, name: str, axis: tuple[float, ...], force: float, reach: float
) -> None:
    """A sliding joint with a servo, from 0 to its reach (m)."""
    body.add_joint(
        name=f"{name}_joint",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=axis,
        armature=0.01,
        frictionloss=force,
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=(0.0, reach),
        **SERVO,
    )


def foot(spec: mujoco.MjSpec, mass: float = 50.0) -> mujoco.MjsBody:
    """A heavy box that stands on the floor; its origin is the foot of it."""
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="free")
    base.add_geom(type=Geom.mjGEOM_BOX, size=[0.2, 0.2, 0.08], pos=[0.0, 0.0, 0.08], mass=mass)
    return base


def build_arm(torque: float = 30.0, damping: float = 0.0) -> mujoco.MjSpec:
    """Foot, turntable (`pan`, no stops), shoulder (`lift`, -1 to 1), telescope (`slide`, 0 to 0.3).

    A positive lift raises the rod.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    base = foot(spec)
    pan = base.add_body(name="pan", pos=(0.0, 0.0, BASE))
    pan.add_joint(
        name="pan_joint", axis=(0.0, 0.0, 1.0), armature=0.01, frictionloss=torque, **SERVO
    )
    pan.add_geom(size=[0.03, 0.0, 0.0], mass=0.2, contype=0, conaffinity=0)
    lift = link(
        pan,
        "lift",
        (0.0, 0.0, 0.0),
        (0.0, -1.0, 0.0),
        frictionloss=torque,
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=(-1.0, 1.0),
    )
    slide = lift.add_body(name="slide", pos=(LENGTH, 0.0, 0.0))
    slider(slide, "slide", (1.0, 0.0, 0.0), 40.0, 0.3)
    slide.add_geom(name="slide", size=[0.03, 0.0, 0.0], mass=0.1)
    return spec


ARM = RobotModel(
    key="arm",
    build=build_arm,
    driven=(),
    rest_height=0.0,
    joints=(
        JointModel("pan_joint", 1.5, 30.0),
        JointModel("lift_joint", 1.0, 30.0),
        JointModel("slide_joint", 0.5, 40.0),
    ),
)

LIFT_LOAD = 9.81 * (MASS * LENGTH / 2 + 0.1 * LENGTH)
"""N m that gravity exerts on the level shoulder with the telescope in."""


def arm_engine(
    scenery: Scenery | None = None, model: RobotModel = ARM, count: int = 1, **options: float
) -> Engine:
    """An engine with so many arms, 3 m apart, standing on the floor."""
    engine = Engine(scenery or floor(), PhysicsOptions(**options), [model] * count)  # type: ignore[arg-type]
    for number in range(count):
        engine.occupy(number, number, Pose((0.0, 3.0 * number, 0.0)))
    return engine


def order(engine: Engine, robot: int = 0, *, seconds: float = 0.0, **values: float) -> None:
    """Order positions, `lift=0.5` for `lift_joint`, and let some time pass."""
    _command(engine, robot, Order.POSITION, values, seconds)


def spin(engine: Engine, robot: int = 0, *, seconds: float = 0.0, **values: float) -> None:
    """Order speeds."""
    _command(engine, robot, Order.VELOCITY, values, seconds)


def push(engine: Engine, robot: int = 0, *, seconds: float = 0.0, **values: float) -> None:
    """Order torques."""
    _command(engine, robot, Order.TORQUE, values, seconds)


def _command(
    engine: Engine, robot: int, kind: Order, values: dict[str, float], seconds: float
) -> None:
    orders = {f"{name}_joint": JointOrder(kind, value) for name, value in values.items()}
    engine.command_joints(robot, orders)
    run(engine, seconds)


def position(engine: Engine, joint: str, robot: int = 0) -> float:
    """Present position of a joint."""
    layout = engine.world.layouts[engine.active[robot]]
    return float(engine.data.qpos[layout.joint_qpos[f"{joint}_joint"]])


def rate(engine: Engine, joint: str, robot: int = 0) -> float:
    """Present rate of a joint."""
    layout = engine.world.layouts[engine.active[robot]]
    return float(engine.data.qvel[layout.joint_dof[f"{joint}_joint"]])


def torque(engine: Engine, joint: str, robot: int = 0) -> float:
    """Force of a joint's drive as a snapshot tells it."""
    layout = engine.world.layouts[engine.active[robot]]
    return float(engine.snapshot().torque[layout.joint_dof[f"{joint}_joint"]])


# -- hands -----------------------------------------------------------------------------------------


def build_crane() -> mujoco.MjSpec:
    """Foot, a mast whose carriage (`hoist`, 0 to 0.5 m up) bears a gripper, a cup and a coupling.

    Half a metre ahead of the foot: the gripper's fingers at y = 0, the cup, looking down, at
    y = 0.5, the coupling at y = -0.5. A tool lies below the coupling.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    base = foot(spec)
    hoist = base.add_body(name="hoist", pos=(0.5, 0.0, 0.2))
    slider(hoist, "hoist", (0.0, 0.0, 1.0), 300.0, 0.5)
    hoist.add_geom(size=[0.02, 0.0, 0.0], pos=[0.0, 0.0, 0.3], mass=1.0)
    for name, side in (("left", 1.0), ("right", -1.0)):
        finger = hoist.add_body(name=name, pos=(0.0, 0.12 * side, 0.0))
        slider(finger, name, (0.0, -side, 0.0), 30.0, 0.11)
        finger.add_geom(type=Geom.mjGEOM_BOX, size=[0.04, 0.01, 0.04], mass=0.1)
    hoist.add_body(name="cup", pos=(0.0, 0.5, 0.0))
    hoist.add_body(name="changer", pos=(0.0, -0.5, 0.0))
    tool = spec.worldbody.add_body(name="tool", pos=(0.5, -0.5, 0.1))
    tool.add_freejoint(name="tool")
    tool.add_geom(type=Geom.mjGEOM_BOX, size=[0.05, 0.05, 0.1], mass=0.5)
    for one, other in (("hoist", "left"), ("hoist", "right"), ("left", "right"), ("base", "tool")):
        spec.add_exclude(bodyname1=one, bodyname2=other)
    return spec


DOWN = (float(np.sqrt(0.5)), 0.0, float(np.sqrt(0.5)), 0.0)
"""Turns the x axis downwards."""

CRANE = RobotModel(
    key="crane",
    build=build_crane,
    driven=(),
    rest_height=0.0,
    joints=(
        JointModel("hoist_joint", 0.5, 300.0),
        JointModel("left_joint", 0.2, 30.0),
        JointModel("right_joint", 0.2, 30.0),
    ),
    hands=(
        HandModel("grip", Grip.PINCH, "hoist", fingers=("left", "right"), strength=40.0),
        HandModel(
            "cup", Grip.SUCTION, "cup", Pose((0.0, 0.0, 0.0), DOWN), reach=0.1, strength=30.0
        ),
        HandModel("changer", Grip.COUPLING, "changer", tolerance=(0.15, 0.2), tools=("tool",)),
    ),
    tools=(ToolModel("tool", Pose((0.5, -0.5, 0.1))),),
)

CRANE_WITH_TOOL = replace(
    CRANE,
    key="crane with tool",
    tools=(ToolModel("tool", Pose((0.5, -0.5, 0.2)), holder="changer"),),
)


def storehouse(mass: float = 1.0, cup_mass: float = 1.0) -> mujoco.MjSpec:
    """Floor, a crate between the fingers on a table, a crate below the cup on another."""
    spec = floor()()
    add_box(spec, "table", (0.5, 0.0, 0.04), (0.3, 0.3, 0.04))
    add_crate(spec, "parcel", (0.5, 0.0, 0.15), half=0.07, mass=mass)
    add_crate(spec, "box", (0.5, 0.5, 0.08), half=0.08, mass=cup_mass)
    return spec


def close(engine: Engine, *, seconds: float = 0.0) -> None:
    """Close the fingers and the grip of the first robot."""
    order(engine, left=0.11, right=0.11)
    engine.operate_hand(0, "grip", True)
    run(engine, seconds)


def open_hand(engine: Engine, *, seconds: float = 0.0) -> None:
    """Open the fingers and the grip of the first robot."""
    order(engine, left=0.0, right=0.0)
    engine.operate_hand(0, "grip", False)
    run(engine, seconds)


def holding(engine: Engine, hand: str, robot: int = 0) -> str | None:
    """What a hand holds."""
    return engine.snapshot().hands[engine.active[robot]][hand].holding


def height(engine: Engine, body: str) -> float:
    """Height of a body over the floor."""
    engine.snapshot()
    return float(engine.data.body(body).xpos[2])
