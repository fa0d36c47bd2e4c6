"""The board of cameras: who gets which tile, what a robot's tiles show, who is bound to what."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.cameras.board import MOST_CLIENTS, CameraBoard
from usarsim_server.cameras.view import CameraView, Grid, Region
from usarsim_server.simulation.frames import Pose

FOV = 1.3963


def add(board: CameraBoard, robot: int | None, name: str = "Camera") -> CameraView:
    """A camera of a robot, or of a spectator."""
    owner = "" if robot is None else f"robot{robot}"
    return board.add(name, owner, robot, None, Pose((0.1, 0.0, 0.4)), FOV)


def tiles(board: CameraBoard) -> list[int | None]:
    """The tiles of all views, in order."""
    return [view.tile for view in board.views]


def test_first_camera_lies_at_the_origin() -> None:
    """The first camera of all has offsets 0, 0 (side channels 36)."""
    board = CameraBoard(Grid())
    first = add(board, 1)
    assert first.tile == 0
    assert board.grid.region(0) == Region(0, 0, 320, 240)
    assert board.views == (first,)


@pytest.mark.parametrize(("columns", "rows"), [(4, 4), (3, 2), (2, 5), (1, 8)])
def test_offsets_follow_the_columns(columns: int, rows: int) -> None:
    """Camera i lies at ((i mod c) W, (i div c) H) in any grid, square or not (side channels 37)."""
    board = CameraBoard(Grid(columns, rows, 100, 50))
    for i in range(columns * rows):
        tile = add(board, i).tile
        assert tile is not None
        where = board.grid.region(tile)
        assert (where.x, where.y) == (i % columns * 100, i // columns * 50)


def test_each_camera_item_counts() -> None:
    """A robot with two cameras fills two tiles, the next robot gets the third
    (side channels 42)."""
    board = CameraBoard(Grid())
    add(board, 7, "CameraTop")
    add(board, 7, "CameraBottom")
    assert add(board, 8).tile == 2
    assert board.tiles(7) == (0, 1)


def test_surplus_cameras_have_no_tile() -> None:
    """With more cameras than tiles those that have one keep it, the others exist
    (side channels 43)."""
    board = CameraBoard(Grid(2, 1))
    for robot in range(3):
        add(board, robot)
    assert tiles(board) == [0, 1, None]


def test_a_new_camera_takes_the_lowest_free_tile() -> None:
    """After robots left, a newcomer fills the first gap; nobody else moves (side channels 44)."""
    board = CameraBoard(Grid())
    for robot in range(4):
        add(board, robot)
    board.remove_robot(2)
    board.remove_robot(0)
    assert tiles(board) == [1, 3]
    assert add(board, 9).tile == 0
    assert add(board, 10).tile == 2
    assert add(board, 11).tile == 4


def test_keys_are_never_used_again() -> None:
    """A renderer may remember a camera by its key."""
    board = CameraBoard(Grid())
    old = add(board, 1)
    board.remove_robot(1)
    assert add(board, 1).key != old.key
    assert board.get(old.key) is None


def test_field_of_view_changes_in_a_new_value() -> None:
    """Views once taken stay as they were; the next ones show the change."""
    board = CameraBoard(Grid())
    camera = add(board, 1)
    before = board.views
    board.set_fov(camera.key, 0.5)
    assert before[0].fov == FOV
    assert board.views == (replace(camera, fov=0.5),)
    board.set_fov(12345, 0.5)
    assert len(board.views) == 1


def test_find_takes_names_in_any_case() -> None:
    """Cameras are found by label of the robot and item name; spectators have no owner."""
    board = CameraBoard(Grid())
    mine, free = add(board, 1), add(board, None, "Bird")
    assert board.find("camera", "ROBOT1") == mine
    assert board.find(" Bird ") == free
    assert board.find("Camera", "robot2") is None


def test_spectator_leaves_its_tile() -> None:
    """A spectator's tile is free once it is gone."""
    board = CameraBoard(Grid())
    bird = add(board, None, "Bird")
    board.remove(bird.key)
    board.remove(bird.key)
    assert board.views == ()
    assert add(board, 1).tile == 0


