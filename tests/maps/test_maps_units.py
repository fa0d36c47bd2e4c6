"""Frames and units of Unreal and others (worlds reference 2, 13; items 1 to 8, 11, 12); mirrors."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from built_worlds import (
    AXES,
    WEDGE_FACES,
    World,
    build_world,
    import_text,
    mesh_of,
    scene_of,
    thing,
)
from hypothesis import given
from hypothesis import strategies as st
from t3d_maps import corner

from usarsim_maps.scene import Heightfield, Light, map_victim
from usarsim_maps.units import (
    MIRROR,
    ROTATION_UNIT,
    axis_matrix,
    matrix_of_pose,
    pose_of_matrix,
    reflect,
    take_apart,
    unreal_matrix,
    unreal_points,
    unreal_pose,
    unreal_rotation,
)
from usarsim_server.simulation.frames import (
    Pose,
    flip_point,
    pose_from_wire,
    quaternion_from_rpy,
    rpy_from_quaternion,
    wire_from_pose,
)
from usarsim_server.worlds.description import PathNode, Smoke, SmokePuff, SmokeVolume, StartPose

URU = st.integers(-200_000, 200_000)


def unreal_axes(pitch: float, yaw: float, roll: float) -> np.ndarray:
    """Forward, right and up of an actor as columns, in Unreal's own frame (worlds 2.1)."""
    (cp, sp), (cy, sy), (cr, sr) = (
        (math.cos(a * ROTATION_UNIT), math.sin(a * ROTATION_UNIT)) for a in (pitch, yaw, roll)
    )
    forward = (cp * cy, cp * sy, sp)
    right = (sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, -sr * cp)
    up = (-(cr * sp * cy + sr * sy), cy * sr - cr * sp * sy, cr * cp)
    return np.array([forward, right, up]).T


def test_a_point_in_all_frames() -> None:
    """(250, 500, 750) UU is (1, -2, 3) in the simulation and (1, 2, -3) on the wire (worlds 1)."""
    assert unreal_points((250.0, 500.0, 750.0)).tolist() == [1.0, -2.0, 3.0]
    assert flip_point((1.0, -2.0, 3.0)) == (1.0, 2.0, -3.0)


@pytest.mark.parametrize(
    ("rotator", "ours", "wire"),
    [
        ((0, 16384, 0), (0.0, 0.0, -math.pi / 2), (0.0, 0.0, math.pi / 2)),  # worlds 2
        ((-5264, 8776, 0), (0.0, 0.50468, -0.84139), (0.0, -0.50468, 0.84139)),  # worlds 5
    ],
)
def test_angles_in_both_frames(
    rotator: tuple[int, ...], ours: tuple[float, ...], wire: tuple[float, ...]
) -> None:
    """Yaw turns clockwise; a rotator has the angles of the reference."""
    pose = unreal_pose((0, 0, 0), rotator)
    assert rpy_from_quaternion(pose.quaternion) == pytest.approx(ours, abs=1e-5)
    assert wire_from_pose(pose)[1] == pytest.approx(wire, abs=1e-5)


def test_pitch_and_roll() -> None:
    """Pitch 8192 lifts the forward axis to z = 0.7071, roll 8192 the left axis (worlds 3, 4)."""
    assert unreal_rotation(8192, 0, 0)[2, 0] == pytest.approx(math.sqrt(0.5))
    assert unreal_rotation(0, 0, 8192)[2, 1] == pytest.approx(math.sqrt(0.5))


@given(URU, URU, URU)
def test_rotations_agree_with_the_axes(pitch: int, yaw: int, roll: int) -> None:
    """Mirroring Unreal's axes on both sides gives our rotation to rounding (worlds 6)."""
    expected = MIRROR @ unreal_axes(pitch, yaw, roll) @ MIRROR
    np.testing.assert_allclose(unreal_rotation(pitch, yaw, roll), expected, atol=1e-12)


@given(st.tuples(URU, URU, URU), st.tuples(URU, URU, URU))
def test_wire_and_back(location: tuple[int, ...], rotator: tuple[int, ...]) -> None:
    """To the wire and back gives the pose again (worlds 7)."""
    pose = unreal_pose(location, rotator)
    again = pose_from_wire(*wire_from_pose(pose))
    np.testing.assert_allclose(again.matrix(), pose.matrix(), atol=1e-9)
    assert again.position == pytest.approx(pose.position)


def test_more_than_a_turn() -> None:
    """Yaw 81920 has the heading of 16384 (worlds 8)."""
    np.testing.assert_array_equal(unreal_rotation(0, 81920, 0), unreal_rotation(0, 16384, 0))


def test_quarter_turns_are_exact() -> None:
    """Rooms that were turned by 90 degrees keep their walls parallel to the axes to the bit."""
    for yaw in (-81920, -16384, 0, 16384, 32768, 49152):
        assert set(np.abs(unreal_rotation(0, yaw, 0)).ravel().tolist()) <= {0.0, 1.0}


def test_pivot_turns_with_the_actor() -> None:
    """PrePivot (100, 0, 0) with Yaw 16384 moves the origin as T R S T(-pivot) says (worlds 11)."""
    matrix = unreal_matrix((0, 0, 0), (0, 16384, 0), pivot=(100, 0, 0))
    # In Unreal: forward becomes +Y, so -pivot goes to Y = -100, and y is mirrored.
    np.testing.assert_allclose(matrix[:3, 3], (0.0, 0.4, 0.0), atol=1e-12)


