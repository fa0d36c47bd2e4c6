"""How large messages are.

A message has a head, its strategy's letter as text, an entry for each absent robot of which the
taker has not heard as lately, and what is new of the map, as runs of equal cells: start and bits
in four bytes, length in two.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEAD = 32
"""Bytes: who, when, where, heading, state, goal, newest step of the base."""
ENTRY = 32
"""Bytes: the same of an absent robot."""
RUN = 6
"""Bytes of cells that follow each other and have equal bits."""
FRAME = 1500
"""Bytes that get lost together, as in the wireless server."""


def count_runs(cells: NDArray[np.int64], bits: NDArray[np.uint8]) -> int:
    """How many runs some cells make.

    Args:
        cells: flat and sorted. bits: of each.
    """
    if len(cells) < 2:
        return len(cells)
    return 1 + int(np.count_nonzero((np.diff(cells) != 1) | (bits[1:] != bits[:-1])))


def map_size(cells: NDArray[np.int64], bits: NDArray[np.uint8]) -> int:
    """Bytes of some cells of a map, flat and sorted, with their bits."""
    return RUN * count_runs(cells, bits)


def letter_size(letter: Mapping[str, Any]) -> int:
    """Bytes of what a strategy adds: its text; arrays of cells as runs."""
    size = 0
    for key, value in letter.items():
        if isinstance(value, np.ndarray):
            size += len(key) + map_size(value, np.zeros(len(value), np.uint8))
        else:
            size += len(key) + len(repr(value))
    return size
