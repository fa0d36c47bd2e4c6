"""Robot files with actuators and effectors: what is read, what is refused, what is inherited."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from robot_files import ARM, LINK, PIECE, SENSOR, table, write

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import JointType, RobotDescription
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.articulation import Grip, ToolModel
from usarsim_server.simulation.frames import Pose, wire_from_pose

FINGER: dict[str, Any] = {**LINK, "joint": "prismatic", "limits": [0.01, 0.04]}
GRIPPER: dict[str, Any] = {
    "type": "Gripper",
    "name": "Hand",
    "mount": "Arm_Link2",
    "position": [0.1, 0.0, 0.0],
    "tip": [0.05, 0.0, 0.01],
    "shape": [PIECE],
    "finger": [FINGER, {**FINGER, "axis": [0, 0, -1]}],
    "strength": 12.0,
}


def load(folder: Path, **changes: Any) -> RobotDescription:
    """Load the small test robot with an arm and changes."""
    return load_robot(write(folder, "Test", table(**{"actuator": [ARM], **changes})))


def arm(**changes: Any) -> dict[str, Any]:
    """The arm with changes; None drops a key."""
    return {key: value for key, value in {**ARM, **changes}.items() if value is not None}


def one_link(**changes: Any) -> dict[str, Any]:
    """An arm of one link with changes to the link."""
    return arm(link=[{**LINK, **changes}])


def gripper(**changes: Any) -> dict[str, Any]:
    """The gripper with changes; None drops a key."""
    return {key: value for key, value in {**GRIPPER, **changes}.items() if value is not None}


# -- reading ---------------------------------------------------------------------------------------


def test_links_are_read_into_the_simulation_frame(tmp_path: Path) -> None:
    """Poses, axes, limits and homes of an arm; axes become unit vectors."""
    (actuator,) = load(tmp_path).actuators
    assert (actuator.name, actuator.mount, actuator.package) == ("Arm", None, True)
    assert actuator.pose == Pose((0.1, 0.0, 0.1))
    pan, lift = actuator.links
    assert (pan.body, pan.joint, pan.parent) == ("Arm_Link1", "Arm_Joint1", None)
    assert (lift.body, lift.joint, lift.parent) == ("Arm_Link2", "Arm_Joint2", 0)
    assert pan.axis == (0.0, 0.0, 1.0)
    assert lift.axis == (0.0, -1.0, 0.0)
    assert pan.limits == (-1.0, 2.0)
    assert lift.limits is None
    assert (pan.home, lift.home) == (0.0, 0.5)
    assert lift.pose.position == pytest.approx((0.0, 0.0, 0.1))
    assert pan.type is lift.type is JointType.REVOLUTE
    assert lift.mass == 0.2


@pytest.mark.parametrize(("dialect", "speed"), [("ut2004", 0.1745), ("udk", 1.571)])
def test_defaults_of_links(tmp_path: Path, dialect: str, speed: float) -> None:
    """Speed by era, torque 20, no damping, no stops, axis down, home at zero (robots 1.6, 1.9,
    1.10)."""
    robot = load(tmp_path, actuator=[one_link()], dialect=dialect)
    (link,) = robot.actuators[0].links
    assert (link.max_speed, link.max_torque, link.damping) == (speed, 20.0, 0.0)
    assert (link.axis, link.limits, link.home) == ((0.0, -0.0, -1.0), None, 0.0)


@pytest.mark.parametrize(("limits", "home"), [([0.5, 1.0], 0.5), ([-2.0, -1.0], -1.0)])
def test_home_is_the_limit_next_to_zero(tmp_path: Path, limits: list[float], home: float) -> None:
    """A link whose stops exclude zero appears at the stop that is next to it."""
    robot = load(tmp_path, actuator=[one_link(limits=limits)])
    assert robot.actuators[0].links[0].home == home


def test_links_may_have_names_and_branch(tmp_path: Path) -> None:
    """A name is that of link and joint; `parent` makes a tree of the chain."""
    links = [{**LINK, "name": "Trunk"}, LINK, {**LINK, "name": "Head", "parent": 1}, LINK]
    links.append({**LINK, "parent": 0})
    (actuator,) = load(tmp_path, actuator=[arm(link=links)]).actuators
    names = [(link.body, link.joint, link.parent) for link in actuator.links]
    assert names == [
        ("Trunk", "Trunk", None),
        ("Arm_Link2", "Arm_Joint2", 0),
        ("Head", "Head", 0),
        ("Arm_Link4", "Arm_Joint4", 2),
        ("Arm_Link5", "Arm_Joint5", None),
    ]


def test_actuators_sit_on_actuators(tmp_path: Path) -> None:
    """A mount is a link of an actuator above, in any case."""
    second = arm(name="Wrist", mount="arm_link2", position=[0.1, 0, 0], link=[LINK])
    robot = load(tmp_path, actuator=[ARM, second])
    assert robot.actuators[1].mount == "Arm_Link2"
    assert robot.find_link("WRIST_link1") == (robot.actuators[1], 1)
    assert robot.find_link("LeftWheel") is None


def test_home_poses_follow_the_chain(tmp_path: Path) -> None:
    """Where links are when the robot appears, also on an actuator that sits on another."""
    second = arm(name="Wrist", mount="Arm_Link2", position=[0.2, 0, 0], link=[LINK])
    robot = load(tmp_path, actuator=[ARM, second])
    assert robot.home_pose(None) == Pose()
    place, rotation = wire_from_pose(robot.home_pose("Wrist_Link1"))
    assert place == pytest.approx((0.1 + 0.2 * math.cos(0.5), 0, -0.2 - 0.2 * math.sin(0.5)))
    assert rotation == pytest.approx((0, 0.5, 0))
    with pytest.raises(KeyError):
        robot.home_pose("Knee")


def test_effectors_are_read(tmp_path: Path) -> None:
    """Type, mount, tip, fingers that open to their lower limit, parameters for the type."""
    robot = load(tmp_path, effector=[GRIPPER])
    (hand,) = robot.effectors
    assert (hand.item.type, hand.name, hand.item.link) == ("Gripper", "Hand", "Arm_Link2")
    assert hand.tip == (0.05, -0.0, -0.01)
    assert hand.item.parameters == {"strength": 12.0}
    assert [finger.body for finger in hand.fingers] == ["Hand_Finger1", "Hand_Finger2"]
    assert [finger.joint for finger in hand.fingers] == ["Hand_FingerJoint1", "Hand_FingerJoint2"]
    assert {finger.home for finger in hand.fingers} == {0.01}
    assert hand.fingers[0].type is JointType.PRISMATIC
    assert hand.mass == pytest.approx(0.6)


def test_mass_counts_everything_that_hangs_on_the_robot(tmp_path: Path) -> None:
    """Links, fingers and mounted effectors weigh, loose ones do not (robots 8)."""
    loose = {"type": "Gripper", "name": "Spare", "detached": True, "shape": [PIECE]}
    loose["finger"] = [FINGER]
    bare = load_robot(write(tmp_path, "Bare", table())).report.mass
    robot = load(tmp_path, effector=[GRIPPER, loose])
    assert robot.report.mass == pytest.approx(bare + 0.4 + 0.6)


def test_sensors_sit_on_links(tmp_path: Path) -> None:
    """A sensor may name a link of an actuator, in any case."""
    robot = load(tmp_path, sensor=[{**SENSOR, "link": "ARM_LINK1"}])
    assert robot.items[0].link == "Arm_Link1"


# -- refusing --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("actuator", "error"),
    [
        (arm(name=None), "1: name: is missing"),
        (arm(name="7"), "1 \\(7\\): name: is '7'"),
        (arm(name="base"), "not base or free"),
        (arm(link=None), "link: is missing .add an .*actuator.link"),
        (arm(link=[]), "link: is missing"),
        (arm(mount="Knee"), "mount: no link 'Knee' before this"),
        (arm(mount="Arm_Link1"), "mount: no link 'Arm_Link1' before this"),
        (arm(speed=1), "speed: unknown key"),
        (one_link(shape=[]), "shape: all its pieces are weightless"),
        (arm(link=[{"axis": [0, 0, 1]}]), "shape: all its pieces are weightless"),
        (one_link(axis=[0, 0, 0]), "axis: has no direction"),
        (one_link(axis=[1, 0]), "is not 3 numbers"),
        (one_link(limits=[1.0, -1.0]), "limits: are 1 and -1"),
        (one_link(limits=[0.0, 0.0]), "limits: are 0 and 0"),
        (one_link(limits=[0.0, 1.0], home=2.0), "home: 2"),
        (one_link(joint="ball"), "joint: 'ball'"),
        (one_link(max_speed=0), "max_speed: 0"),
        (one_link(max_torque=-1), "max_torque: -1"),
        (one_link(parent=1), "parent: 1"),
        (one_link(parent=-1), "parent: -1"),
        (one_link(parent=0.5), "parent: 0.5"),
        (one_link(velocity=1), "velocity: unknown key"),
        (one_link(name="free"), "not base or free"),
        (one_link(shape=[{**PIECE, "weight": 1}]), "weight: unknown key"),
    ],
)
def test_mistakes_in_actuators(tmp_path: Path, actuator: dict[str, Any], error: str) -> None:
    """A mistake is one error that names the table, the key and the cure."""
    with pytest.raises(RobotDescriptionError, match=error) as caught:
        load(tmp_path, actuator=[actuator])
    assert "Test.toml: [[actuator]] 1" in str(caught.value)


def test_mistakes_in_links_name_both_tables(tmp_path: Path) -> None:
    """The error says which link of which actuator, and which piece of it."""
    bad = arm(link=[LINK, {**LINK, "shape": [PIECE, {**PIECE, "kind": "cone"}]}])
    where = r"\[\[actuator\]\] 1 \(Arm\): \[\[link\]\] 2: \[\[shape\]\] 2: kind"
    with pytest.raises(RobotDescriptionError, match=where):
        load(tmp_path, actuator=[bad])


@pytest.mark.parametrize(
    ("effector", "error"),
    [
        (gripper(type=None), "type: is missing"),
        (gripper(name=None), "name: is missing"),
        (gripper(mount="Nose"), "mount: no link 'Nose'"),
        (gripper(detached=True), "mount: lies loose"),
        (gripper(mount=None, detached=True, shape=None), "shape: all its pieces are weightless"),
        (gripper(finger=[LINK]), r"\[\[finger\]\] 1: limits: is missing"),
        (gripper(finger=[{**FINGER, "parent": 0}]), "parent: unknown key"),
        (gripper(tip=[1, 2]), r"tip: \[1, 2\] is not 3 numbers"),
    ],
)
def test_mistakes_in_effectors(tmp_path: Path, effector: dict[str, Any], error: str) -> None:
    """Mistakes in effectors are found when the file is read."""
    with pytest.raises(RobotDescriptionError, match=error) as caught:
        load(tmp_path, effector=[effector])
    assert "[[effector]] 1" in str(caught.value)


@pytest.mark.parametrize(
    ("effector", "error"),
    [
        (gripper(type="Grippa"), "unknown effector type 'Grippa'.*did you mean Gripper"),
        (gripper(strenght=1.0), "strenght: unknown key of a Gripper .did you mean strength"),
        (gripper(strength=-1.0), "strength: -1.0 is out of range"),
        (gripper(finger=None), "finger: a gripper without fingers"),
        (
            {"type": "ToolChanger", "name": "Changer", "tool": "Spade"},
            "tool: 'Spade' is no detached effector",
        ),
    ],
)
def test_mistakes_in_parameters(tmp_path: Path, effector: dict[str, Any], error: str) -> None:
    """Types and their parameters are checked before a robot is spawned."""
    robot = load(tmp_path, effector=[effector])
    with pytest.raises(RobotDescriptionError, match=error):
        robot_model(robot)


@pytest.mark.parametrize(
    "changes",
    [
        {"actuator": [ARM, arm(name="Other", link=[{**LINK, "name": "Arm_Link1"}])]},
        {"actuator": [one_link(name="leftwheel")]},
        {"effector": [gripper(name="arm_link1", mount=None)]},
    ],
)
def test_two_parts_of_one_name_are_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    """Links, wheels and effectors share one set of names, whatever their case."""
    with pytest.raises(RobotDescriptionError, match="two parts are called"):
        load(tmp_path, **changes)


# -- inheriting ------------------------------------------------------------------------------------


def extend(folder: Path, **changes: Any) -> RobotDescription:
    """A robot that extends the test robot with arm and gripper."""
    write(folder, "Parent", table(actuator=[ARM], effector=[GRIPPER]))
    return load_robot(write(folder, "Child", {"extends": "Parent", **changes}))


def test_limbs_are_inherited_and_share_the_model(tmp_path: Path) -> None:
    """A variant that changes nothing of the body shares parked slots."""
    child = extend(tmp_path, description="as its parent")
    assert [actuator.name for actuator in child.actuators] == ["Arm"]
    assert [effector.name for effector in child.effectors] == ["Hand"]
    assert child.model == "Parent"


def test_limbs_are_replaced_by_name_and_others_added(tmp_path: Path) -> None:
    """An actuator or effector of an inherited name replaces it, and another model follows."""
    slow = arm(name="arm", link=[{**LINK, "max_speed": 0.01}, LINK])
    tail = arm(name="Tail", link=[LINK])
    child = extend(tmp_path, actuator=[slow, tail], effector=[gripper(strength=1.0, mount=None)])
    assert [actuator.name for actuator in child.actuators] == ["arm", "Tail"]
    assert child.actuators[0].links[0].max_speed == 0.01
    assert [effector.item.parameters for effector in child.effectors] == [{"strength": 1.0}]
    assert child.model == "Child"


def test_limbs_can_be_dropped(tmp_path: Path) -> None:
    """`without` drops actuators and effectors as it drops sensors."""
    child = extend(tmp_path, without=["Arm", "Hand"])
    assert child.actuators == child.effectors == ()
    assert [item.name for item in child.items] == ["F1"]


def test_what_sat_on_a_dropped_arm_is_missed(tmp_path: Path) -> None:
    """Dropping an arm and keeping its hand is a mistake, and so is keeping its sensor."""
    with pytest.raises(RobotDescriptionError, match="'Hand' sits on 'Arm_Link2', which is gone"):
        extend(tmp_path, without=["Arm"])
    sensor = {**SENSOR, "link": "Arm_Link1"}
    write(tmp_path, "Seer", table(actuator=[ARM], sensor=[sensor]))
    with pytest.raises(RobotDescriptionError, match="sits on 'Arm_Link1', which is gone"):
        load_robot(write(tmp_path, "Blind", {"extends": "Seer", "without": ["Arm"]}))
    with pytest.raises(RobotDescriptionError, match="no inherited sensor 'Nose'"):
        extend(tmp_path, without=["Nose"])


# -- models ----------------------------------------------------------------------------------------


def test_the_model_has_links_joints_and_servos(tmp_path: Path) -> None:
    """Joints carry limits, home, damping and the force of their servo; bodies their names."""
    links = [
        {**LINK, "limits": [-1.0, 2.0], "home": 0.5, "damping": 3.0, "max_torque": 7.0},
        {**LINK, "joint": "prismatic", "axis": [1, 0, 0]},
    ]
    model = build_spec(load(tmp_path, actuator=[arm(link=links)])).compile()
    joint = model.joint("Arm_Joint1")
    assert joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE
    assert joint.range == pytest.approx((-1.0, 2.0))
    assert joint.limited[0]
    assert joint.qpos0[0] == 0.5
    assert model.dof_frictionloss[joint.dofadr[0]] == 7.0
    assert model.dof_damping[joint.dofadr[0]] == 3.0
    slide = model.joint("Arm_Joint2")
    assert slide.type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    assert not slide.limited[0]
    assert model.body("Arm_Link2").parentid[0] == model.body("Arm_Link1").id
    assert model.body("Arm_Link1").parentid[0] == model.body("base").id


def test_positive_turns_are_right_handed_about_the_wire_axis(tmp_path: Path) -> None:
    """A lift about the axis to the right raises, a pan about the axis upwards goes left."""
    model = build_spec(load(tmp_path, effector=[gripper(position=[0.3, 0, 0])])).compile()
    data = mujoco.MjData(model)
    data.joint("Arm_Joint1").qpos[0] = 0.4
    data.joint("Arm_Joint2").qpos[0] = 0.7
    mujoco.mj_kinematics(model, data)
    ahead = 0.3 * math.cos(0.7)
    expected = [
        0.1 + ahead * math.cos(0.4),
        ahead * math.sin(0.4),
        0.2 + 0.3 * math.sin(0.7),
    ]
    np.testing.assert_allclose(data.body("Hand").xpos, expected, atol=1e-9)


def test_home_and_zero_agree(tmp_path: Path) -> None:
    """The model is built at home, and its joints at zero give the poses of the file."""
    robot = load(tmp_path)
    model = build_spec(robot).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for name in ("Arm_Link1", "Arm_Link2"):
        pose = robot.home_pose(name)
        np.testing.assert_allclose(data.body(name).xpos, pose.position, atol=1e-9)
        np.testing.assert_allclose(data.body(name).xquat, pose.quaternion, atol=1e-9)
    data.joint("Arm_Joint2").qpos[0] = 0.0
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.body("Arm_Link2").xmat.reshape(3, 3), np.eye(3), atol=1e-9)


def test_parts_of_one_robot_never_touch(tmp_path: Path) -> None:
    """All bodies of a robot exclude each other, fingers and loose tools included."""
    loose = gripper(name="Spare", mount=None, detached=True)
    robot = load(tmp_path, effector=[GRIPPER, loose])
    model = build_spec(robot).compile()
    assert model.nexclude == (model.nbody - 1) * (model.nbody - 2) // 2


def test_loose_tools_are_bodies_of_their_own(tmp_path: Path) -> None:
    """A detached effector lies beside the robot on a free joint, at the place of the file."""
    loose = gripper(name="Spare", mount=None, detached=True, position=[1.0, 0.5, -0.3])
    changer = {"type": "ToolChanger", "name": "Changer", "mount": "Arm_Link2"}
    robot = load(tmp_path, effector=[loose, changer])
    model = build_spec(robot).compile()
    assert model.body("Spare").parentid[0] == 0
    assert model.body("Spare").pos == pytest.approx((1.0, -0.5, 0.3))
    assert model.joint("Spare").type[0] == mujoco.mjtJoint.mjJNT_FREE
    (tool,) = robot_model(robot).tools
    assert tool == ToolModel("Spare", Pose((1.0, -0.5, 0.3)))


def test_a_tool_that_is_held_from_the_start_is_at_its_changer(tmp_path: Path) -> None:
    """It appears at the tip of the changer, where the arm is at home."""
    loose = gripper(name="Spare", mount=None, detached=True)
    changer = {"type": "ToolChanger", "name": "Changer", "mount": "Arm_Link2", "tool": "spare"}
    changer |= {"position": [0.1, 0, 0], "tip": [0.1, 0, 0]}
    (tool,) = robot_model(load(tmp_path, effector=[loose, changer])).tools
    assert tool.holder == "Changer"
    place, _ = wire_from_pose(tool.pose)
    assert place == pytest.approx((0.1 + 0.2 * math.cos(0.5), 0, -0.2 - 0.2 * math.sin(0.5)))


def test_robot_model_lists_drives_and_hands(tmp_path: Path) -> None:
    """The simulation is told every joint with a drive, and every hand."""
    model = robot_model(load(tmp_path, effector=[GRIPPER]))
    assert [joint.name for joint in model.joints] == [
        "Arm_Joint1",
        "Arm_Joint2",
        "Hand_FingerJoint1",
        "Hand_FingerJoint2",
    ]
    (hand,) = model.hands
    assert (hand.name, hand.grip, hand.body) == ("Hand", Grip.PINCH, "Hand")
    assert hand.fingers == ("Hand_Finger1", "Hand_Finger2")
    assert hand.strength == 12.0
