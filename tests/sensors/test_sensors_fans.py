"""Directions of rays and the angles that are announced."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import UDK, UT2004

from usarsim_server.protocol.dialects import ANGLE_UNIT, announced_angle
from usarsim_server.sensors.inertial import angle_difference, each_turn
from usarsim_server.sensors.ranges import AHEAD, cone_directions, fan_at, wire_directions
from usarsim_server.simulation.frames import Pose, pose_from_wire

ANGLE = st.floats(min_value=-20.0, max_value=20.0)


def test_positive_wire_yaw_is_to_the_right() -> None:
    """A quarter turn of wire yaw points to -y of the simulation frame."""
    directions = wire_directions(np.array([0.0, math.pi / 2, -math.pi / 2]))
    assert np.allclose(directions, [[1, 0, 0], [0, -1, 0], [0, 1, 0]])


def test_positive_wire_pitch_is_up() -> None:
    """A quarter turn of wire pitch points to +z of the simulation frame."""
    assert np.allclose(wire_directions(0.0, np.array([math.pi / 2])), [[0, 0, 1]])


@given(ANGLE, st.floats(min_value=-1.5, max_value=1.5))
def test_directions_agree_with_the_pose_conversion(yaw: float, pitch: float) -> None:
    """A direction is where a sensor of that wire yaw and pitch looks."""
    looking = pose_from_wire((0, 0, 0), (0.0, pitch, yaw)).rotate((1.0, 0.0, 0.0))
    assert np.allclose(wire_directions(yaw, pitch)[0], looking, atol=1e-9)


@pytest.mark.parametrize(("cones", "rays"), [(0, 8), (1, 1), (2, 8), (10, 16)])
def test_a_cone_has_its_axis_and_all_rays(cones: int, rays: int) -> None:
    """1 + cones x rays unit vectors, the axis first."""
    directions = cone_directions(0.2, cones, rays)
    assert directions.shape == (1 + cones * rays, 3)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert np.array_equal(directions[0], AHEAD[0])


def test_half_angles_grow_in_equal_steps_to_the_rim() -> None:
    """The original's ten cones open by one degree each up to ten degrees."""
    directions = cone_directions(math.radians(10.0), 10, 16)
    opening = np.degrees(np.arccos(directions[1:, 0])).reshape(10, 16)
    assert np.allclose(opening, np.arange(1, 11)[:, None])


def test_every_cone_has_rays_in_the_horizontal_plane() -> None:
    """Upright obstacles beside the axis meet a ray square on."""
    rings = cone_directions(0.2, 2, 8)[1:].reshape(2, 8, 3)
    for ring in rings:
        flat = ring[np.abs(ring[:, 2]) < 1e-12]
        assert sorted(np.sign(flat[:, 1])) == [-1.0, 1.0]


def test_a_fan_starts_at_the_sensor_and_turns_with_it() -> None:
    """Directions are rotated into the world, the origin is the sensor's place."""
    pose = pose_from_wire((1.0, 2.0, -0.5), (0.0, 0.0, math.pi / 2))
    fan = fan_at(pose, wire_directions(np.array([0.0, math.pi / 2])), 7.0, normals=True)
    assert np.allclose(fan.origin, [1.0, -2.0, 0.5])
    assert np.allclose(fan.directions, [[0, -1, 0], [-1, 0, 0]])
    assert (fan.max_range, fan.normals, fan.through_glass) == (7.0, True, False)


def test_a_fan_does_not_spoil_the_precomputed_directions() -> None:
    """The shared constant of a single ray stays as it is."""
    fan_at(Pose((1.0, 2.0, 3.0), (0.0, 1.0, 0.0, 0.0)), AHEAD, 1.0)
    assert np.array_equal(AHEAD, [[1.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("angle", "udk"), [(3.14159, 3.1414), (math.pi, 3.1415), (0.349, 0.3489), (0.01745, 0.0174)]
)
def test_udk_announces_whole_angle_units(angle: float, udk: float) -> None:
    """Pi as 3.14159 prints 3.1414, the sonar cone 0.3489 (protocol reference 4.6, 4.8)."""
    assert math.floor(announced_angle(angle, UDK) * 1e4) / 1e4 == pytest.approx(udk)
    assert announced_angle(angle, UT2004) == angle


@given(st.floats(min_value=0.0, max_value=7.0))
def test_announced_angles_are_at_most_one_unit_short(angle: float) -> None:
    """Truncation never exceeds the angle and loses less than one unit."""
    assert -1e-12 <= angle - announced_angle(angle, UDK) < ANGLE_UNIT + 1e-12


@given(ANGLE, ANGLE)
def test_differences_take_the_short_way_round(new: float, old: float) -> None:
    """A difference is within half a turn and leads from old to new."""
    turn = angle_difference((new, 0.0, 0.0), (old, 0.0, 0.0))[0]
    assert -math.pi <= turn <= math.pi
    assert math.cos(old + turn) == pytest.approx(math.cos(new), abs=1e-9)
    assert math.sin(old + turn) == pytest.approx(math.sin(new), abs=1e-9)


@given(ANGLE, ANGLE, ANGLE)
def test_each_turn_stays_below_a_whole_turn(x: float, y: float, z: float) -> None:
    """All three angles come to lie in [0, 2 pi)."""
    for before, after in zip((x, y, z), each_turn((x, y, z)), strict=True):
        assert 0.0 <= after < math.tau
        assert math.cos(after) == pytest.approx(math.cos(before), abs=1e-9)


@given(st.floats(-3.0, 3.0))
def test_start_points_move_and_turn_with_the_sensor(yaw: float) -> None:
    """Two rays beside each other stay beside each other wherever the sensor looks."""
    pose = pose_from_wire((1.0, 2.0, -0.5), (0.0, 0.0, yaw))
    starts = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.2]])
    fan = fan_at(pose, np.repeat(AHEAD, 2, axis=0), 3.0, starts=starts)
    assert fan.origin.shape == (2, 3)
    back = (fan.origin - np.array(pose.position)) @ pose.matrix()
    assert np.allclose(back, starts)
    assert np.allclose(fan.directions[0], fan.directions[1])


def test_a_fan_asks_for_no_more_than_it_is_told_to() -> None:
    """Normals, glass and names are extra."""
    pose = pose_from_wire((0.0, 0.0, 0.0))
    plain = fan_at(pose, AHEAD, 3.0)
    assert plain.origin.shape == (3,)
    assert (plain.normals, plain.through_glass, plain.identify) == (False, False, False)
    assert fan_at(pose, AHEAD, 3.0, identify=True).identify
