"""The frames in which GEO announces links (protocol reference 4.7)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from actuator_fakes import link
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.actuators.base import announced_link, joint_frame
from usarsim_server.robots.description import ActuatorDescription
from usarsim_server.simulation.frames import Pose, Vector, pose_from_wire, wire_from_pose

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
