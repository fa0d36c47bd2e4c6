"""Poses and the border between wire frame and simulation frame (protocol reference 2.5)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from usarsim_server.simulation.frames import (
    IDENTITY,
    Pose,
    flip_point,
    flip_quaternion,
    pose_from_wire,
    quaternion_from_rpy,
    rotation_matrices,
    rpy_from_quaternion,
    wire_from_pose,
    wrap_signed,
    wrap_turn,
)

Array = NDArray[np.float64]
EXACT = 1e-9

angles = st.floats(-math.pi, math.pi)
triples = st.tuples(angles, angles, angles)
points = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
poses = st.builds(lambda p, r: Pose(p, quaternion_from_rpy(*r)), points, triples)
nearly_vertical = st.builds(
    lambda sign, off: sign * (math.pi / 2 - off), st.sampled_from((-1, 1)), st.floats(0.0, 1e-6)
)


def rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll), written out as three elementary rotations."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    answer: Array = rz @ ry @ rx
    return answer


def same_rotation(a: Pose, b: Pose) -> bool:
    """Whether two poses turn vectors alike."""
    return bool(np.allclose(a.matrix(), b.matrix(), atol=EXACT))


class TestWireTable:
    """The table of protocol reference 2.5, one row per test."""

    def test_position_negates_y_and_z(self) -> None:
        """A point keeps x and changes the sign of y and z (protocol reference 2.5)."""
        assert flip_point((1.0, 2.0, 3.0)) == (1.0, -2.0, -3.0)

    def test_quaternion_negates_y_and_z(self) -> None:
        """A quaternion (w, x, y, z) becomes (w, x, -y, -z) (protocol reference 2.5)."""
        assert flip_quaternion((0.1, 0.2, 0.3, 0.4)) == (0.1, 0.2, -0.3, -0.4)

    @given(points, triples)
    def test_rotation_negates_pitch_and_yaw(
        self, location: tuple[float, float, float], rpy: tuple[float, float, float]
    ) -> None:
        """Wire angles (r, p, y) are the simulation's (r, -p, -y), and the point (x, -y, -z)."""
        roll, pitch, yaw = rpy
        pose = pose_from_wire(location, rpy)
        np.testing.assert_allclose(pose.matrix(), rotation(roll, -pitch, -yaw), atol=EXACT)
        assert pose.position == flip_point(location)

    def test_raising_a_robot_lowers_z(self) -> None:
        """A robot raised by 1 m shows a z smaller by 1 (protocol 56)."""
        low, _ = wire_from_pose(Pose((0.0, 0.0, 0.5)))
        high, _ = wire_from_pose(Pose((0.0, 0.0, 1.5)))
        assert high[2] - low[2] == pytest.approx(-1.0)

    def test_moving_right_raises_y(self) -> None:
        """A robot moved 1 m to its right at yaw 0 shows y larger by 1 (protocol 57)."""
        right = IDENTITY.rotate((0.0, -1.0, 0.0))
        assert wire_from_pose(Pose(right))[0] == pytest.approx((0.0, 1.0, 0.0))

    def test_clockwise_raises_yaw(self) -> None:
        """Turning clockwise seen from above increases yaw (protocol 58)."""
        clockwise = quaternion_from_rpy(0.0, 0.0, -0.3)  # negative about the upward axis
        assert wire_from_pose(Pose(quaternion=clockwise))[1] == pytest.approx((0.0, 0.0, 0.3))

    def test_nose_up_is_positive_pitch(self) -> None:
        """A robot whose nose points upwards shows positive pitch (protocol 59)."""
        pose = pose_from_wire((0.0, 0.0, 0.0), (0.0, 0.2, 0.0))
        assert pose.rotate((1.0, 0.0, 0.0))[2] == pytest.approx(math.sin(0.2))

    def test_right_side_down_is_positive_roll(self) -> None:
        """A robot whose right side is lowered shows positive roll (protocol 60)."""
        pose = pose_from_wire((0.0, 0.0, 0.0), (0.2, 0.0, 0.0))
        assert pose.rotate((0.0, -1.0, 0.0))[2] == pytest.approx(-math.sin(0.2))

    def test_quarter_turn_faces_positive_y(self) -> None:
        """Rotation 0,0,1.5708 faces +y of the wire frame (protocol 61)."""
        pose = pose_from_wire((0.0, 0.0, 0.0), (0.0, 0.0, 1.5708))
        nose = flip_point(pose.rotate((1.0, 0.0, 0.0)))
        assert nose == pytest.approx((0.0, 1.0, 0.0), abs=1e-5)

    @given(triples)
    def test_combined_angles_are_yaw_pitch_roll(self, rpy: tuple[float, float, float]) -> None:
        """Seen on the wire a pose is Rz(yaw) Ry(pitch) Rx(roll) (protocol 62)."""
        pose = pose_from_wire((0.0, 0.0, 0.0), rpy)
        flip = np.diag([1.0, -1.0, -1.0])
        np.testing.assert_allclose(flip @ pose.matrix() @ flip, rotation(*rpy), atol=EXACT)


