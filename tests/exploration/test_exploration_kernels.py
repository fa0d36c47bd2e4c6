"""The loops that cost most: compiled and plain form give the same, bit by bit (EXP-05)."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_exploration.kernels import plain
from usarsim_exploration.kernels.steps import DIAGONAL, FAR, STRAIGHT

compiled = pytest.importorskip("usarsim_exploration.kernels.compiled")


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(2, 40), st.integers(2, 40), st.floats(0.0, 0.6))
def test_floods_agree(seed: int, height: int, width: int, dense: float) -> None:
    """Costs and numbers of expanded cells, from one start and several."""
    random = np.random.default_rng(seed)
    passable = (random.random((height, width)) >= dense).astype(np.uint8)
    starts = np.stack([random.integers(0, width, 3), random.integers(0, height, 3)], axis=1)
    for limit in (10**9, 20):
        one, other = (form.flood(passable, starts, limit) for form in (compiled, plain))
        assert (one[0] == other[0]).all()
        assert one[1] == other[1]


def test_a_flood_is_a_way() -> None:
    """Three straight moves, a diagonal that is open, and a wall that cuts no corner."""
    passable = np.array([[1, 1, 1, 1], [1, 0, 1, 1], [1, 1, 1, 1]], np.uint8)
    for form in (compiled, plain):
        costs, expanded = form.flood(passable, np.array([[0, 0]]), 10**9)
        assert expanded == 11
        assert costs[0].tolist() == [0, STRAIGHT, 2 * STRAIGHT, 3 * STRAIGHT]
        assert costs[1, 1] == FAR
        assert costs[2, 1] == 3 * STRAIGHT  # round the corner, not through it
        assert costs[1, 3] == 2 * STRAIGHT + DIAGONAL


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32), st.floats(0.0, 0.2))
def test_rays_agree(seed: int, dense: float) -> None:
    """From several cells at once."""
    random = np.random.default_rng(seed)
    reach, rows, columns = 12, 30, 40
    blocked = np.full((rows + 2 * reach, columns + 2 * reach), 2, np.uint8)
    blocked[reach:-reach, reach:-reach] = random.random((rows, columns)) < dense
    angles = np.linspace(0, 2 * math.pi, 37)
    steps = np.arange(1, reach + 1)
    fan = np.trunc(np.cos(angles)[:, None] * steps).astype(np.int64)
    down = np.trunc(np.sin(angles)[:, None] * steps).astype(np.int64)
    stride = blocked.shape[1]
    starts = random.integers(reach, rows + reach, 5) * stride + reach + 3
    arguments = blocked.reshape(-1), stride, starts, fan, down
    assert (compiled.march(*arguments) == plain.march(*arguments)).all()
    cells = np.stack([starts % stride, starts // stride], axis=1) - reach
    away = np.hypot(fan, down)
    found = [
        form.sense(*arguments[:3], cells, *arguments[3:], away, 4) for form in (compiled, plain)
    ]
    for one, other in zip(*found, strict=True):
        assert (one == other).all()
    lengths, ends, _, _, walls = found[0]
    marked = [random.choice([0, 1, 3, 4, 6, 9, 17], (rows + 5, columns + 5)).astype(np.uint8)] * 2
    marked[1] = marked[0].copy()
    turns = np.broadcast_to(np.stack([np.cos(angles), np.sin(angles)]), (5, 2, 37)).copy()
    for form, bits in zip((compiled, plain), marked, strict=True):
        form.mark_walls(bits, ends, walls & (lengths < 10), turns, -1, -2)
    assert (marked[0] == marked[1]).all()
    assert np.count_nonzero(marked[0] & 6 == 6) > 5


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32))
def test_walls_and_lines_agree(seed: int) -> None:
    """The wall behind ends of rays, and what lies on lines."""
    random = np.random.default_rng(seed)
    ends = np.cumsum(random.integers(-3, 4, (50, 2)), axis=0) + 100
    hit = random.random(50) < 0.8
    angles = random.random(50) * 6.3
    found = [f.wall_cells(ends, hit, np.cos(angles), np.sin(angles)) for f in (compiled, plain)]
    assert sorted(map(tuple, found[0].tolist())) == sorted(map(tuple, found[1].tolist()))
    values = random.integers(0, 3, (20, 30)).astype(np.uint8)
    pairs = np.stack([random.integers(0, 30 if i % 2 == 0 else 20, 25) for i in range(4)], axis=1)
    assert (compiled.crossings(values, pairs) == plain.crossings(values, pairs)).all()
