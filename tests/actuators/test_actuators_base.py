"""Actuators: link numbers, orders, status, GEO and CONF, and the frames in which GEO announces
links (protocol reference 3.9, 3.10, 4.7 to 4.9).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from actuator_fakes import ARM, PAN_TILT, UDK, UT2004, WRIST, Machine, link, robot
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.actuators.articulation import Actuator, announced_link, joint_frame
from usarsim_server.protocol.messages import (
    actuator_configuration,
    actuator_geometry,
    mission_package_configuration,
    mission_package_geometry,
)
from usarsim_server.protocol.requests import LinkTarget
from usarsim_server.robots.description import ActuatorDescription
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.frames import Pose, Vector, pose_from_wire, wire_from_pose

P2AT = robot((PAN_TILT,), (), "P2AT")
ARMS = robot()


def pan_tilt() -> Actuator:
    return Actuator(PAN_TILT, P2AT)


def test_mission_package_geometry_is_as_captured() -> None:
    """The GEO MisPkg line of protocol 4.7, to the letter (protocol 140)."""
    assert mission_package_geometry([pan_tilt().package()]) == (
        "GEO {Type MisPkg} {Name CameraPanTilt} {Link 1} {ParentLink -1} "
        "{Location 0.1200,0.0000,-0.2000} {Orientation 3.1415,0.0000,0.0000} {Link 2} "
        "{ParentLink 1} {Location 0.0000,0.0000,0.0500} {Orientation 1.5707,0.0000,0.0000}"
    )


def test_mission_package_configuration_is_as_captured() -> None:
    """The CONF MisPkg line of protocol 4.8, to the letter; no stops are a minimum above the
    maximum."""
    assert mission_package_configuration(UT2004, [pan_tilt().package()]) == (
        "CONF {Type MisPkg} {Name CameraPanTilt} {Link 1} {JointType Revolute} {MaxSpeed 0.17} "
        "{MaxTorque 20.00} {MinRange 1} {MaxRange 0} {Link 2} {JointType Revolute} "
        "{MaxSpeed 0.17} {MaxTorque 20.00} {MinRange -0.7854} {MaxRange 0.7854}"
    )


def test_actuator_geometry() -> None:
    """GEO Actuator: base on the robot, Parent 0 for the base, the tip behind (protocol 140)."""
    assert actuator_geometry([Actuator(ARM, ARMS).item()]) == (
        "GEO {Type Actuator} {Name ArmA} {Location 0.100,0.000,-0.350} "
        "{Orientation 0.000,0.000,0.000} {Mount Arms} {Link 1} {Parent 0} "
        "{Location 0.000,0.000,0.000} {Orientation 0.00,0.00,0.00} {Link 2} {Parent 1} "
        "{Location 0.050,0.000,-0.080} {Orientation 0.00,1.57,0.00} {Tip 0.18,0.00,0.00}"
    )


def test_actuator_configuration() -> None:
    """CONF Actuator: links from 1, joint type, torque, values (protocol 139)."""
    assert actuator_configuration([Actuator(ARM, ARMS).item()]) == (
        "CONF {Type Actuator} {Name ArmA} {Link 1} {JointType Revolute} {MaxTorque 20.0000} "
        "{MinValue -1.5708} {MaxValue 1.5708} {Link 2} {JointType Prismatic} "
        "{MaxTorque 800.0000} {MinValue 0.0000} {MaxValue 0.3500}"
    )


def test_an_actuator_on_an_actuator_says_what_carries_it() -> None:
    """Mount is the other actuator, MountLink its link, from 1 (protocol 4.7)."""
    item = Actuator(WRIST, ARMS).item()
    assert (item.mount, item.mount_link) == ("ArmA", 2)
    assert "{Mount ArmA} {MountLink 2}" in actuator_geometry([item])


def test_status_ut2004() -> None:
    """MISSTA: two digits of Time and Torque, four of Value, links from 1 (protocol 4.9)."""
    machine = Machine(P2AT)
    machine.positions = {"CameraPanTilt_Joint1": 0.5, "CameraPanTilt_Joint2": -0.1}
    machine.torques = {"CameraPanTilt_Joint1": -20.0, "CameraPanTilt_Joint2": 3.456}
    assert pan_tilt().status(UT2004, machine.state(63.4)) == (
        "MISSTA {Time 63.40} {Name CameraPanTilt} {Link 1} {Value 0.5000} {Torque -20.00} "
        "{Link 2} {Value -0.1000} {Torque 3.45}"
    )


def test_status_udk() -> None:
    """ASTA: four digits of Time, no Torque (protocol 4.9)."""
    machine = Machine(P2AT)
    machine.positions = {"CameraPanTilt_Joint1": 0.5, "CameraPanTilt_Joint2": -0.1}
    assert pan_tilt().status(UDK, machine.state()) == (
        "ASTA {Time 63.4021} {Name CameraPanTilt} {Link 1} {Value 0.5000} {Link 2} {Value -0.1000}"
    )


@pytest.mark.parametrize(("first", "link"), [(1, 1), (0, 0)])
def test_links_count_from_the_number_that_the_command_uses(first: int, link: int) -> None:
    """Link 1 of MISPKG and Link 0 of ACT are the same link (protocol 5.2 no. 5, 157, 158)."""
    orders = pan_tilt().orders([LinkTarget(link, 0.5)], first, None)
    assert orders == {"CameraPanTilt_Joint1": JointOrder(Order.POSITION, 0.5)}


@pytest.mark.parametrize(("first", "links"), [(1, (0, 3, -1, 99)), (0, (2, -1, 99))])
def test_links_out_of_range_are_ignored(first: int, links: tuple[int, ...]) -> None:
    """They do not disturb the other groups of the command (protocol 159)."""
    groups = [LinkTarget(link, 9.0) for link in links]
    groups.insert(1, LinkTarget(first + 1, 0.2))
    orders = pan_tilt().orders(groups, first, None)
    assert orders == {"CameraPanTilt_Joint2": JointOrder(Order.POSITION, 0.2)}


def test_orders_are_position_velocity_and_torque() -> None:
    """Orders 0, 1 and 2; others are ignored (protocol 3.9)."""
    for number, kind in enumerate(Order):
        groups = [LinkTarget(1, 0.5, number)]
        orders = pan_tilt().orders(groups, 1, None)
        if kind is Order.STIFFNESS:
            assert orders == {}
        else:
            assert orders == {"CameraPanTilt_Joint1": JointOrder(kind, 0.5)}
    for number in (-1, 3, 9, 13, 100):
        assert pan_tilt().orders([LinkTarget(1, 0.5, number)], 1, None) == {}


@pytest.mark.parametrize(("number", "value"), [(10, 0.7), (11, 0.4), (12, -2.5)])
def test_relative_orders_add_to_what_is(number: int, value: float) -> None:
    """Orders 10, 11 and 12 are 0, 1 and 2 on top of the present value (robots reference 1.6)."""
    machine = Machine(P2AT)
    machine.positions["CameraPanTilt_Joint1"] = 0.2
    machine.rates["CameraPanTilt_Joint1"] = -0.1
    machine.torques["CameraPanTilt_Joint1"] = -3.0
    orders = pan_tilt().orders([LinkTarget(1, 0.5, number)], 1, machine.state())
    (order,) = orders.values()
    assert order.order == Order(number - 10)
    assert order.value == pytest.approx(value)
    assert pan_tilt().orders([LinkTarget(1, 0.5, number)], 1, None) == {}


DIRECTIONS = st.tuples(st.floats(-math.pi, math.pi), st.floats(-math.pi / 2, math.pi / 2)).map(
    lambda angles: (
        math.cos(angles[0]) * math.cos(angles[1]),
        math.sin(angles[0]) * math.cos(angles[1]),
        math.sin(angles[1]),
    )
)


@pytest.mark.parametrize(
    ("axis", "rotation"),
    [
        ((0, 0, 1), (0, 0, 0)),
        ((0, 0, -1), (math.pi, 0, 0)),
        ((0, 1, 0), (-math.pi / 2, 0, 0)),
        ((0, -1, 0), (math.pi / 2, 0, 0)),
        ((1, 0, 0), (0, math.pi / 2, 0)),
        ((-1, 0, 0), (0, -math.pi / 2, 0)),
    ],
)
def test_axes_along_the_frame(axis: Vector, rotation: Vector) -> None:
    """Down, up, right, left, ahead and back have the rotations one would write by hand."""
    found = wire_from_pose(joint_frame(link("L", "J", axis=axis)))
    assert found[0] == (0, 0, 0)
    assert found[1] == pytest.approx(rotation)


@given(DIRECTIONS)
def test_z_is_the_axis(axis: Vector) -> None:
    """Whatever the axis of a joint, z of its announced frame points along it."""
    one = link("L", "J", axis=axis)
    z = joint_frame(one).rotate((0.0, 0.0, -1.0))  # the wire's z, in the simulation frame
    np.testing.assert_allclose(z, one.axis, atol=1e-9)


@given(DIRECTIONS, DIRECTIONS, st.floats(-3, 3), st.floats(-3, 3))
def test_announced_frames_give_the_pose_of_the_last_link(
    one: Vector, other: Vector, first: float, second: float
) -> None:
    """A client that turns each announced frame about its z axis finds the links where they are."""
    arm = ActuatorDescription(
        "A",
        None,
        pose_from_wire((0.3, 0.1, -0.2), (0.2, -0.3, 0.4)),
        (
            link("L1", "J1", None, one, (0.1, 0.2, 0.3), (0.1, 0.2, -0.3)),
            link("L2", "J2", 0, other, (0.5, -0.1, 0.2), (-0.4, 0.1, 0.2)),
        ),
    )
    true = arm.pose @ arm.links[0].placed(first) @ arm.links[1].placed(second)
    seen = arm.pose
    for index, angle in enumerate((first, second)):
        location, rotation = announced_link(arm, index)
        turn = pose_from_wire((0, 0, 0), (0, 0, angle))
        seen = seen @ pose_from_wire(location, rotation) @ turn
    seen = seen @ joint_frame(arm.links[1]).inverse()
    np.testing.assert_allclose(seen.position, true.position, atol=1e-9)
    np.testing.assert_allclose(seen.matrix(), true.matrix(), atol=1e-9)


def test_links_without_parent_hang_on_the_base() -> None:
    """A base given from outside moves them, and only them."""
    arm = ActuatorDescription(
        "A",
        None,
        pose_from_wire((1.0, 0.0, -2.0)),
        (
            link("L1", "J1", None, (0, 0, 1)),
            link("L2", "J2", 0, (0, 0, 1), (0.1, 0.0, 0.0)),
            link("L3", "J3", None, (0, 0, 1), (0.0, 0.5, 0.0)),
        ),
    )
    base = arm.pose.inverse()
    places = [announced_link(arm, index, base)[0] for index in range(3)]
    assert places == [
        pytest.approx((1.0, 0.0, -2.0)),
        pytest.approx((0.1, 0.0, 0.0)),
        pytest.approx((1.0, 0.5, -2.0)),
    ]
    assert announced_link(arm, 0, Pose())[0] == pytest.approx((0, 0, 0))
