"""The render loop when cameras come and go, when it is idle, and when something fails."""

from __future__ import annotations

import time

import numpy as np
import pytest
from camera_fakes import (
    GRID,
    Set,
    Watcher,
    Yard,
    at_once,
    camera,
    cart,
    empty,
    is_red,
    part,
    standing,
    until,
)

from usarsim_server.base.errors import UsarsimError
from usarsim_server.cameras import painter as painting
from usarsim_server.cameras import render_loop as render_loops
from usarsim_server.cameras.backend import Wanted
from usarsim_server.cameras.painter import Painter
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.raytraced import RayBackend
from usarsim_server.cameras.view import Eye, View, looking
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.testing import PATIENCE, eventually


class TestComingsAndGoings:
    """Cameras appear and disappear."""

    def test_the_tile_of_a_camera_that_left_is_plain(self, stage: Set) -> None:
        """Nobody is shown a robot's picture after it has gone; the geometry stays
        (side channels 35)."""
        watcher = stage.watch(GRID.frame)
        watcher.wait()
        stage.board.views = stage.board.views[1:]
        assert stage.render_loop.newest(GRID.frame) is None
        until(lambda: stage.render_loop.newest(GRID.frame) is not None)
        frame = stage.render_loop.newest(GRID.frame)
        assert frame is not None
        assert empty(frame, 0)
        assert not empty(frame, 1)
        assert frame.pixels.shape == (GRID.height, GRID.width, 3)

    def test_a_stale_tile_is_never_handed_out(self, stage: Set) -> None:
        """A camera's old picture is not mistaken for that of the camera that follows it."""
        watcher = stage.watch(GRID.region(0))
        watcher.wait()
        watcher.watch.close()
        stage.board.views = ()
        assert stage.render_loop.newest(GRID.region(0)) is None  # it still shows who was there
        stage.render_loop.watch(GRID.region(0), watcher)
        until(lambda: stage.render_loop.newest(GRID.region(0)) is not None)
        frame = stage.render_loop.newest(GRID.region(0))
        assert frame is not None
        assert empty(frame, 0)

    def test_a_new_camera_appears_for_those_who_watch(self, stage: Set) -> None:
        """Who watches the full frame sees a robot that comes while time stands still
        (side channels 36)."""
        later, stage.board.views = stage.board.views, ()
        watcher = stage.watch(GRID.frame)
        watcher.wait()
        stage.board.views = later
        until(lambda: stage.render_loop.newest(GRID.frame) is not None)
        assert is_red(part(watcher.frames[-1], 0)).any()

    def test_more_cameras_than_tiles(self, stage: Set) -> None:
        """A camera without a tile is left out; the others keep their pictures
        (side channels 43)."""
        surplus = tuple(camera(stage.robots[0], None, key=key) for key in (90, 91))
        stage.board.views = (*stage.board.views, *surplus)
        watcher = stage.watch(GRID.frame)
        assert is_red(part(watcher.wait(), 0)).any()
        assert stage.render_loop.pictures == 3

    def test_a_camera_whose_robot_is_gone_shows_nothing(self, stage: Set) -> None:
        """Between a robot's end and that of its camera the tile is plain, and requests are met."""
        stage.yard.simulation.remove(stage.robots[0])
        stage.yard.simulation.settle()
        stage.world.set_time(0.0)
        watcher = stage.watch(GRID.region(0))
        assert empty(watcher.wait(), 0)

    def test_a_class_that_is_new_to_the_world(self, stage: Set) -> None:
        """The model grows under a running studio; pictures go on and show the newcomer."""
        watcher = stage.watch(GRID.region(1))
        before = part(watcher.wait(), 1).copy()
        stage.yard.park(-5.0, -4.0, model=cart("pink", (0.9, 0.2, 0.9)))
        stage.world.set_time(1.0)
        after = part(watcher.wait(2), 1)
        assert (after != before).any()


class TestSinglePictures:
    """Pictures from anywhere, for anybody."""

    VIEW = View(looking((0.0, 0.0, 0.6), (4.0, 0.0, 0.5)), 1.0, 48, 36)

    def test_from_any_thread(self, stage: Set) -> None:
        """Several threads get the same picture of the same moment."""
        pictures: list[np.ndarray] = []
        at_once(lambda: pictures.append(stage.render_loop.picture(self.VIEW)))
        assert len(pictures) == 4
        assert is_red(pictures[0]).any()
        assert all(np.array_equal(pictures[0], picture) for picture in pictures)

    def test_its_array_is_the_callers_own(self, stage: Set) -> None:
        """Later pictures do not change earlier ones."""
        one = stage.render_loop.picture(self.VIEW)
        kept = one.copy()
        stage.render_loop.picture(View(looking((0.0, 0.0, 3.0), (0.0, 5.0, 0.0)), 1.0, 48, 36))
        assert np.array_equal(one, kept)

    def test_after_the_end(self, stage: Set) -> None:
        """A closed studio refuses instead of letting somebody wait."""
        stage.render_loop.close()
        with pytest.raises(UsarsimError, match="ending"):
            stage.render_loop.picture(self.VIEW)
        stage.render_loop.watch(GRID.frame, Watcher()).close()

    def test_an_old_snapshot(self, stage: Set) -> None:
        """What was can be drawn while somebody has a snapshot of it; then the loop goes on."""
        old = stage.world.look()
        for number in range(6):
            stage.yard.park(-8.0 - number, -8.0, model=cart(f"kind{number}"))
        stage.world.set_time(1.0)
        assert is_red(stage.render_loop.picture_of(self.VIEW, old)).any()
        assert is_red(stage.render_loop.picture(self.VIEW)).any()