def test_viewports_exchange_what_the_tiles_of_a_robot_show() -> None:
    """A robot's tiles stay its own whatever they show; black ones are not given away."""
    board = CameraBoard(Grid())
    top, bottom = add(board, 1, "Top"), add(board, 1, "Bottom")
    other = add(board, 2)
    board.show(1, [bottom.key])
    assert {view.name: view.tile for view in board.views} == {
        "Top": None,
        "Bottom": 0,
        "Camera": 2,
    }
    assert board.tiles(1) == (0, 1)
    assert add(board, 3).tile == 3
    board.show(1, [top.key, other.key])
    assert board.views[:2] == (replace(top, tile=0), replace(bottom, tile=None))
    board.remove_robot(1)
    assert add(board, 4).tile == 0


def test_one_camera_can_fill_two_tiles() -> None:
    """The second picture has a key of its own, which stays while it is shown."""
    board = CameraBoard(Grid())
    top, bottom = add(board, 1, "Top"), add(board, 1, "Bottom")
    board.show(1, [bottom.key, bottom.key])
    shown = [view for view in board.views if view.tile is not None]
    assert [(view.name, view.tile) for view in shown] == [("Bottom", 0), ("Bottom", 1)]
    assert len({view.key for view in board.views}) == 3
    board.set_fov(bottom.key, 0.4)
    assert [view.key for view in board.views if view.tile is not None] == [v.key for v in shown]
    assert {view.fov for view in board.views if view.tile is not None} == {0.4}
    board.show(1, [top.key, bottom.key])
    assert len(board.views) == 2


def test_address_is_bound_to_a_tile() -> None:
    """A bound address gets the tile of its camera, wherever that goes, until it is gone."""
    board = CameraBoard(Grid())
    top, bottom = add(board, 1, "Top"), add(board, 1, "Bottom")
    assert board.bound("10.0.0.7") is None
    board.bind("10.0.0.7", bottom.key)
    assert board.bound("10.0.0.7") == board.grid.region(1)
    assert board.bound("10.0.0.8") is None
    board.show(1, [bottom.key, top.key])
    assert board.bound("10.0.0.7") == board.grid.region(0)
    board.bind("10.0.0.7", None)
    assert board.bound("10.0.0.7") is None
    board.bind("10.0.0.7", top.key)
    board.remove_robot(1)
    assert board.bound("10.0.0.7") is None


def test_addresses_do_not_pile_up() -> None:
    """A client that names ever new addresses takes the oldest bindings away, no memory."""
    board = CameraBoard(Grid())
    camera = add(board, 1)
    for number in range(MOST_CLIENTS + 5):
        board.bind(str(number), camera.key)
    assert board.bound("4") is None
    assert board.bound("5") == board.grid.region(0)


def test_grid_of_64_is_the_largest() -> None:
    """The original had room for 64 tiles; none at all makes no sense."""
    assert CameraBoard(Grid(8, 8)).grid.tiles == 64
    for grid in (Grid(9, 8), Grid(0, 4)):
        with pytest.raises(ValueError, match="from 1 to 64"):
            CameraBoard(grid)


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("add"), st.integers(0, 4)),
            st.tuples(st.just("leave"), st.integers(0, 4)),
            st.tuples(st.just("show"), st.integers(0, 4)),
        ),
        max_size=40,
    )
)
def test_no_two_views_share_a_tile(moves: list[tuple[str, int]]) -> None:
    """Whatever comes and goes, tiles and keys are unique and lie in the grid."""
    board = CameraBoard(Grid(3, 2))
    for move, robot in moves:
        mine = [view.key for view in board.views if view.robot == robot]
        if move == "add":
            add(board, robot)
        elif move == "leave":
            board.remove_robot(robot)
            assert board.tiles(robot) == ()
        else:
            board.show(robot, [*reversed(mine), None, *mine])
        shown = [view.tile for view in board.views if view.tile is not None]
        assert len(shown) == len(set(shown))
        assert set(shown) <= set(range(6))
        assert len({view.key for view in board.views}) == len(board.views)
        owned = [tile for one in range(5) for tile in board.tiles(one)]
        assert set(shown) <= set(owned)
        assert len(owned) == len(set(owned))


def test_many_threads_at_once() -> None:
    """Robots that come and go at the same time leave an empty board behind."""
    board = CameraBoard(Grid(8, 8))

    def visit(robot: int) -> None:
        for _ in range(20):
            camera = add(board, robot)
            board.set_fov(camera.key, 1.0)
            assert all(view.tile is not None for view in board.views)
            board.remove_robot(robot)

    threads = [threading.Thread(target=visit, args=(robot,)) for robot in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(90.0)
    assert board.views == ()