class TestAngles:
    """Roll, pitch and yaw against quaternions."""

    @given(triples)
    def test_quaternion_is_the_product_of_three_turns(
        self, rpy: tuple[float, float, float]
    ) -> None:
        """A quaternion from angles turns vectors as Rz Ry Rx does, within 1e-9."""
        pose = Pose(quaternion=quaternion_from_rpy(*rpy))
        np.testing.assert_allclose(pose.matrix(), rotation(*rpy), atol=EXACT)
        assert math.hypot(*pose.quaternion) == pytest.approx(1.0, abs=1e-12)

    @given(triples)
    def test_angles_give_the_rotation_back(self, rpy: tuple[float, float, float]) -> None:
        """Angles taken from a quaternion describe the same rotation and keep to their ranges."""
        quaternion = quaternion_from_rpy(*rpy)
        roll, pitch, yaw = rpy_from_quaternion(quaternion)
        assert -math.pi < roll <= math.pi
        assert -math.pi < yaw <= math.pi
        assert -math.pi / 2 <= pitch <= math.pi / 2
        np.testing.assert_allclose(
            rotation(roll, pitch, yaw), Pose(quaternion=quaternion).matrix(), atol=EXACT
        )

    @given(angles, nearly_vertical, angles)
    def test_angles_give_the_rotation_back_when_vertical(
        self, roll: float, pitch: float, yaw: float
    ) -> None:
        """That holds for a robot that stands on its nose or tail, too."""
        quaternion = quaternion_from_rpy(roll, pitch, yaw)
        np.testing.assert_allclose(
            rotation(*rpy_from_quaternion(quaternion)), rotation(roll, pitch, yaw), atol=EXACT
        )

    @given(st.tuples(angles, st.floats(-1.57, 1.57), angles))
    def test_angles_survive_the_way_there_and_back(self, rpy: tuple[float, float, float]) -> None:
        """Away from the vertical the angles themselves come back."""
        again = rpy_from_quaternion(quaternion_from_rpy(*rpy))
        for before, after in zip(rpy, again, strict=True):
            assert abs(wrap_signed(after - before)) < EXACT

    @given(triples)
    def test_both_signs_of_a_quaternion_are_one_rotation(
        self, rpy: tuple[float, float, float]
    ) -> None:
        """A quaternion and its negative give the same angles up to whole turns."""
        w, x, y, z = quaternion_from_rpy(*rpy)
        one, other = rpy_from_quaternion((w, x, y, z)), rpy_from_quaternion((-w, -x, -y, -z))
        np.testing.assert_allclose(rotation(*one), rotation(*other), atol=EXACT)

    def test_level_means_exact_zeros(self) -> None:
        """A level pose shows roll and pitch of exactly zero, whatever its heading."""
        for yaw in np.linspace(-3.0, 3.0, 13):
            roll, pitch, seen = rpy_from_quaternion(quaternion_from_rpy(0.0, 0.0, float(yaw)))
            assert (roll, pitch) == (0.0, 0.0)
            assert seen == pytest.approx(float(yaw), abs=1e-12)


