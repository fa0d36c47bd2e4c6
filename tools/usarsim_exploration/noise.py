"""Noise of range finders: readings of walls that are a little too short or too long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.sensing import NEAR, Scans


def disturb(
    scans: Scans, deviation: float, reach: int, shape: tuple[int, int], random: np.random.Generator
) -> Scans:
    """Scans whose readings of walls have normally distributed errors; free rays keep theirs.

    Args:
        scans: as the true world gives them. deviation: standard deviation of the errors, cells.
        reach: of the scanner, cells. shape: rows and columns of the world; rays end inside.
        random: of this robot alone, so that the order of robots changes nothing.
    """
    rows, columns = shape
    errors = np.clip(random.normal(0.0, deviation, scans.readings.shape), -5 * deviation, None)
    wrong = np.clip(scans.readings + errors, 1.0, float(reach))
    most = np.array([columns - 1, rows - 1])

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