def test_scales_multiply() -> None:
    """DrawScale 2 with DrawScale3D (1, 2, 0.5) makes a unit cube 2 x 4 x 1 (worlds 12)."""
    scale = (2.0 * np.array([1.0, 2.0, 0.5])).tolist()
    matrix = unreal_matrix(scale3d=scale)
    np.testing.assert_allclose(np.diag(matrix)[:3], (2.0, 4.0, 1.0))


def test_scales_of_old_brushes() -> None:
    """MainScale acts before the rotation, PostScale after it."""
    matrix = unreal_matrix(rotator=(0, 16384, 0), main_scale=(3, 1, 1), post_scale=(1, 1, 5))
    forward = matrix[:3, :3] @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(forward, (0.0, -3.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(matrix[:3, :3] @ [0.0, 0.0, 1.0], (0.0, 0.0, 5.0), atol=1e-12)


@pytest.mark.parametrize(
    ("up", "point"), [("Z", (1, 2, 3)), ("Y", (1, -3, 2)), ("X", (-2, -3, 1)), ("y", (1, -3, 2))]
)
def test_up_axes(up: str, point: tuple[float, ...]) -> None:
    """Whatever axis of a file points up, it ends as z, by a proper rotation (worlds 2.4)."""
    matrix = axis_matrix(up)
    np.testing.assert_allclose(matrix @ [1.0, 2.0, 3.0], point)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_unknown_axis() -> None:
    """An axis that does not exist is refused."""
    with pytest.raises(ValueError, match="not one of X, Y, Z"):
        axis_matrix("W")


@given(
    st.tuples(URU, URU, URU),
    st.lists(st.sampled_from([-2.0, 0.5, 1.0, 3.0]), min_size=3, max_size=3),
)
def test_matrices_come_apart(rotator: tuple[int, ...], scale: list[float]) -> None:
    """A matrix is its pose after its linear map, which is symmetric, also where it mirrors."""
    matrix = unreal_matrix((100, 200, 300), rotator, scale)
    pose, linear = take_apart(matrix)
    np.testing.assert_allclose(linear, linear.T, atol=1e-9)
    again = matrix_of_pose(pose)
    again[:3, :3] = again[:3, :3] @ linear
    np.testing.assert_allclose(again, matrix, atol=1e-7)
    assert np.linalg.norm(pose_of_matrix(matrix).quaternion) == pytest.approx(1.0)


TURNED = Pose((1.0, 2.0, 0.5), quaternion_from_rpy(0.3, -0.2, 0.7))


def heights(world: World, mirrored: bool) -> np.ndarray:
    """Depths below a grid of places, or below their mirror images."""
    sign = -1.0 if mirrored else 1.0
    places = [
        (x, sign * y, 8.0) for x in np.linspace(-3.03, 3.04, 13) for y in np.linspace(-3.1, 3.1, 13)
    ]
    seen = [world.rays(place, AXES[5:])[0] for place in places]
    felt = [world.solid_rays(place, AXES[5:])[0] for place in places]
    return np.array([seen, felt])


def test_a_level_is_mirrored(tmp_path: Path) -> None:
    """With `mirror` the map is its mirror image, for rays and for contacts (worlds 74)."""
    plain = import_text(tmp_path, corner())
    other = import_text(tmp_path, corner(), mirror=True)
    np.testing.assert_allclose(heights(other, True), heights(plain, False), atol=1e-5)
    apart = np.abs(heights(other, False) - heights(plain, False))
    assert apart[np.isfinite(apart)].max() > 1.0
    assert not other.scene.source.mirrored


def test_objects_and_terrain_are_mirrored(tmp_path: Path) -> None:
    """A turned object without symmetry and a hill end where their images are."""
    wedge = mesh_of(
        [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 1), (1, 0, 1), (0, 2, 1)],
        WEDGE_FACES,
    )
    # A sum of a function of x and one of y: every square is flat, however it is cut in two.
    hills = (0.3 * np.arange(9) % 0.7)[None, :] + (0.2 * np.arange(7) % 0.5)[:, None]
    field = Heightfield("hills", hills, (1.0, 1.0), Pose((-4.0, -2.0, -1.0)))
    scene = scene_of(
        thing(wedge, "wedge", TURNED),
        starts=[StartPose("S", Pose((0, 0, 3)))],
        heightfields=(field,),
    )
    plain, other = build_world(tmp_path, scene), build_world(tmp_path, reflect(scene))
    one, two = heights(plain, False), heights(other, True)
    assert np.isfinite(one).any()
    np.testing.assert_allclose(two, one, atol=2e-3)


def test_twice_is_nothing() -> None:
    """The mirror image of the mirror image is the scene."""
    smoke = Smoke(
        (SmokeVolume("v", "box", TURNED, (1, 2, 3), 0.1),),
        (SmokePuff("p", (1, 2, 3), (1, 1, 1), 5, 0.1, 1),),
    )
    scene = replace(
        scene_of(starts=[StartPose("S", TURNED)], smoke=smoke),
        victims=(map_victim("V", TURNED),),
        path_nodes=(PathNode("N", (1.0, 2.0, 3.0)),),
        lights=(Light("L", position=(1.0, 2.0, 3.0), direction=(0.1, 0.2, -1.0)),),
    )
    once, twice = reflect(scene), reflect(reflect(scene))
    assert once.starts != scene.starts
    assert (twice.starts, twice.victims, twice.smoke) == (scene.starts, scene.victims, scene.smoke)
    assert (twice.path_nodes, twice.lights) == (scene.path_nodes, scene.lights)
    matrix = np.diag([1.0, -1.0, 1.0])
    expected = matrix @ TURNED.matrix() @ matrix
    assert once.starts[0].pose.matrix() == pytest.approx(expected)
