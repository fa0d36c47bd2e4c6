"""The MuJoCo models: structure, masses, contact settings, and that they stand still."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from machine_fakes import ROBOTS
from robot_files import CASTER, LEFT, RIGHT, SHAPE, table, write

from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.wheeled import SkidSteer
from usarsim_server.robots.mjcf import build_spec

WHEELED = {name: robot for name, robot in ROBOTS.items() if robot.family == SkidSteer()}
PIONEERS = re.compile(r"P[23](AT|DX)(_real)?|pioneer[23](at|dx)_with_sensors")
MODELS = sorted({one.model for one in WHEELED.values() if PIONEERS.fullmatch(one.model)})
"""The robots whose makers gave figures to hold the models against."""


def on_floor(robot: RobotDescription, height: float, copies: int = 1) -> mujoco.MjModel:
    """The robot above a floor, with the physics settings of robots reference 4.10.

    MuJoCo's own velocity actuators run ahead of their wheels if they are as stiff as the servos.
    """
    robot = replace(robot, drive=replace(robot.drive, servo_gain=100.0))
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.004
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 1],
        friction=[1.0, 0.005, 0.0001],
    )
    for copy in range(copies):
        frame = spec.worldbody.add_frame(pos=[0, 2.0 * copy, robot.rest_height + height])
        frame.attach_body(build_spec(robot).body("base"), f"{copy}:", "")
    return spec.compile()


def self_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> int:
    roots = model.body_rootid[model.geom_bodyid[data.contact.geom]]
    return int(np.sum((roots[:, 0] == roots[:, 1]) & (roots[:, 0] != 0)))


@pytest.mark.parametrize("name", ROBOTS)
def test_structure(name: str) -> None:
    """Root `base` on `free`; each wheel is body, joint, geom and actuator of its own name."""
    robot = ROBOTS[name]
    model = build_spec(robot).compile()
    assert model.body("base").parentid[0] == 0
    assert model.joint("free").type[0] == mujoco.mjtJoint.mjJNT_FREE
    assert model.joint("free").bodyid[0] == model.body("base").id
    links = list(robot.links)
    loose = sum(effector.detached for effector in robot.effectors)
    assert model.nbody == 2 + len(robot.wheels) + len(links) + len(robot.effectors)
    assert model.nu == len(robot.driven_wheels)
    assert model.nv == 6 + len(robot.wheels) + len(links) + 6 * loose
    for wheel in robot.wheels:
        body = model.body(wheel.name)
        assert body.parentid[0] == model.body(wheel.link or "base").id
        assert body.pos == pytest.approx(wheel.position)
        assert model.joint(wheel.name).bodyid[0] == body.id
        assert model.joint(wheel.name).axis == pytest.approx((0, 1, 0))
        geom = model.geom(wheel.name)
        assert geom.type[0] == mujoco.mjtGeom.mjGEOM_ELLIPSOID
        assert geom.size == pytest.approx((wheel.radius, wheel.width / 2, wheel.radius))
        assert geom.bodyid[0] == body.id
        actuator = model.actuator(wheel.name)
        assert actuator.trnid[0] == model.joint(wheel.name).id


@pytest.mark.parametrize("name", ROBOTS)
def test_announced_mass_is_the_mass_of_the_bodies(name: str) -> None:
    """CONF Mass equals the sum of all masses that hang on the robot within 0.1 % (robots 8).

    Mission packages are included, tools that lie beside it are not.
    """
    model = build_spec(ROBOTS[name]).compile()
    mass = model.body("base").subtreemass[0]
    assert mass == pytest.approx(ROBOTS[name].report.mass, rel=1e-3)


def test_mass_centre_of_the_real_p3at() -> None:
    """The real-size P3AT has its mass centre 0.15 m above the ground (robots 4.1)."""
    robot = ROBOTS["P3AT_real"]
    model = on_floor(robot, 0.0)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.body("0:base").subtree_com == pytest.approx((0, 0, 0.15), abs=1e-4)


@pytest.mark.parametrize("name", MODELS)
def test_mass_centre_is_low_and_between_the_wheels(name: str) -> None:
    """Every robot is balanced: centre on the middle line, inside the support, below 0.2 m.

    An arm beside the middle line draws it aside, but no more than a centimetre.
    """
    robot = ROBOTS[name]
    model = on_floor(robot, 0.0)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    x, y, z = data.body("0:base").subtree_com
    support = [wheel.position[0] for wheel in robot.wheels]
    support += [caster.position[0] for caster in robot.casters]
    assert min(support) + 0.05 < x < max(support) - 0.03
    lopsided = any(actuator.pose.position[1] for actuator in robot.actuators)
    assert abs(y) < (0.01 if lopsided else 1e-6)
    assert 0.05 < z < 0.2


def test_servos_have_gain_and_limit_of_the_file(tmp_path: Path) -> None:
    """Velocity servos carry the gain and the torque limit of the drive table (robots 4.10)."""
    drive = {"max_wheel_speed": 5, "servo_gain": 7.0, "wheel_torque": 3.0}
    robot = load_robot(write(tmp_path, "Test", table(drive=drive)))
    model = build_spec(robot).compile()
    assert model.actuator_gainprm[:, 0] == pytest.approx([7.0, 7.0])
    assert model.actuator_biasprm[:, 2] == pytest.approx([-7.0, -7.0])
    assert model.actuator_forcelimited.all()
    assert model.actuator_forcerange == pytest.approx(np.array([[-3.0, 3.0], [-3.0, 3.0]]))
    data = mujoco.MjData(model)
    data.ctrl[:] = [100.0, -100.0]
    mujoco.mj_forward(model, data)
    assert data.actuator_force == pytest.approx([3.0, -3.0])


def test_contact_settings() -> None:
    """Friction, condim, solver settings and armature are those of robots 4.10."""
    model = build_spec(ROBOTS["P2DX"]).compile()
    for wheel in ROBOTS["P2DX"].wheels:
        geom = model.geom(wheel.name)
        assert geom.condim[0] == 3
        assert geom.friction[0] == 1.0
        assert geom.priority[0] == 0
        assert geom.solref == pytest.approx((0.02, 1.0))
        assert geom.solimp[:3] == pytest.approx((0.9, 0.95, 0.001))
        assert model.dof_armature[model.joint(wheel.name).dofadr[0]] == 0.01
    caster = model.geom("caster:0")
    assert (caster.condim[0], caster.priority[0], caster.friction[0]) == (1, 1, 0.0)
    assert model.geom("chassis:0").friction[0] == 0.5


def test_decoration_neither_collides_nor_weighs() -> None:
    """Pieces that do not collide have no contact bits; the laser box is such a piece."""
    robot = ROBOTS["P2AT"]
    model = build_spec(robot).compile()
    looks = [n for n, shape in enumerate(robot.shapes) if not shape.collides]
    assert looks
    for number, shape in enumerate(robot.shapes):
        geom = model.geom(f"chassis:{number}")
        assert (geom.contype[0], geom.conaffinity[0]) == (int(shape.collides),) * 2
        assert geom.rgba == pytest.approx(shape.color)


def test_every_kind_of_shape_has_its_size(tmp_path: Path) -> None:
    """Full extents and lengths of the file become MuJoCo's half ones."""
    shapes = [
        {"kind": "box", "size": [0.2, 0.4, 0.6], "mass": 1},
        {"kind": "cylinder", "size": [0.1, 0.4]},
        {"kind": "sphere", "size": [0.1]},
        {"kind": "ellipsoid", "size": [0.1, 0.2, 0.3], "position": [0.1, 0.2, -0.3]},
        {"kind": "capsule", "size": [0.1, 0.4], "rotation": [0, 0, 0.5]},
    ]
    robot = load_robot(write(tmp_path, "Test", table(shape=shapes)))
    model = build_spec(robot).compile()
    sizes = [tuple(model.geom(f"chassis:{number}").size) for number in range(5)]
    assert sizes[0] == pytest.approx((0.1, 0.2, 0.3))
    assert sizes[1][:2] == pytest.approx((0.1, 0.2))
    assert sizes[2][0] == pytest.approx(0.1)
    assert sizes[3] == pytest.approx((0.1, 0.2, 0.3))
    assert sizes[4][:2] == pytest.approx((0.1, 0.2))
    assert model.geom("chassis:3").pos == pytest.approx((0.1, -0.2, 0.3))
    assert model.geom("chassis:4").quat == pytest.approx((np.cos(0.25), 0, 0, -np.sin(0.25)))


