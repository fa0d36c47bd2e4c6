"""Where robots get on the floor of a world, and what is a wall."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from world_files import HEAD, START, write_world

from usarsim_exploration.floor import Ground, Reached, Size
from usarsim_server.worlds.loader import load_world

BOUNDS = "[bounds]\nlower = [-5, -5, -1]\nupper = [5, 5, 5]\n"
TWO_ROOMS = """<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <geom type="box" pos="1 -3 0.5" size="0.01 2 0.5"/>
    <geom type="box" pos="1 3 0.5" size="0.01 {north} 0.5"/>
    <geom type="box" pos="-3 3 0.04" size="0.5 0.5 0.04"/>
    <geom type="box" pos="-3 -3 0.1" size="0.5 0.5 0.1"/>
    <geom type="box" pos="0 -3 0.9" size="0.5 0.5 0.1"/>
    <geom type="box" pos="-2 0 0.25" size="0.5 0.5 0.05"/>
    <body name="crate" pos="0 0 0.2"><freejoint/><geom type="box" size="0.2 0.2 0.2"/></body>
  </worldbody>
</mujoco>
"""
SIZE = Size(0.25, 0.5, 0.1)


def ground(directory: Path, north: float = 2.0) -> Ground:
    """Two rooms with a thin wall between, whose door is 2 m wide, or narrower with more wall."""
    scene = TWO_ROOMS.format(north=north)
    return Ground(load_world(write_world(directory, HEAD + START + BOUNDS, scene)))


def gets(reached: Reached, x: float, y: float) -> bool:
    """Whether robots get to a place."""
    row, column = (math.floor((p - q) / reached.cell) for p, q in ((y, reached.y), (x, reached.x)))
    return bool(np.isfinite(reached.way[row, column]))


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> tuple[Ground, Reached]:
    """Both rooms, and what a robot gets to from the western one."""
    found = ground(tmp_path_factory.mktemp("rooms"))
    return found, found.reach([(-4.0, 0.0, 0.25)], SIZE)


def test_through_the_door_and_over_the_kerb(rooms: tuple[Ground, Reached]) -> None:
    """Low steps are driven on, high ones are walls; a loose crate is in nobody's way; under a
    slab one needs room for the height."""
    _, reached = rooms
    assert reached.stuck == ()
    assert gets(reached, 4.0, 0.0)
    assert gets(reached, -3.0, 3.0)
    assert not gets(reached, -3.0, -3.0)
    assert gets(reached, 0.0, 0.0)
    assert gets(reached, 0.0, -3.0)
    assert not gets(reached, -2.0, 0.0)


def test_half_a_robot_away_from_walls(rooms: tuple[Ground, Reached]) -> None:
    """A wall of 2 cm, thinner than a cell, holds robots off on both sides."""
    _, reached = rooms
    for side in (-1.0, 1.0):
        assert not gets(reached, 1.0 + side * 0.15, -3.0)
        assert gets(reached, 1.0 + side * 0.45, -3.0)


def test_the_way_round(rooms: tuple[Ground, Reached]) -> None:
    """From (-4, 0) past the end of the wall at (1, -1) to (2, -4): 5.1 m and 3.4 m."""
    _, reached = rooms
    assert reached.way_to((2.0, -4.0), 0.1) == pytest.approx(8.5, abs=0.5)
    assert reached.way_to((-4.0, 0.0), 0.3) == 0.0
    assert reached.way_to((20.0, 0.0), 1.0) == math.inf
    assert len(reached.near((2.0, -4.0), 0.5)) > 40


def test_a_narrow_door_shuts_the_room(tmp_path: Path) -> None:
    """0.4 m are too little for a robot of 0.5 m, and enough for one of 0.2 m."""
    shut = ground(tmp_path, north=3.6)
    wide, narrow = (shut.reach([(-4.0, 0.0, 0.25)], Size(half)) for half in (0.25, 0.1))
    assert not gets(wide, 4.0, 0.0)
    assert gets(narrow, 4.0, 0.0)


def test_walls_are_what_a_laser_sees(rooms: tuple[Ground, Reached]) -> None:
    """The thin wall is one, the kerb and the slab above are none."""
    _, reached = rooms

    def wall(x: float, y: float) -> bool:
        row, column = (
            math.floor((p - q) / reached.cell) for p, q in ((y, reached.y), (x, reached.x))
        )
        return bool(reached.walls[row - 1 : row + 2, column - 1 : column + 2].any())

    assert all(wall(1.0, y) for y in (-4.5, -3.0, -1.2, 1.2, 4.5))
    assert not any(wall(x, y) for x, y in ((1.0, 0.0), (-3.0, 3.0), (0.0, -3.0), (-3.0, -2.5)))
    assert wall(-2.0, 0.5)


def test_a_wall_that_begins_at_the_bounds(tmp_path: Path) -> None:
    """Bounds are often the insides of outer walls: a map of these is no error."""
    outer = '<geom type="box" pos="5.1 0 0.5" size="0.1 5 0.5"/>'
    scene = TWO_ROOMS.format(north=2.0).replace("</worldbody>", outer + "</worldbody>")
    found = Ground(load_world(write_world(tmp_path, HEAD + START + BOUNDS, scene)))
    reached = found.reach([(-4.0, 0.0, 0.25)], SIZE)
    column = math.floor((5.05 - reached.x) / reached.cell)
    assert reached.walls[:, column].sum() > 90
    assert not reached.walls[:, :1].any()  # nothing stands at the other bound
    assert not gets(reached, 5.05, 0.0)


def test_starts_without_room(rooms: tuple[Ground, Reached]) -> None:
    """In a wall, and far above the floor."""
    found, _ = rooms
    starts = [(-4.0, 0.0, 0.25), (1.0, -3.0, 0.25), (3.0, 0.0, 4.0)]
    assert found.reach(starts, SIZE).stuck == (1, 2)


def test_inside(rooms: tuple[Ground, Reached]) -> None:
    """Within the block, below the floor; not above or beside it."""
    found, _ = rooms
    places = np.array([[-3, -3, 0.1], [0, 3, -0.1], [-3, -3, 0.3], [-2, 0, 0.25], [-2, 0, 0.1]])
    assert found.inside(places).tolist() == [True, True, False, True, False]


def test_shipped_worlds_are_driven_everywhere() -> None:
    """A robot of 0.4 m gets from the lobby of the office to within 2 m of each of its victims."""
    from usarsim_server.worlds.loader import find_world

    world = load_world(find_world("office"))
    reached = Ground(world).reach([world.starts[0].pose.position], Size(0.2))
    ways = [reached.way_to(victim.pose.position, 2.0) for victim in world.victims]
    assert max(ways) < 40.0