class TestIdle:
    """While nobody watches."""

    def test_former_models_are_let_go(self, stage: Set, monkeypatch: pytest.MonkeyPatch) -> None:
        """The render loop is ready for the present model, and holds no other."""
        monkeypatch.setattr(render_loops, "IDLE_REFRESH", 0.02)
        painted: list[int] = []
        real = Painter.picture

        def picture(painter: Painter, view: View, snapshot: Snapshot) -> np.ndarray:
            painted.append(snapshot.generation)
            return real(painter, view, snapshot)

        monkeypatch.setattr(Painter, "picture", picture)
        view = View(looking((0.0, 0.0, 3.0), (0.0, 5.0, 0.0)), 1.0, 48, 36)
        stage.render_loop.picture(view)
        before = stage.world.look().generation
        stage.yard.park(-8.0, -8.0, model=cart("newcomer"))
        stage.world.set_time(1.0)
        assert eventually(lambda: painted[-1] == stage.world.look().generation > before)

    def test_the_renderer_is_closed_and_opened_again(
        self, stage: Set, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Memory and threads of OpenGL go back; pictures and frames come as before."""
        monkeypatch.setattr(render_loops, "IDLE_CLOSE", 0.05)
        closed: list[Painter] = []
        real = Painter.close

        def close(painter: Painter) -> None:
            real(painter)
            closed.append(painter)

        monkeypatch.setattr(Painter, "close", close)
        view = View(looking((0.0, 0.0, 0.6), (4.0, 0.0, 0.5)), 1.0, 48, 36)
        before = stage.render_loop.picture(view)
        assert eventually(lambda: len(closed) == 1)
        assert np.array_equal(stage.render_loop.picture(view), before)
        assert eventually(lambda: len(closed) == 2)
        watcher = stage.watch(GRID.region(0))
        watcher.wait()
        time.sleep(0.3)
        assert len(closed) == 2
        assert watcher.watch is not None
        watcher.watch.close()
        assert eventually(lambda: len(closed) == 3)


class TestTrouble:
    """Failures are contained."""

    def test_the_end_of_the_physics_ends_rendering(self, stage: Set) -> None:
        """When the simulation has ended the thread ends too, and closing does not wait."""
        watcher = stage.watch(GRID.region(0))
        watcher.wait()
        stage.world.ended = True
        thread = stage.render_loop._thread
        assert thread is not None
        stage.render_loop.newest(GRID.region(1))
        stage.world.set_time(1.0)
        thread.join(PATIENCE)
        assert not thread.is_alive()

    def test_a_backend_that_breaks_is_replaced(
        self, stage: Set, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """If OpenGL gives up in the middle, rays take over and the picture is made."""

        class Broken:
            name = "egl"
            closed = False

            def render(self, stage: Stage, eye: Eye, wanted: Wanted) -> object:
                raise RuntimeError("the driver is gone")

            def close(self) -> None:
                Broken.closed = True

        monkeypatch.setattr(painting, "_open", lambda options: Broken())
        watcher = stage.watch(GRID.region(0))
        assert is_red(part(watcher.wait(), 0)).any()
        assert Broken.closed

    def test_a_picture_that_cannot_be_made_leaves_its_tile_plain(
        self, stage: Set, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """If even rays fail for one eye its tile is plain; the other cameras are not harmed."""
        render = RayBackend.render
        pose = stage.yard.look().layouts[stage.robots[0]].base

        def sometimes(self: RayBackend, one: Stage, eye: Eye, wanted: Wanted) -> object:
            if abs(eye.pose.position[1] - one.data.xpos[pose, 1]) < 0.01:
                raise ZeroDivisionError
            return render(self, one, eye, wanted)

        monkeypatch.setattr(RayBackend, "render", sometimes)
        watcher = stage.watch(GRID.frame)
        frame = watcher.wait()
        assert empty(frame, 0)
        assert not empty(frame, 1)

    def test_watching_from_many_threads(self, stage: Set) -> None:
        """Watchers that come and go at once leave nothing behind and break nothing."""

        def visit() -> None:
            for number in range(20):
                watch = stage.render_loop.watch(GRID.region(number % 4), Watcher())
                stage.render_loop.newest(GRID.region(number % 4))
                watch.close()

        at_once(visit)
        assert not stage.render_loop._watches.tiles
        watcher = stage.watch(GRID.frame)
        watcher.wait()


def test_carts_stand_where_they_are_put() -> None:
    """The fakes of this file keep what they promise."""
    yard = Yard()
    robot = yard.park(1.0, 2.0, 0.3)
    snapshot = yard.look()
    assert snapshot.xpos[snapshot.layouts[robot].base] == pytest.approx([1.0, 2.0, 0.1], abs=0.02)
    assert standing(1.0, 2.0).position == (1.0, 2.0, 0.1)
