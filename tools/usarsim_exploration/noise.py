"""Noise of range finders: readings of walls that are a little too short or too long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.sensing import NEAR, Scans


def disturb(
    scans: Scans,
    deviation: float,
    reach: int,
    shape: tuple[int, int],
    random: np.random.Generator,
    *,
    rounded: bool = True,
) -> Scans:
    """Scans whose readings of walls have normally distributed errors; free rays keep theirs.

    Args:
        scans: as the true world gives them. deviation: standard deviation of the errors, cells.
        reach: of the scanner, cells. shape: rows and columns of the world; rays end inside.
        random: of this robot alone, so that the order of robots changes nothing.
        rounded: rays end as many whole cells too near or too far as is nearest to their errors;
            else readings are cut to whole cells, so that half of all walls come a cell too near,
            however small errors are.
    """
    rows, columns = shape
    errors = np.clip(random.normal(0.0, deviation, scans.readings.shape), -5 * deviation, None)
    wrong = np.clip(scans.readings + errors, 1.0, float(reach))
    most = np.array([columns - 1, rows - 1])
    if rounded:
        return _shifted(scans, wrong, most)

    def ends_at(lengths: NDArray[np.float64]) -> NDArray[np.int64]:
        along = np.trunc(scans.directions * np.maximum(lengths, 0.0)[:, None])
        found: NDArray[np.int64] = np.clip(
            scans.cells[:, None] + along.swapaxes(1, 2).astype(np.int64), 0, most
        )
        return found

    hits = scans.hits
    chosen = hits[..., None]
    return replace(
        scans,
        readings=np.where(hits, wrong, scans.readings),
        ends=np.where(chosen, ends_at(wrong), scans.ends),
        free_ends=np.where(chosen, ends_at(wrong - 1.0), scans.free_ends),
        near_ends=np.where(chosen, ends_at(np.minimum(wrong - 1.0, NEAR * reach)), scans.near_ends),
    )


def _shifted(scans: Scans, wrong: NDArray[np.float64], most: NDArray[np.int64]) -> Scans:
    """Scans whose rays end elsewhere by whole cells.

    Args:
        wrong: (scans, rays) readings with their errors. most: last column and row of the world.
    """
    along = (wrong - scans.readings)[:, None] * scans.directions
    shift = np.floor(along + 0.5).astype(np.int64).swapaxes(1, 2)
    chosen, origin = scans.hits[..., None], scans.cells[:, None]
    ends, free = (np.clip(one + shift, 0, most) for one in (scans.ends, scans.free_ends))
    behind = ((free - origin) * scans.directions.swapaxes(1, 2)).sum(axis=-1) < 0.0
    free = np.where(behind[..., None], origin, free)
    nearer = np.abs(free - origin).max(axis=-1) < np.abs(scans.near_ends - origin).max(axis=-1)
    return replace(
        scans,
        readings=np.where(scans.hits, wrong, scans.readings),
        ends=np.where(chosen, ends, scans.ends),
        free_ends=np.where(chosen, free, scans.free_ends),
        near_ends=np.where(chosen & nearer[..., None], free, scans.near_ends),
    )
