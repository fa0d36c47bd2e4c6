"""The loops that cost most: compiled and plain form give the same, bit by bit (EXP-05)."""

import math
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_exploration import sensing
from usarsim_exploration.environment import Environment
from usarsim_exploration.kernels import plain, plain_looking, plain_trading
from usarsim_exploration.kernels.steps import DIAGONAL, EVERYWHERE, FAR, STRAIGHT
from usarsim_exploration.known_map import MERGED
from usarsim_exploration.sensing import Scanner

compiled = pytest.importorskip("usarsim_exploration.kernels.compiled")
compiled_linking = pytest.importorskip("usarsim_exploration.kernels.linking")
compiled_looking = pytest.importorskip("usarsim_exploration.kernels.looking")
compiled_trading = pytest.importorskip("usarsim_exploration.kernels.trading")


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(2, 40), st.integers(2, 40), st.floats(0.0, 0.6))
def test_floods_agree(seed: int, height: int, width: int, dense: float) -> None:
    """Costs and numbers of expanded cells, from one start and several."""
    random = np.random.default_rng(seed)
    passable = (random.random((height, width)) >= dense).astype(np.uint8)
    starts = np.stack([random.integers(0, width, 3), random.integers(0, height, 3)], axis=1)
    for limit in (10**9, 20):
        one, other = (form.flood(passable, starts, limit, EVERYWHERE) for form in (compiled, plain))
        assert (one[0] == other[0]).all()
        assert one[1] == other[1]
    column, row = targets = np.stack([random.integers(0, width, 2), random.integers(0, height, 2)])
    whole, _ = plain.flood(passable, starts, 10**9, EVERYWHERE)
    one, other = (form.flood(passable, starts, 10**9, targets.T) for form in (compiled, plain))
    assert one[1] == other[1]
    for costs in (one[0], other[0]):
        assert (costs[row, column] == whole[row, column]).all()


def test_a_flood_is_a_way() -> None:
    """Three straight moves, a diagonal that is open, and a wall that cuts no corner."""
    passable = np.array([[1, 1, 1, 1], [1, 0, 1, 1], [1, 1, 1, 1]], np.uint8)
    for form in (compiled, plain):
        costs, expanded = form.flood(passable, np.array([[0, 0]]), 10**9, EVERYWHERE)
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


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(3, 30))
def test_polygons_agree(seed: int, corners: int) -> None:
    """Any, with edges that cross, are filled as OpenCV does."""
    random = np.random.default_rng(seed)
    cells = random.integers(0, 40, (corners, 2))
    masks = np.zeros((2, 40, 40), np.uint8)
    shifted = cells + np.array([7, 3])
    compiled_looking.fill(masks[0], shifted[0], shifted[1:], 7, 3)
    plain_looking.fill(masks[1], cells[0], cells[1:])
    assert (masks[0] == masks[1]).all()


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32),
    st.sampled_from([1, 5, 30, 100]),
    st.sampled_from([0.0, 0.005, 0.02, 0.1]),
    st.floats(0.1, 6.28),
)
def test_looks_agree(seed: int, reach: int, dense: float, view: float) -> None:
    """Maps, what changed and what is counted, after scans from several cells."""
    random = np.random.default_rng(seed)
    rows, columns = random.integers(20, 120, 2)
    world = Environment("rubble", (random.random((rows, columns)) < dense).astype(np.uint8))
    scanner = Scanner(world, reach, view=view)
    cells = [(int(random.integers(columns)), int(random.integers(rows))) for _ in range(3)]
    headings = [0.0, *(random.random(2) * 6.3).tolist()]
    before = random.choice([0, 0, 0, 1, 3, 4, 6, 9, 17, 38], world.shape).astype(np.uint8)
    maps, told = [before.copy(), before.copy()], []
    for form, bits in zip((compiled_looking, plain_looking), maps, strict=True):
        with patch.object(sensing, "look", form.look):
            told.append(scanner.look(bits, cells, headings, bool(seed % 2)))
    assert (maps[0] == maps[1]).all()
    for one, other in zip(*told, strict=True):
        assert one.tolist() == other.tolist()
    assert told[0][0].tolist() == np.flatnonzero(maps[0] != before).tolist()
    flat, found = maps[0].reshape(-1), told[0][1]
    teams = [random.choice([0, 6, 7], flat.size).astype(np.uint8)] * 2
    teams[1] = teams[0].copy()
    walls = world.walls.reshape(-1)
    counts = [
        form.count_first(team, walls, flat, found)
        for form, team in zip((compiled_looking, plain_looking), teams, strict=True)
    ]
    assert counts[0] == counts[1]
    assert (teams[0] == teams[1]).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32))
