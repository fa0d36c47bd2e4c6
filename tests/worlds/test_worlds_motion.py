"""Ways of moving as functions of time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.simulation.frames import Pose, quaternion_from_rpy, rpy_from_quaternion
from usarsim_server.worlds.life import Walk, Wave
from usarsim_server.worlds.victims import swinging, walking

START = (1.0, 2.0, 0.93)
TO_AND_FRO = walking(START, Walk((4.0, 6.0, 0.93), speed=0.5, pause=2.0))
"""5 m in 10 s, heading along 3-4-5, then 2 s of turning."""

HEADING = math.atan2(4.0, 3.0)


def yaw(pose: Pose) -> float:
    """Heading, rad; the walker stands upright."""
    roll, pitch, turn = rpy_from_quaternion(pose.quaternion)
    assert (roll, pitch) == pytest.approx((0.0, 0.0), abs=1e-9)
    return turn


@pytest.mark.parametrize(
    ("time", "place"),
    [
        (0.0, (1.0, 2.0)),
        (5.0, (2.5, 4.0)),
        (10.0, (4.0, 6.0)),
        (11.0, (4.0, 6.0)),
        (12.0, (4.0, 6.0)),
        (17.0, (2.5, 4.0)),
        (22.0, (1.0, 2.0)),
        (24.0, (1.0, 2.0)),
        (29.0, (2.5, 4.0)),
        (2405.0, (2.5, 4.0)),
    ],
)
def test_places_of_a_walk(time: float, place: tuple[float, float]) -> None:
    """There at constant speed, a pause, back, a pause, and again."""
    x, y, z = TO_AND_FRO(time).position
    assert (x, y) == pytest.approx(place, abs=1e-9)
    assert z == 0.93


def test_a_walker_looks_where_he_goes() -> None:
    """Ahead on the way out, back on the way back, turning to the left in between."""
    assert yaw(TO_AND_FRO(3.0)) == pytest.approx(HEADING)
    assert yaw(TO_AND_FRO(11.0)) == pytest.approx(HEADING + math.pi / 2)
    assert yaw(TO_AND_FRO(15.0)) == pytest.approx(HEADING - math.pi)
    assert yaw(TO_AND_FRO(23.0)) == pytest.approx(HEADING - math.pi / 2)
    assert yaw(TO_AND_FRO(24.5)) == pytest.approx(HEADING)


@given(st.floats(0.0, 1e5))
def test_a_walk_is_continuous(time: float) -> None:
    """In a millisecond nobody goes farther than the speed allows, or turns faster."""
    here, soon = TO_AND_FRO(time), TO_AND_FRO(time + 1e-3)
    assert math.dist(here.position, soon.position) < 0.5e-3 * 1.001
    turned = abs(sum(a * b for a, b in zip(here.quaternion, soon.quaternion, strict=True)))
    assert 2 * math.acos(min(turned, 1.0)) < math.pi / 2 * 1e-3 * 1.1 + 1e-6


def test_walks_up_a_slope() -> None:
    """The height changes along with the way."""
    way = walking(START, Walk((4.0, 2.0, 1.93), speed=1.0))
    x, _, z = way(math.sqrt(10.0) / 2).position
    assert (x, z) == pytest.approx((2.5, 1.43))


def test_a_swing_is_a_pendulum_about_x() -> None:
    """The z axis reaches the half angle on both sides, the joint stays where it is."""
    joint = Pose((1.0, 2.0, 3.0), quaternion_from_rpy(0.0, 0.0, 0.5))
    way = swinging(joint, Wave(angle=0.6, period=2.0))
    for time, angle in ((0.0, 0.0), (0.5, 0.6), (1.0, 0.0), (1.5, -0.6), (2.0, 0.0)):
        pose = way(time)
        assert pose.position == joint.position
        up = np.array((joint.inverse() @ Pose(pose.rotate((0.0, 0.0, 1.0)))).position) - np.array(
            joint.inverse().position
        )
        assert up == pytest.approx([0.0, -math.sin(angle), math.cos(angle)], abs=1e-9)