class TestWrapping:
    """Angles brought into a range."""

    @given(st.floats(-1e6, 1e6))
    def test_turn_stays_in_range(self, angle: float) -> None:
        """`wrap_turn` answers in [0, 2 pi) and keeps the direction."""
        wrapped = wrap_turn(angle)
        assert 0.0 <= wrapped < math.tau
        assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=EXACT)

    @given(st.floats(-1e6, 1e6))
    def test_signed_stays_in_range(self, angle: float) -> None:
        """`wrap_signed` answers in (-pi, pi] and keeps the direction."""
        wrapped = wrap_signed(angle)
        assert -math.pi < wrapped <= math.pi
        assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=EXACT)

    def test_edges(self) -> None:
        """Pi stays pi, minus pi becomes pi, and a whisker below zero never becomes a full turn."""
        assert wrap_signed(math.pi) == math.pi
        assert wrap_signed(-math.pi) == pytest.approx(math.pi)
        assert wrap_turn(math.tau) == 0.0
        assert wrap_turn(-1e-300) < math.tau


class TestPose:
    """Composition and inverse."""

    @given(points, triples)
    def test_wire_round_trip(
        self, location: tuple[float, float, float], rpy: tuple[float, float, float]
    ) -> None:
        """Wire to simulation and back is the same place and the same rotation."""
        pose = pose_from_wire(location, rpy)
        again = pose_from_wire(*wire_from_pose(pose))
        np.testing.assert_allclose(again.position, pose.position, atol=EXACT)
        assert same_rotation(again, pose)

    @given(poses, poses)
    def test_composition_is_that_of_matrices(self, a: Pose, b: Pose) -> None:
        """`a @ b` turns by the product of both and places b's origin in a's parent."""
        both = a @ b
        np.testing.assert_allclose(both.matrix(), a.matrix() @ b.matrix(), atol=EXACT)
        expected = a.matrix() @ np.array(b.position) + a.position
        np.testing.assert_allclose(both.position, expected, atol=1e-7)

    @given(poses, poses, poses)
    def test_composition_is_associative(self, a: Pose, b: Pose, c: Pose) -> None:
        """It does not matter which joint of a chain is composed first."""
        left, right = (a @ b) @ c, a @ (b @ c)
        np.testing.assert_allclose(left.position, right.position, atol=1e-7)
        assert same_rotation(left, right)

    @given(poses)
    def test_inverse_undoes(self, pose: Pose) -> None:
        """A pose times its inverse is the identity, on both sides."""
        for product in (pose @ pose.inverse(), pose.inverse() @ pose):
            np.testing.assert_allclose(product.position, (0.0, 0.0, 0.0), atol=1e-7)
            assert same_rotation(product, IDENTITY)

    @given(st.lists(poses, min_size=1, max_size=5))
    def test_many_matrices_are_those_of_the_poses(self, poses: list[Pose]) -> None:
        """Turned into matrices together, quaternions give what each gives alone."""
        together = rotation_matrices(np.array([pose.quaternion for pose in poses]))
        for pose, matrix in zip(poses, together, strict=True):
            np.testing.assert_allclose(matrix, pose.matrix(), atol=1e-12)

    @given(poses, points)
    def test_rotate_is_the_matrix(self, pose: Pose, vector: tuple[float, float, float]) -> None:
        """Turning a vector and multiplying with the matrix is the same."""
        np.testing.assert_allclose(pose.rotate(vector), pose.matrix() @ vector, atol=1e-7)

    @given(poses, poses)
    def test_frames_commute_with_composition(self, parent: Pose, local: Pose) -> None:
        """Composing on the wire side and on the simulation side is the same mount in the world."""

        def on_wire(pose: Pose) -> Pose:
            return Pose(flip_point(pose.position), flip_quaternion(pose.quaternion))

        one, other = on_wire(parent @ local), on_wire(parent) @ on_wire(local)
        np.testing.assert_allclose(one.position, other.position, atol=1e-7)
        assert same_rotation(one, other)
