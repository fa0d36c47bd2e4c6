"""People in Gazebo worlds are models with a mesh; here they become victims."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.gazebo.models import Person
from usarsim_maps.scene import Part, Victim
from usarsim_maps.shapes import points_of
from usarsim_maps.units import pose_of_matrix
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy

Array = NDArray[np.float64]

UPRIGHT = 1.2
"""Height by greatest width of somebody who stands."""

ABOVE = 0.2
"""m above the lowest point of a figure, whence the floor below is looked for."""


def victim_of(name: str, person: Person, matrix: Array, parts: Sequence[Part]) -> Victim:
    """A victim where a model is.

    Args:
        name: of the model.
        person: what its names say.
        matrix: (4, 4) of the model in the world.
        parts: its visible parts, matrices into the world; none if the model is missing.
    """
    yaw = _front(matrix)
    points = [found for found in map(points_of, parts) if len(found)]
    if not points:
        x, y, z = matrix[:3, 3].tolist()
        pose = Pose((x, y, z + ABOVE), quaternion_from_rpy(0.0, 0.0, yaw))
        return Victim(name, pose, person.figure, person.posture)
    cloud = np.concatenate(points)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    size = high - low
    standing = size[2] > UPRIGHT * max(size[0], size[1])
    if not standing:
        yaw = _feet(cloud, matrix)
    x, y, _ = ((low + high) / 2.0).tolist()
    pose = Pose((x, y, float(low[2]) + ABOVE), quaternion_from_rpy(0.0, 0.0, yaw))
    posture = person.posture or ("standing" if standing else "lying")
    return Victim(name, pose, person.figure, posture)


def _front(matrix: Array) -> float:
    """Heading of a face: along x of the model, or along z where its y is up, as modellers do."""
    turn = pose_of_matrix(matrix).matrix()
    front = turn[:, 2] if int(np.argmax(np.abs(turn[2]))) == 1 else turn[:, 0]
    return float(np.arctan2(front[1], front[0]))


def _feet(cloud: Array, matrix: Array) -> float:
    """Heading of the feet of somebody who lies: away from where the model's own up axis leads."""
    flat = cloud[:, :2] - cloud[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(flat[:: max(1, len(flat) // 500)], full_matrices=False)
    along = axes[0]
    head = matrix[:2, :3][:, int(np.argmax(np.abs(along @ matrix[:2, :3])))]
    if along @ head > 0.0:
        along = -along
    return float(np.arctan2(along[1], along[0]))
