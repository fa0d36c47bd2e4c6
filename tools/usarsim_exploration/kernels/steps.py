"""What both forms of the kernels share: costs of moves, the eight moves, and bits of cells."""

import numpy as np

SHIFT = 15
STRAIGHT = 1 << SHIFT
"""Cost of a move to an orthogonal neighbour: lengths are whole numbers of 2^-15 cells."""
DIAGONAL = 46341
"""Cost of a diagonal move: 2^15 times the root of 2, rounded, 1.5e-6 of a cell too much."""
FAR = 2**31 - 1
"""Cost of a cell that cannot be reached; ways of up to 65,000 cells are shorter."""

EVERYWHERE = np.empty((0, 2), np.int64)
"""No targets of a flood: all costs are wanted."""

COLUMNS = np.array([1, 0, -1, 0, 1, -1, -1, 1])
ROWS = np.array([0, 1, 0, -1, 1, 1, -1, -1])
"""The eight moves; the first four are orthogonal."""

FREE, SAFE, WALL, AT_BASE, RELAYED, FELT = 1, 2, 4, 8, 16, 32
"""Bits of a known cell. Safe means certain: driven over, very near, or a measured point of a wall;
at base: this robot knows that the base knows it; relayed: somebody else carries it there; felt:
somebody drove against a wall there, which is newer than all that was seen."""
MARKS = AT_BASE | RELAYED
KNOWN = FREE | SAFE | WALL