def test_lines_agree(seed: int) -> None:
    """What lies on lines."""
    random = np.random.default_rng(seed)
    values = random.integers(0, 3, (20, 30)).astype(np.uint8)
    pairs = np.stack([random.integers(0, 30 if i % 2 == 0 else 20, 25) for i in range(4)], axis=1)
    assert (compiled.crossings(values, pairs) == plain.crossings(values, pairs)).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([0.0, 2.5]), st.booleans(), st.integers(0, 9))
def test_expected_links_agree(seed: int, slack: float, by_cells: bool, unknown: int) -> None:
    """Which links can be counted upon, whether lines are followed to their end or not."""
    random = np.random.default_rng(seed)
    bits = random.choice([0, 1, 3, 4, 6], (20, 30), p=[0.1, 0.6, 0.2, 0.05, 0.05]).astype(np.uint8)
    cells, others = (random.integers(0, (30, 20), (count, 2)) for count in (25, 4))
    ranges = np.sort(random.uniform(0.0, 30.0, random.integers(1, 6)))[::-1].copy()
    rest = cells, others, slack, ranges, by_cells, 3, unknown
    one, other = (form.expected(bits, *rest, False) for form in (compiled_linking, plain))
    assert (one == other).all()
    any_ = compiled_linking.expected(bits, *rest, True).any(axis=1)
    assert (any_ == other.any(axis=1)).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.floats(0.0, 0.3), st.booleans())
def test_outlines_agree(seed: int, dense: float, by_cells: bool) -> None:
    """How far a radio reaches."""
    random = np.random.default_rng(seed)
    walls = (random.random((30, 40)) < dense).astype(np.uint8)
    ranges = np.sort(random.uniform(0.0, 50.0, random.integers(1, 6)))[::-1].copy()
    angles = np.linspace(0.0, 2 * np.pi, 30)
    rest = (*random.integers(0, (40, 30)).tolist(), np.stack([np.cos(angles), np.sin(angles)], 1))
    one, other = (
        form.outlined(walls, *rest, ranges, by_cells) for form in (compiled_linking, plain)
    )
    assert (one == other).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 90), st.integers(0, 60))
def test_trades_agree(seed: int, size: int, count: int) -> None:
    """What is news, what a group agrees upon, what is written and sent."""
    random = np.random.default_rng(seed)
    named = random.integers(0, size, count).astype(np.int32)
    cells, others = np.unique(named).astype(np.int64), np.flatnonzero(random.random(size) < 0.3)
    bits, told = random.choice([0, 1, 3, 4, 6, 9, 17, 38], (2, size)).astype(np.uint8)
    new = random.choice([0, 1, 3, 4, 22], len(cells)).astype(np.uint8)
    parts = np.array([(2, 1, len(cells)), (1, 2, len(cells) + len(others))])
    team = np.array([0, 2] if size % 3 else [1, 2, 0])
    arrives = random.random(random.integers(1, 9)) < 0.7
    results = []
    for form in (compiled_trading, plain_trading):
        own, lines, maps = bits.copy(), told.copy(), np.stack([told, bits, told[::-1]])
        found: list[object] = [form.once(size, named)]
        found += form.tell(maps, parts, np.concatenate([cells, others]).astype(np.int32))
        found += [*form.agree(maps, team, cells, MERGED, bool(seed % 2)), maps]
        found += [*form.settle(own, cells, new), own]
        news = form.waiting_news(bits, told, cells, others)
        runs = len(news[2])
        if runs:
            found += [*form.send(lines, *news, int(seed % runs), arrives[:runs]), lines]
        results.append([np.array(one).tolist() for one in (*found, *news)])
    assert results[0] == results[1]
    assert results[0][0] == cells.tolist()
