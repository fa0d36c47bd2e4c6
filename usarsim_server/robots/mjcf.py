"""From a robot description to a MuJoCo model, with the settings of robots reference 4.10."""

from __future__ import annotations

import itertools

import mujoco

from usarsim_server.robots.description import RobotDescription, Shape, Wheel

__all__ = ["build_spec"]

BASE = "base"
FREE_JOINT = "free"

WHEEL_FRICTION = (1.0, 0.005, 0.0001)
"""Sliding, torsional and rolling; floors have the same, and the larger of the two counts."""
BODY_FRICTION = (0.5, 0.005, 0.0001)
CONTACT_SOLREF = (0.02, 1.0)
CONTACT_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
ARMATURE = 0.01
"""kg m^2 that gear and motor add to a driven wheel (robots reference 4.1)."""
RUBBER = (0.08, 0.08, 0.08, 1.0)

_TYPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}


def build_spec(robot: RobotDescription) -> mujoco.MjSpec:
    """Make the model of one robot.

    The root body `base` hangs on the free joint `free`, its origin is the reference point. Body,
    joint, geom and, if driven, actuator of a wheel carry the wheel's name. Masses, mass centre and
    inertia follow from the pieces.
    """
    spec = mujoco.MjSpec()
    spec.modelname = robot.model
    base = spec.worldbody.add_body(name=BASE)
    base.add_freejoint(name=FREE_JOINT)
    # Trees with actuators never sleep unless they are told that they may.
    base.sleep = mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED
    for number, shape in enumerate(robot.shapes):
        _add_shape(base, f"chassis:{number}", shape)
    for number, caster in enumerate(robot.casters):
        # Frictionless against everything: priority decides, not the larger friction.
        base.add_geom(
            name=f"caster:{number}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[caster.radius, 0.0, 0.0],
            pos=caster.position,
            mass=caster.mass,
            condim=1,
            priority=1,
            friction=(0.0, 0.0, 0.0),
            solref=CONTACT_SOLREF,
            solimp=CONTACT_SOLIMP,
            rgba=RUBBER,
        )
    for wheel in robot.wheels:
        _add_wheel(base, wheel)
        if wheel.driven:
            _add_servo(spec, wheel, robot.drive.servo_gain, robot.drive.wheel_torque)
    for one, other in itertools.combinations([BASE, *(wheel.name for wheel in robot.wheels)], 2):
        spec.add_exclude(name=f"{one}:{other}", bodyname1=one, bodyname2=other)
    return spec


def _add_shape(base: mujoco.MjsBody, name: str, shape: Shape) -> None:
    base.add_geom(
        name=name,
        type=_TYPES[shape.kind],
        size=_half_size(shape),
        pos=shape.pose.position,
        quat=shape.pose.quaternion,
        mass=shape.mass,
        friction=BODY_FRICTION,
        contype=int(shape.collides),
        conaffinity=int(shape.collides),
        rgba=shape.color,
    )


def _half_size(shape: Shape) -> list[float]:
    """MuJoCo counts from the middle: half extents, half lengths."""
    size = shape.size
    match shape.kind:
        case "box":
            return [value / 2.0 for value in size]
        case "cylinder" | "capsule":
            return [size[0], size[1] / 2.0, 0.0]
        case "sphere":
            return [size[0], 0.0, 0.0]
        case _:
            return list(size)


def _add_wheel(base: mujoco.MjsBody, wheel: Wheel) -> None:
    body = base.add_body(name=wheel.name, pos=wheel.position)
    body.add_joint(
        name=wheel.name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 1.0, 0.0],
        armature=ARMATURE if wheel.driven else 0.0,
    )
    # An ellipsoid touches at one point in the middle of the tread; a cylinder touches along its
    # edges, turns worse and stumbles over steps (robots reference 4.2, 4.5).
    body.add_geom(
        name=wheel.name,
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=[wheel.radius, wheel.width / 2.0, wheel.radius],
        mass=wheel.mass,
        condim=3,
        friction=WHEEL_FRICTION,
        solref=CONTACT_SOLREF,
        solimp=CONTACT_SOLIMP,
        rgba=RUBBER,
    )


def _add_servo(spec: mujoco.MjSpec, wheel: Wheel, gain: float, torque: float) -> None:
    servo = spec.add_actuator(
        name=wheel.name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=wheel.name,
        forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
        forcerange=[-torque, torque],
    )
    servo.set_to_velocity(gain)
