"""Figures that are bent: shapes that morph into others, and skins on joints, in their rest pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from usarsim_maps.scene import Array, Integers

FAR = 1e12
"""A joint whose matrix has a larger number is at no place."""


def morphed(points: Array, changes: Sequence[Array], weights: Sequence[float]) -> Array:
    """Points (n, 3) plus the weighted sum of changes, (n, 3) each; one weight for each change."""
    answer = points
    for change, weight in zip(changes, weights, strict=True):
        if weight:
            answer = answer + weight * change
    return answer


def skinned(points: Array, joints: Integers, weights: Array, matrices: Array) -> Array:
    """Points (n, 3) where the joints of a skeleton hold them.

    Args:
        points: of the skin as it was modelled.
        joints: (n, k) numbers of the joints that hold each point.
        weights: (n, k) of these joints. They need not add up to 1; a point without any weight
            follows the first joint.
        matrices: (j, 4, 4) of each joint, from the skin as modelled to where the joint takes it:
            the joint's matrix times its inverse bind matrix.

    Raises:
        ValueError: there is no such joint, or one is at no place.
    """
    if not len(matrices) or (joints.size and not 0 <= joints.min() <= joints.max() < len(matrices)):
        raise ValueError(f"a joint of {len(matrices)} that is not there")
    if not (np.abs(matrices) < FAR).all():
        raise ValueError("a joint is at no place")
    weights = np.maximum(np.nan_to_num(weights), 0.0)
    total = weights.sum(axis=1)
    answer = np.zeros((len(points), 3))
    whole = np.column_stack([points, np.ones(len(points))])
    for column in range(joints.shape[1]):
        moved = np.einsum("nij,nj->ni", matrices[joints[:, column], :3], whole)
        answer += weights[:, column, None] * moved
    held = total > 1e-9
    answer[held] /= total[held, None]
    answer[~held] = whole[~held] @ matrices[0, :3].T
    return answer