def test_free_wheels_have_no_servo(tmp_path: Path) -> None:
    """A wheel that is not driven turns freely: a joint without actuator and armature."""
    free = {**LEFT, "name": "Rear", "position": [-0.2, 0, 0.05], "side": "left", "driven": False}
    robot = load_robot(write(tmp_path, "Test", table(wheel=[LEFT, RIGHT, free], caster=[])))
    model = build_spec(robot).compile()
    assert model.nu == 2
    assert model.dof_armature[model.joint("Rear").dofadr[0]] == 0.0


def test_copies_can_stand_in_one_world() -> None:
    """Specs attach under prefixes; actuators and exclusions come along for every copy."""
    robot = ROBOTS["P3AT"]
    model = on_floor(robot, 0.0, copies=3)
    assert model.nu == 12
    assert model.nexclude == 3 * 10
    assert model.actuator("2:BLWheel").trnid[0] == model.joint("2:BLWheel").id


def test_tree_may_sleep() -> None:
    """The root allows sleeping, which trees with actuators otherwise never do."""
    spec = build_spec(ROBOTS["P3AT"])
    assert spec.body("base").sleep == mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED


@pytest.mark.parametrize("name", MODELS)
def test_settles_at_rest_height(name: str) -> None:
    """Set down, every robot rests within 1 cm of its rest height, upright (robots 17, 63).

    Penetration is below 1 mm, and no part of it ever touches another (robots 61).
    """
    robot = ROBOTS[name]
    model = on_floor(robot, 0.01)
    data = mujoco.MjData(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
        assert self_contacts(model, data) == 0
    base = data.body("0:base")
    assert base.xpos[2] == pytest.approx(robot.rest_height, abs=0.001)
    assert base.xpos[:2] == pytest.approx((0, 0), abs=0.001)
    assert base.xmat[8] > 0.99999
    assert data.contact.dist.min() > -0.001
    assert data.ncon == len(robot.wheels) + len(robot.casters)
    assert np.abs(data.qvel).max() < 1e-3


@pytest.mark.parametrize("name", MODELS)
def test_settles_from_one_metre(name: str) -> None:
    """Dropped from 1 m it is at rest height within 3 s and bounces less than 5 cm (robots 17)."""
    robot = ROBOTS[name]
    model = on_floor(robot, 1.0)
    data = mujoco.MjData(model)
    heights = []
    for _ in range(750):
        mujoco.mj_step(model, data)
        heights.append(data.body("0:base").xpos[2])
    landed = int(np.argmin(heights))
    assert landed < 200
    assert max(heights[landed:]) < robot.rest_height + 0.05
    assert heights[-1] == pytest.approx(robot.rest_height, abs=0.01)
    assert data.body("0:base").xmat[8] > 0.9999
    assert not any(warning.number for warning in data.warning)


@pytest.mark.parametrize("name", MODELS)
def test_positive_spin_rolls_forward(name: str) -> None:
    """Equal positive wheel speeds drive along +x at r w, without touching itself (robots 61)."""
    robot = ROBOTS[name]
    assert speed(robot, 1.2) == pytest.approx(1.2 * robot.report.wheel_radius, rel=0.01)


def speed(robot: RobotDescription, spin: float) -> float:
    """Forward speed (m/s) after half a second at a wheel speed."""
    model = on_floor(robot, 0.0)
    data = mujoco.MjData(model)
    for step in range(250):
        data.ctrl[:] = spin * min(1.0, step / 100)
        mujoco.mj_step(model, data)
        assert self_contacts(model, data) == 0
    assert abs(data.qvel[1]) < 0.01
    return float(data.qvel[0])


def test_wheel_radius_changes_report_and_motion_together(tmp_path: Path) -> None:
    """The robot record is data: another radius changes GEO and speed alike (robots 19)."""
    ratios = []
    for radius in (0.08, 0.12):
        z = 0.15 - radius
        wheels = [
            {**LEFT, "radius": radius, "position": [0, -0.15, z]},
            {**RIGHT, "radius": radius, "position": [0, 0.15, z]},
        ]
        caster = {**CASTER, "position": [-0.15, 0, 0.12]}
        shape = {**SHAPE, "position": [-0.03, 0, 0]}
        robot = load_robot(
            write(tmp_path, "Test", table(wheel=wheels, caster=[caster], shape=[shape]))
        )
        assert robot.report.wheel_radius == radius
        ratios.append(speed(robot, 2.0) / (2.0 * radius))
    assert ratios == pytest.approx([1.0, 1.0], rel=0.01)


@pytest.mark.parametrize("name", ["P2AT", "P3AT", "P3AT_real"])
def test_left_faster_turns_right(name: str) -> None:
    """The left side faster turns clockwise seen from above (robots 34)."""
    robot = ROBOTS[name]
    model = on_floor(robot, 0.0)
    data = mujoco.MjData(model)
    for _ in range(250):
        data.ctrl[:] = [1.0 if wheel.side == "left" else -1.0 for wheel in robot.driven_wheels]
        mujoco.mj_step(model, data)
        assert self_contacts(model, data) == 0
    assert data.qpos[6] < -0.01  # quaternion z: negative is clockwise from above
