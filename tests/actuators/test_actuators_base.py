"""Actuators: link numbers, orders, status, GEO and CONF (protocol reference 3.9, 3.10, 4.7-4.9)."""

from __future__ import annotations

import pytest
from actuator_fakes import ARM, PAN_TILT, UDK, UT2004, WRIST, Machine, robot

from usarsim_server.actuators.base import Actuator
from usarsim_server.protocol.messages import (
    actuator_configuration,
    actuator_geometry,
    mission_package_configuration,
    mission_package_geometry,
)
from usarsim_server.protocol.requests import LinkTarget
from usarsim_server.simulation.articulation import JointOrder, Order

P2AT = robot((PAN_TILT,), (), "P2AT")
ARMS = robot()


def pan_tilt() -> Actuator:
    return Actuator(PAN_TILT, P2AT)


def test_mission_package_geometry_is_as_captured() -> None:
    """The GEO MisPkg line of 4.7, to the letter (check 140)."""
    assert mission_package_geometry([pan_tilt().package()]) == (
        "GEO {Type MisPkg} {Name CameraPanTilt} {Link 1} {ParentLink -1} "
        "{Location 0.1200,0.0000,-0.2000} {Orientation 3.1415,0.0000,0.0000} {Link 2} "
        "{ParentLink 1} {Location 0.0000,0.0000,0.0500} {Orientation 1.5707,0.0000,0.0000}"
    )


def test_mission_package_configuration_is_as_captured() -> None:
    """The CONF MisPkg line of 4.8, to the letter; no stops are a minimum above the maximum."""
    assert mission_package_configuration(UT2004, [pan_tilt().package()]) == (
        "CONF {Type MisPkg} {Name CameraPanTilt} {Link 1} {JointType Revolute} {MaxSpeed 0.17} "
        "{MaxTorque 20.00} {MinRange 1} {MaxRange 0} {Link 2} {JointType Revolute} "
        "{MaxSpeed 0.17} {MaxTorque 20.00} {MinRange -0.7854} {MaxRange 0.7854}"
    )


def test_actuator_geometry() -> None:
    """GEO Actuator: base on the robot, Parent 0 for the base, the tip behind (check 140)."""
    assert actuator_geometry([Actuator(ARM, ARMS).item()]) == (
        "GEO {Type Actuator} {Name ArmA} {Location 0.100,0.000,-0.350} "
        "{Orientation 0.000,0.000,0.000} {Mount Arms} {Link 1} {Parent 0} "
        "{Location 0.000,0.000,0.000} {Orientation 0.00,0.00,0.00} {Link 2} {Parent 1} "
        "{Location 0.050,0.000,-0.080} {Orientation 0.00,1.57,0.00} {Tip 0.18,0.00,0.00}"
    )


def test_actuator_configuration() -> None:
    """CONF Actuator: links from 1, joint type, torque, values (check 139)."""
    assert actuator_configuration([Actuator(ARM, ARMS).item()]) == (
        "CONF {Type Actuator} {Name ArmA} {Link 1} {JointType Revolute} {MaxTorque 20.0000} "
        "{MinValue -1.5708} {MaxValue 1.5708} {Link 2} {JointType Prismatic} "
        "{MaxTorque 800.0000} {MinValue 0.0000} {MaxValue 0.3500}"
    )


def test_an_actuator_on_an_actuator_says_what_carries_it() -> None:
    """Mount is the other actuator, MountLink its link, from 1 (4.7)."""
    item = Actuator(WRIST, ARMS).item()
    assert (item.mount, item.mount_link) == ("ArmA", 2)
    assert "{Mount ArmA} {MountLink 2}" in actuator_geometry([item])


def test_status_ut2004() -> None:
    """MISSTA: two digits of Time and Torque, four of Value, links from 1 (4.9)."""
    machine = Machine(P2AT)
    machine.positions = {"CameraPanTilt_Joint1": 0.5, "CameraPanTilt_Joint2": -0.1}
    machine.torques = {"CameraPanTilt_Joint1": -20.0, "CameraPanTilt_Joint2": 3.456}
    assert pan_tilt().status(UT2004, machine.state(63.4)) == (
        "MISSTA {Time 63.40} {Name CameraPanTilt} {Link 1} {Value 0.5000} {Torque -20.00} "
        "{Link 2} {Value -0.1000} {Torque 3.45}"
    )


def test_status_udk() -> None:
    """ASTA: four digits of Time, no Torque (4.9)."""
    machine = Machine(P2AT)
    machine.positions = {"CameraPanTilt_Joint1": 0.5, "CameraPanTilt_Joint2": -0.1}
    assert pan_tilt().status(UDK, machine.state()) == (
        "ASTA {Time 63.4021} {Name CameraPanTilt} {Link 1} {Value 0.5000} {Link 2} {Value -0.1000}"
    )


@pytest.mark.parametrize(("first", "link"), [(1, 1), (0, 0)])
def test_links_count_from_the_number_that_the_command_uses(first: int, link: int) -> None:
    """Link 1 of MISPKG and Link 0 of ACT are the same link (5.2 no. 5, checks 157, 158)."""
    orders = pan_tilt().orders([LinkTarget(link, 0.5)], first, None)
    assert orders == {"CameraPanTilt_Joint1": JointOrder(Order.POSITION, 0.5)}


@pytest.mark.parametrize(("first", "links"), [(1, (0, 3, -1, 99)), (0, (2, -1, 99))])
def test_links_out_of_range_are_ignored(first: int, links: tuple[int, ...]) -> None:
    """They do not disturb the other groups of the command (check 159)."""
    groups = [LinkTarget(link, 9.0) for link in links]
    groups.insert(1, LinkTarget(first + 1, 0.2))
    orders = pan_tilt().orders(groups, first, None)
    assert orders == {"CameraPanTilt_Joint2": JointOrder(Order.POSITION, 0.2)}


def test_orders_are_position_velocity_and_torque() -> None:
    """Orders 0, 1 and 2; others are ignored (3.9)."""
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
