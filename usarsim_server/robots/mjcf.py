"""From a robot description to a MuJoCo model, with the settings of robots reference 4.10."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np

from usarsim_server.robots.coupling import moved
from usarsim_server.robots.description import (
    EffectorDescription,
    JointType,
    LinkDescription,
    RobotDescription,
    Shape,
    Wheel,
)
from usarsim_server.simulation.frames import IDENTITY, Pose

BASE = "base"
FREE_JOINT = "free"

WHEEL_FRICTION = (1.0, 0.005, 0.0001)
"""Sliding, torsional and rolling; floors have the same, and the larger of the two counts."""
BODY_FRICTION = (0.5, 0.005, 0.0001)
CONTACT_SOLREF = (0.02, 1.0)
CONTACT_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
ARMATURE = 0.01
"""kg m^2 (kg) that gear and motor add to a driven wheel (robots reference 4.1), and to a link."""
SERVO_SOLREF = (0.02, 1.0)
SERVO_SOLIMP = (0.999, 0.999, 0.001, 0.5, 2.0)
"""Of the servo of a link: it reaches its speed in 10 ms, and sags 0.1 mrad/s under gravity."""
RUBBER = (0.08, 0.08, 0.08, 1.0)

_TYPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "mesh": mujoco.mjtGeom.mjGEOM_MESH,
}


def build_spec(robot: RobotDescription) -> mujoco.MjSpec:
    """Make the model of one robot.

    The root body `base` hangs on the free joint `free`, its origin is the reference point. Body,
    joint, geom and, if driven, actuator of a wheel carry the wheel's name. Links and effectors are
    bodies of their names; detached effectors are root bodies on free joints of their names. Joints
    of links are built at their home positions; what drives them is their friction loss (see
    `servos.py`). Masses, mass centre and inertia follow from the pieces.
    """
    spec = mujoco.MjSpec()
    spec.modelname = robot.model
    spec.compiler.degree = False
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
    _add_meshes(spec, robot)
    limbs = _add_limbs(spec, base, robot)
    for wheel in robot.wheels:
        _add_wheel(base if wheel.link is None else limbs[wheel.link], wheel)
        if wheel.driven:
            _add_servo(spec, wheel, robot.drive.servo_gain, robot.drive.wheel_torque)
    _add_couplings(spec, robot)
    family = robot.family
    if family.anchored:
        base.gravcomp = 1.0  # its anchor has nothing to carry
    # No part of a robot touches another one, arms included.
    parts = [BASE, *(wheel.name for wheel in robot.wheels), *limbs]
    for one, other in itertools.combinations(parts, 2):
        spec.add_exclude(name=f"{one}:{other}", bodyname1=one, bodyname2=other)
    family.complete(spec, robot)
    return spec


def _add_limbs(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: RobotDescription
) -> dict[str, mujoco.MjsBody]:
    """Add links and effectors; returns their bodies by name."""
    bodies: dict[str, mujoco.MjsBody] = {}
    for actuator in robot.actuators:
        carrier = base if actuator.mount is None else bodies[actuator.mount]
        for link in actuator.links:
            if link.parent is None:
                bodies[link.body] = _add_link(carrier, link, actuator.pose)
            else:
                bodies[link.body] = _add_link(bodies[actuator.links[link.parent].body], link)
    for effector in robot.effectors:
        if effector.detached:
            body = spec.worldbody.add_body(name=effector.name)
            body.add_freejoint(name=effector.name)
            body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED
        else:
            link_name = effector.item.link
            body = (base if link_name is None else bodies[link_name]).add_body(name=effector.name)
        _add_effector(body, effector)
        bodies[effector.name] = body
        bodies |= {link.body: _add_link(body, link) for link in effector.fingers}
    return bodies


def _add_couplings(spec: mujoco.MjSpec, robot: RobotDescription) -> None:
    """Hold coupled joints where their leaders say; MuJoCo counts from the home positions."""
    links = {link.joint.lower(): link for link in robot.links}
    for link in robot.links:
        if link.coupling is None:
            continue
        leader = None if link.follows is None else links[link.follows.lower()]
        coefficients = moved(link.coupling, 0.0 if leader is None else leader.home, -link.home)
        spec.add_equality(
            name=f"{link.joint}:coupling",
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=link.joint,
            name2="" if leader is None else leader.joint,
            data=np.append(coefficients, np.zeros(mujoco.mjNEQDATA - len(coefficients))),
            solref=SERVO_SOLREF,
            solimp=SERVO_SOLIMP,
        )


def _add_effector(body: mujoco.MjsBody, effector: EffectorDescription) -> None:
    body.pos, body.quat = effector.item.pose.position, effector.item.pose.quaternion
    for number, shape in enumerate(effector.shapes):
        _add_shape(body, f"{effector.name}:{number}", shape)


def _add_link(
    carrier: mujoco.MjsBody, link: LinkDescription, base: Pose = IDENTITY
) -> mujoco.MjsBody:
    pose = base @ link.placed(link.home)
    body = carrier.add_body(name=link.body, pos=pose.position, quat=pose.quaternion)
    joint = body.add_joint(
        name=link.joint,
        type=(
            mujoco.mjtJoint.mjJNT_HINGE
            if link.type is JointType.REVOLUTE
            else mujoco.mjtJoint.mjJNT_SLIDE
        ),
        axis=link.axis,
        ref=link.home,
        armature=ARMATURE,
        frictionloss=link.max_torque if link.coupling is None else 0.0,
        solref_friction=SERVO_SOLREF,
        solimp_friction=SERVO_SOLIMP,
    )
    # A number, or from MuJoCo 3.17 on the coefficients of a polynomial.
    joint.damping = [link.damping, 0.0, 0.0] if np.ndim(joint.damping) else link.damping
    if link.limits is not None:
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = link.limits
    for number, shape in enumerate(link.shapes):
        _add_shape(body, f"{link.body}:{number}", shape)
    return body


def _add_shape(base: mujoco.MjsBody, name: str, shape: Shape) -> None:
    mesh = "" if shape.mesh is None else name
    base.add_geom(
        name=name,
        type=_TYPES[shape.kind],
        meshname=mesh,
        size=_half_size(shape),
        pos=shape.pose.position,
        quat=shape.pose.quaternion,
        mass=shape.mass,
        friction=BODY_FRICTION,
        contype=int(shape.collides),
        conaffinity=int(shape.collides),
        rgba=shape.color,
    )


def _add_meshes(spec: mujoco.MjSpec, robot: RobotDescription) -> None:
    """Add the triangles of all shapes, under the names of their geoms."""
    groups = [("chassis", robot.shapes)]
    groups += [(link.body, link.shapes) for link in robot.links]
    groups += [(effector.name, effector.shapes) for effector in robot.effectors]
    for body, shapes in groups:
        for number, shape in enumerate(shapes):
            if shape.mesh is not None:
                mesh = spec.add_mesh(name=f"{body}:{number}")
                mesh.uservert = shape.mesh.vertices.ravel()
                mesh.userface = shape.mesh.faces.ravel()
                # Its weight is said elsewhere; a shell may be flat or open.
                mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


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
        case "mesh":
            return [0.0, 0.0, 0.0]
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
        contype=int(wheel.collides),
        conaffinity=int(wheel.collides),
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
