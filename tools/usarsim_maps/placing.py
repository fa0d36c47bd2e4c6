"""Where instances stand: matrices taken apart into a pose and what is baked into the mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.units import pose_of_matrix
from usarsim_server.simulation.frames import Pose

Array = NDArray[np.float64]


def take_apart(matrix: Array) -> tuple[Pose, Array]:
    """A pose and a linear map (3, 3), so that the matrix is the map followed by the pose.

    The map is symmetric and holds scale, shear and reflection; it is exact for axis scales.
    """
    linear = matrix[:3, :3]
    left, scales, right = np.linalg.svd(linear)
    turn = left @ right
    stretch = right.T @ np.diag(scales) @ right
    if np.linalg.det(turn) < 0.0:
        turn, stretch = -turn, -stretch
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = turn, matrix[:3, 3]
    return pose_of_matrix(rigid), np.round(stretch, 9) + 0.0


def axis_turn(axis: Array, angle: float) -> Array:
    """Rotation (3, 3) about an axis of any length by rad, Rodrigues' formula."""
    length = float(np.linalg.norm(axis))
    if length < 1e-12:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # Quarter turns come out exact, so that walls stay parallel to the axes.
    s, c = np.round(np.sin(angle), 15), np.round(np.cos(angle), 15)
    answer: Array = np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)
    return answer


def matrix_of_pose(pose: Pose) -> Array:
    """(4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = pose.matrix()
    matrix[:3, 3] = pose.position
    return matrix
