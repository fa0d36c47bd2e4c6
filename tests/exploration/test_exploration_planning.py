"""Ways: searches, skeletons and topological maps."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels import flood, searching
from usarsim_exploration.kernels.steps import EVERYWHERE, FAR, STRAIGHT
from usarsim_exploration.known_map import FREE, SAFE, WALL, KnownMap
from usarsim_exploration.planning import (
    Floods,
    Path,
    Planner,
    TopologicalMap,
    a_star,
    degrees,
    jump_points,
    key_cells,
    length,
    skeleton,
    thin,
)
from usarsim_exploration.planning.topology import NOWHERE

Mask = NDArray[np.uint8]


def office(columns: int = 200, rows: int = 160, room: int = 40) -> Mask:
    """Rooms with doors at changing places; 1 is free."""
    free = np.ones((rows, columns), np.uint8)
    for column in range(room, columns, room):
        free[:, column : column + 3] = 0
    for row in range(room, rows, room):
        free[row : row + 3] = 0
    for number, column in enumerate(range(room, columns, room)):
        for row in range(10, rows, room):
            free[row + 5 * (number % 3) : row + 5 * (number % 3) + 8, column : column + 3] = 1
    for column in range(12, columns, room):
        free[:, column : column + 8] = 1
    free[[0, -1]] = free[:, [0, -1]] = 0
    return free


def holds(path: Path, start: Cell, passable: Mask) -> bool:
    """Whether all cells are passable neighbours, and no corner is cut."""
    for (c, r), (column, row) in zip([start, *path], path, strict=False):
        if max(abs(column - c), abs(row - r)) != 1:
            return False
        if not (passable[row, column] and passable[r, column] and passable[row, c]):
            return False
    return True


@pytest.mark.parametrize("seed", range(4))
def test_planners_agree(seed: int) -> None:
    """E-43, E-44: over 200 random maps on whether there is a way, and how long it is."""
    random = np.random.default_rng(seed)
    for _ in range(50):
        rows, columns = random.integers(5, 40, 2)
        passable = (random.random((rows, columns)) >= 0.5 * random.random()).astype(np.uint8)
        cells = np.argwhere(passable)[:, ::-1]
        (c1, r1), (c2, r2) = cells[random.integers(0, len(cells), 2)].tolist()
        start, goal = (c1, r1), (c2, r2)
        cost = int(flood(passable, np.array([start]), 10**9, EVERYWHERE)[0][r2, c2])
        topological = TopologicalMap.build(passable, passable == 0).path(passable, start, goal)
        for found in (
            a_star(passable, start, goal),
            jump_points(passable, start, goal),
            topological,
        ):
            assert (found.path is not None) == (cost != FAR)
            assert not found.cut
            if found.path is not None:
                assert holds(found.path, start, passable)
                assert found.length == pytest.approx(length(start, found.path), abs=1e-3)
                assert found is topological or found.length == cost / STRAIGHT


def test_both_forms_search_alike() -> None:
    """EXP-05: the same costs and as many expansions, compiled or not."""
    passable = np.pad((np.random.default_rng(5).random((30, 40)) > 0.2).astype(np.uint8), 1)
    free, stride = passable.reshape(-1), passable.shape[1]
    free[[stride + 1, 29 * stride + 38]] = 1
    for kernel in (searching.a_star, searching.jump_points):
        plain = getattr(kernel, "py_func", kernel)
        found = [
            form(free, stride, stride + 1, 29 * stride + 38, 10**6) for form in (kernel, plain)
        ]
        assert (found[0][0] == found[1][0]).all()
        assert found[0][2] == found[1][2] > 20


def test_topological_ways_are_hardly_longer() -> None:
    """E-43: by at most a quarter, in rooms with doors; and jump points look at far fewer cells."""
    passable = office()
    topological = TopologicalMap.build(passable, passable == 0)
    random = np.random.default_rng(3)
    cells = np.argwhere(passable)[:, ::-1]
    for pair in random.integers(0, len(cells), (60, 2)):
        (c1, r1), (c2, r2) = cells[pair].tolist()
        shortest = jump_points(passable, (c1, r1), (c2, r2))
        found = topological.path(passable, (c1, r1), (c2, r2))
        assert found.path is not None
        assert found.length <= 1.25 * shortest.length
    corner, far = (2, 2), (197, 157)
    assert 10 * jump_points(passable, corner, far).expanded < (
        a_star(passable, corner, far).expanded
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(3, 40), st.integers(3, 40), st.floats(0.3, 1.0))
def test_thinning_keeps_what_hangs_together(
    seed: int, rows: int, columns: int, dense: float
) -> None:
    """E-45: inside free space, connected as that is, and nothing can be peeled off any more."""
    free = (np.random.default_rng(seed).random((rows, columns)) < dense).astype(np.uint8)
    bones = thin(free)
    assert not (bones & ~free).any()
    labels, of_cell = cv2.connectedComponents(free, connectivity=8)
    assert cv2.connectedComponents(bones, connectivity=8)[0] == labels
    assert set(of_cell[bones != 0].tolist()) == set(range(1, labels))
    assert (thin(bones) == bones).all()


def test_a_skeleton_is_one_cell_wide() -> None:
    """E-45: in rooms; a wide hall has a ring, and a corridor two ends."""
    bones = skeleton(office())
    assert not (bones[1:, 1:] & bones[1:, :-1] & bones[:-1, 1:] & bones[:-1, :-1]).any()
    hall = np.zeros((170, 170), np.uint8)
    hall[5:-5, 5:-5] = 1
    assert (degrees(skeleton(hall))[skeleton(hall) != 0] >= 2).any()
    assert not skeleton(hall)[60:110, 60:110].any()
    assert thin(hall)[60:110, 60:110].any()
    corridor = np.zeros((9, 60), np.uint8)
    corridor[2:7, 3:57] = 1
    assert np.count_nonzero(degrees(skeleton(corridor)) == 1) == 2


def test_key_cells_keep_apart() -> None:
    """E-46: 20 cells from each other, 3 from walls, and the skeleton is never far from one."""
    passable = office()
    bones, walls = skeleton(passable), passable == 0
    nodes = key_cells(bones, walls)
    assert len(nodes) > 10
    away = np.hypot(*(nodes[:, None] - nodes[None]).transpose(2, 0, 1))
    assert away[~np.eye(len(nodes), dtype=bool)].min() >= 20.0
    room = cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    assert room[nodes[:, 1], nodes[:, 0]].min() >= 3.0
    cells = np.argwhere(bones)[:, ::-1]
    nearest = np.hypot(*(cells[:, None] - nodes[None]).transpose(2, 0, 1)).min(axis=1)
    assert nearest.max() < 40.0 + 20.0  # spacing, and what may have been dropped beside


def test_areas_part_the_free_space() -> None:
    """E-47: every cell that a node reaches is of one area; areas that touch share an edge."""
    passable = office()
    passable[:38, 163:] = 0
    passable[10:14, 180:184] = 1  # shut in, without a node
    topological = TopologicalMap.build(passable, passable == 0)
    areas = topological.areas
    reached = flood(passable, topological.nodes, 10**9, EVERYWHERE)[0] != FAR
    assert ((areas != NOWHERE) == reached).all()
    assert not reached[10:14, 180:184].any()
    for number, (column, row) in enumerate(topological.nodes.tolist()):
        assert areas[row, column] == number
        whole, _ = cv2.connectedComponents((areas == number).astype(np.uint8), connectivity=8)
        assert whole == 2  # nothing else, and this one
    touching = {
        (min(one, other), max(one, other))
        for a, b in ((areas[:, :-1], areas[:, 1:]), (areas[:-1], areas[1:]))
        for one, other in zip(a.ravel().tolist(), b.ravel().tolist(), strict=True)
        if NOWHERE not in (one, other) and one != other
    }
    assert set(map(tuple, topological.edges.tolist())) == touching
    for (one, other), away in zip(topological.edges, topological.lengths, strict=True):
        (c1, r1), (c2, r2) = topological.nodes[[one, other]].tolist()
        assert away >= jump_points(passable, (c1, r1), (c2, r2)).length


def test_a_limit_is_told() -> None:
    """E-48: by a search, by a flood, and by the planner, which counts."""
    passable = np.ones((40, 40), np.uint8)
    passable[3:37, 20] = 0
    for search in (a_star, jump_points):
        assert not search(passable, (2, 20), (38, 20)).cut
        found = search(passable, (2, 20), (38, 20), 3)
        assert found.cut
        assert found.path is None
        assert found.expanded == 3
    known = KnownMap((40, 40))
    known.bits[passable != 0] = FREE
    planner = Planner(known, limit=100)
    assert planner.field((2, 20)).cut
    assert planner.path((2, 20), (38, 20)) is None
    assert planner.cuts == 1


def test_plans_are_of_ones_own_map() -> None:
    """E-49, E-44: who has not seen the door has no way, whatever others have found."""
    maps = [KnownMap((30, 60)) for _ in range(2)]
    for known in maps:
        known.bits[:] = FREE
        known.bits[:, 30] = WALL | SAFE
    maps[0].bits[14:17, 30] = FREE
    planners = [Planner(known) for known in maps]
    start, goal = (5, 5), (55, 5)
    for ask in (Planner.path, lambda one, a, b: one.search(a, b).path):
        path, none = (ask(planner, start, goal) for planner in planners)
        assert none is None
        assert path is not None
        assert holds(path, start, planners[0].passable)
    for planner, way in zip(planners, (True, False), strict=True):
        found = planner.topology(1).path(planner.passable, start, goal)
        assert (found.path is not None) is way


def test_floods_are_shared_by_equal_maps_only() -> None:
    """E-49: the second who asks for the same gets the same; one cell more, and it floods itself."""
    free, floods, start = office(), Floods(), (5, 5)
    near, far = np.array([(30, 20)]), np.array([(150, 130)])
    first, _ = floods.costs(free, start, 10**6, far)
    assert floods.costs(free.copy(), start, 10**6, near)[0] is first
    whole, _ = floods.costs(free.copy(), start, 10**6, EVERYWHERE)
    assert whole is not first
    assert (whole == flood(free, np.array([start]), 10**6, EVERYWHERE)[0]).all()
    assert floods.costs(free, start, 10**6, far)[0] is whole
    other = free.copy()
    other[20, 30] = 0
    costs, _ = floods.costs(other, start, 10**6, near)
    assert costs[20, 30] == FAR != whole[20, 30]
    assert floods.costs(free, start, 100, near)[1], "few expansions are a limit as before"


def test_a_topological_map_is_made_anew() -> None:
    """Not before 15 steps, not without news, and after 150 steps in any case."""
    known = KnownMap((30, 60))
    planner = Planner(known)
    known.merge(1, np.arange(300, 900), np.full(600, FREE, np.uint8))
    first = planner.topology(1)
    known.merge(2, np.arange(900, 1300), np.full(400, FREE, np.uint8))
    assert planner.topology(15) is first
    second = planner.topology(16)
    assert second is not first
    assert planner.topology(165) is second
    assert planner.topology(166) is not second
