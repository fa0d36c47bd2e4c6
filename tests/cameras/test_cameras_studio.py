"""The studio: who is rendered, when, and what watchers get; by rays, on a clock of the test."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from camera_fakes import FakeWorld, Yard, camera, cart, is_red, standing

from usarsim_server.cameras import painter as painting
from usarsim_server.cameras import studio as studios
from usarsim_server.cameras.backend import Wanted
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.raytraced import RayBackend
from usarsim_server.cameras.studio import Studio, StudioOptions
from usarsim_server.cameras.view import CameraView, Eye, Frame, Grid, Region, View, looking
from usarsim_server.cameras.watching import EMPTY
from usarsim_server.errors import UsarsimError
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.testing import PATIENCE, eventually

GRID = Grid(2, 2, 32, 24)
MOMENT = 0.15
"""s of wall time in which nothing may happen."""


class Board:
    """Cameras that a test puts there."""

    grid = GRID

    def __init__(self) -> None:
        self.views: tuple[CameraView, ...] = ()


class Set:
    """A yard with three carts, their cameras on the first three tiles, and a studio."""

    def __init__(self) -> None:
        self.yard = Yard()
        # One sees the red box, one looks away from it, one sees it from the side.
        places = ((0.0, 0.0, 0.0), (-3.0, -4.0, 3.1), (3.0, -4.0, 1.3))
        self.robots = [self.yard.park(*place) for place in places]
        self.world = FakeWorld(self.yard)
        self.board = Board()
        self.board.views = tuple(
            camera(robot, tile, key=tile + 1) for tile, robot in enumerate(self.robots)
        )
        self.studio = self.make()

    def make(self, **options: object) -> Studio:
        """A studio over the same yard."""
        painter = PainterOptions(renderer="rays")
        return Studio(
            self.world,
            self.board,  # type: ignore[arg-type]
            StudioOptions(painter=painter, **options),  # type: ignore[arg-type]
        )


@pytest.fixture
def stage() -> Iterator[Set]:
    """A set that is cleared away at the end."""
    one = Set()
    yield one
    one.studio.close()


class Watcher:
    """Takes frames."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self._news = threading.Condition()

    def __call__(self, frame: Frame) -> None:
        with self._news:
            self.frames.append(frame)
            self._news.notify_all()

    def wait(self, count: int = 1) -> Frame:
        """The newest frame, once there are so many."""
        with self._news:
            assert self._news.wait_for(lambda: len(self.frames) >= count, PATIENCE), "no frame came"
            return self.frames[-1]


def until(condition: Callable[[], bool]) -> None:
    """Wait for something that another thread does."""
    assert eventually(condition)


def part(frame: Frame, tile: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A tile of a frame."""
    region = GRID.region(tile)
    return frame.pixels[region.y :, region.x :][: region.height, : region.width]


def empty(frame: Frame, tile: int) -> bool:
    """Whether a tile is plain."""
    return bool((part(frame, tile) == EMPTY).all())


class TestWatching:
    """What is watched is rendered, nothing else is."""

    def test_nobody_watches_nothing_is_rendered(self, stage: Set) -> None:
        """Without a watcher there is no frame for a camera, no thread and no work."""
        assert stage.studio.newest(GRID.region(0)) is None
        time.sleep(MOMENT)
        assert stage.studio.pictures == 0
        assert stage.world.looks == 0

    def test_a_watched_tile_is_rendered_and_no_other(self, stage: Set) -> None:
        """One tile of a watched region is painted; the others stay black."""
        watcher = Watcher()
        stage.studio.watch(GRID.region(0), watcher)
        frame = watcher.wait()
        assert is_red(part(frame, 0)).any()
        assert all(empty(frame, tile) for tile in (1, 2, 3))
        assert stage.studio.newest(GRID.region(0)) is frame
        assert stage.studio.newest(GRID.region(1)) is None
        assert stage.studio.newest(GRID.frame) is None
        assert stage.studio.pictures == 1

    def test_every_camera_is_in_its_own_tile(self, stage: Set) -> None:
        """What a robot sees is in its tile and nowhere else (check 21)."""
        watcher = Watcher()
        stage.studio.watch(GRID.frame, watcher)
        frame = watcher.wait()
        assert [bool(is_red(part(frame, tile)).any()) for tile in range(4)] == [
            True,
            False,
            True,
            False,
        ]
        assert [empty(frame, tile) for tile in range(4)] == [False, False, False, True]

    def test_two_watchers_of_different_tiles(self, stage: Set) -> None:
        """Each is told of frames with its own tile; a region over both is up to date, too."""
        one, other = Watcher(), Watcher()
        stage.studio.watch(GRID.region(0), one)
        one.wait()
        stage.studio.watch(GRID.region(1), other)
        frame = other.wait()
        assert not empty(frame, 0)
        assert not empty(frame, 1)
        assert len(one.frames) == 1  # nothing was new in its tile
        both = Region(0, 0, 2 * GRID.tile_width, GRID.tile_height)
        assert stage.studio.newest(both) is not None

    def test_who_looks_away_leaves_nothing_behind(self, stage: Set) -> None:
        """After the last watcher has gone a tile is out of date and is not rendered any more."""
        watcher, second = Watcher(), Watcher()
        watches = [stage.studio.watch(GRID.region(0), one) for one in (watcher, second)]
        second.wait()
        watches[0].close()
        assert stage.studio.newest(GRID.region(0)) is not None
        watches[1].close()
        watches[1].close()
        assert stage.studio.newest(GRID.region(0)) is None
        done = stage.studio.pictures
        stage.world.set_time(5.0)
        time.sleep(MOMENT)
        assert stage.studio.pictures == done

    def test_a_watch_can_turn_elsewhere(self, stage: Set) -> None:
        """`look_at` renders the new region and forgets the old one."""
        watcher = Watcher()
        watch = stage.studio.watch(GRID.region(0), watcher)
        watcher.wait()
        watch.look_at(GRID.region(2))
        until(lambda: stage.studio.newest(GRID.region(2)) is not None)
        assert stage.studio.newest(GRID.region(0)) is None

    def test_a_late_watcher_is_told_at_once(self, stage: Set) -> None:
        """Who begins to watch what is up to date need not wait for the next turn of the clock."""
        first, second = Watcher(), Watcher()
        stage.studio.watch(GRID.region(0), first)
        first.wait()
        stage.studio.watch(GRID.region(0), second)
        assert second.wait() is first.frames[-1]

    def test_regions_without_cameras_need_no_rendering(self, stage: Set) -> None:
        """A plain tile is up to date without anybody watching; also before any robot (check 1)."""
        frame = stage.studio.newest(GRID.region(3))
        assert frame is not None
        assert empty(frame, 3)
        stage.board.views = ()
        assert stage.studio.newest(GRID.frame) is frame
        assert stage.studio.pictures == 0

    def test_a_watcher_of_plain_tiles_is_told_too(self, stage: Set) -> None:
        """Watching a region without cameras gives a frame as well."""
        watcher = Watcher()
        stage.studio.watch(GRID.region(3), watcher)
        assert empty(watcher.wait(), 3)

    def test_always_render(self, stage: Set) -> None:
        """With the option all cameras are up to date though nobody watches."""
        studio = stage.make(always=True)
        studio.open()
        try:
            until(lambda: studio.newest(GRID.frame) is not None)
        finally:
            studio.close()

    def test_one_bad_watcher_harms_nobody(self, stage: Set) -> None:
        """An exception in one callback does not keep the others from their frames."""

        def bad(frame: Frame) -> None:
            raise RuntimeError("oops")

        good = Watcher()
        stage.studio.watch(GRID.region(0), bad)
        stage.studio.watch(GRID.region(0), good)
        good.wait()
        stage.world.set_time(1.0)
        good.wait(2)


class TestFrames:
    """Frames are values."""

    def test_a_frame_never_changes(self, stage: Set) -> None:
        """A frame that somebody keeps stays as it was, and cannot be written to."""
        watcher = Watcher()
        stage.studio.watch(GRID.region(0), watcher)
        frame = watcher.wait()
        before = frame.pixels.copy()
        stage.yard.turn(stage.robots[0], 0.0, 0.0, 2.0)
        stage.world.set_time(1.0)
        later = watcher.wait(2)
        assert np.array_equal(frame.pixels, before)
        assert (later.pixels != before).any()
        with pytest.raises(ValueError, match="read-only"):
            later.pixels[0, 0, 0] = 1

    def test_numbers_and_times_grow(self, stage: Set) -> None:
        """Every new frame has a higher number and the simulated time of its newest tile."""
        watcher = Watcher()
        stage.studio.watch(GRID.frame, watcher)
        watcher.wait()
        for step in range(1, 4):
            stage.world.set_time(float(step))
            until(lambda step=step: watcher.frames[-1].time == step)  # type: ignore[misc]
        numbers = [frame.number for frame in watcher.frames]
        assert numbers == sorted(set(numbers))

    def test_no_news_no_new_frame(self, stage: Set) -> None:
        """A region in which nothing was painted keeps its frame while others get new ones."""
        one, other = Watcher(), Watcher()
        stage.board.views = stage.board.views[:2]
        stage.studio.watch(GRID.region(2), one)
        stage.studio.watch(GRID.region(0), other)
        other.wait()
        kept = stage.studio.newest(GRID.region(2))
        stage.world.set_time(1.0)
        other.wait(2)
        assert stage.studio.newest(GRID.region(2)) is kept


class TestTurns:
    """When a camera is rendered."""

    @pytest.mark.parametrize("rate", [15.0, 4.0])
    def test_at_most_so_many_pictures_per_simulated_second(self, stage: Set, rate: float) -> None:
        """However finely the clock moves, a camera gets its rate and no more (2.6)."""
        stage.world.speed = math.inf  # the clock goes as it likes
        studio = stage.make(rate=rate)
        watcher = Watcher()
        try:
            studio.watch(GRID.region(0), watcher)
            watcher.wait()
            for step in range(1, 101):
                stage.world.set_time(0.01 * step)
                looks = stage.world.looks
                until(lambda looks=looks: stage.world.looks > looks + 1)  # type: ignore[misc]
        finally:
            studio.close()
        assert studio.pictures == pytest.approx(rate, abs=1.1)

    def test_standing_time_renders_nothing_new(self, stage: Set) -> None:
        """While simulated time stands still there is nothing to be seen; looks become rare."""
        watcher = Watcher()
        stage.studio.watch(GRID.frame, watcher)
        watcher.wait()
        done, looks = stage.studio.pictures, stage.world.looks
        began = time.monotonic()
        time.sleep(0.3)
        passed = time.monotonic() - began
        assert stage.studio.pictures == done == 3
        assert stage.world.looks - looks < 20 + 100.0 * passed

    def test_a_changed_camera_is_rendered_at_once(self, stage: Set) -> None:
        """A zoom shows without waiting for the camera's turn."""
        watcher = Watcher()
        stage.studio.watch(GRID.region(0), watcher)
        wide = is_red(part(watcher.wait(), 0)).sum()
        first, *others = stage.board.views
        stage.board.views = (camera(first.robot, 0, key=first.key, fov=0.5), *others)
        narrow = is_red(part(watcher.wait(2), 0)).sum()
        assert narrow > 2 * wide

    def test_a_stereo_pair_sees_one_instant(self, stage: Set) -> None:
        """Cameras of one robot are painted from the same snapshot, however slow rendering is."""
        times: list[tuple[int, float]] = []
        robot = stage.robots[0]
        stage.board.views = (
            camera(robot, 0, key=1),
            camera(stage.robots[1], 1, key=2),
            camera(robot, 2, key=3),
        )
        stop = threading.Event()

        def clock() -> None:
            step = 0
            while not stop.wait(0.002):
                step += 1
                stage.world.set_time(0.01 * step)

        original = stage.studio._atlas.paint

        def paint(tile: int, key: int, picture: object, now: float) -> None:
            times.append((tile, now))
            time.sleep(0.04)
            original(tile, key, picture, now)  # type: ignore[arg-type]

        stage.studio._atlas.paint = paint  # type: ignore[assignment,method-assign]
        ticking = threading.Thread(target=clock)
        ticking.start()
        try:
            stage.studio.watch(GRID.frame, Watcher())
            until(lambda: len(times) > 12)
        finally:
            stop.set()
            ticking.join()
        left = [now for tile, now in times if tile == 0]
        right = [now for tile, now in times if tile == 2]
        count = min(len(left), len(right))
        assert left[:count] == right[:count]
        assert {tile for tile, _ in times} == {0, 1, 2}  # and nobody starves


class TestComingsAndGoings:
    """Cameras appear and disappear."""

    def test_the_tile_of_a_camera_that_left_is_plain(self, stage: Set) -> None:
        """Nobody is shown a robot's picture after it has gone; the geometry stays (check 35)."""
        watcher = Watcher()
        stage.studio.watch(GRID.frame, watcher)
        watcher.wait()
        stage.board.views = stage.board.views[1:]
        assert stage.studio.newest(GRID.frame) is None
        until(lambda: stage.studio.newest(GRID.frame) is not None)
        frame = stage.studio.newest(GRID.frame)
        assert frame is not None
        assert empty(frame, 0)
        assert not empty(frame, 1)
        assert frame.pixels.shape == (GRID.height, GRID.width, 3)

    def test_a_stale_tile_is_never_handed_out(self, stage: Set) -> None:
        """A camera's old picture is not mistaken for that of the camera that follows it."""
        watcher = Watcher()
        watch = stage.studio.watch(GRID.region(0), watcher)
        watcher.wait()
        watch.close()
        stage.board.views = ()
        assert stage.studio.newest(GRID.region(0)) is None  # it still shows who was there
        stage.studio.watch(GRID.region(0), watcher)
        until(lambda: stage.studio.newest(GRID.region(0)) is not None)
        frame = stage.studio.newest(GRID.region(0))
        assert frame is not None
        assert empty(frame, 0)

    def test_a_new_camera_appears_for_those_who_watch(self, stage: Set) -> None:
        """Who watches the full frame sees a robot that comes while time stands still (check 36)."""
        later, stage.board.views = stage.board.views, ()
        watcher = Watcher()
        stage.studio.watch(GRID.frame, watcher)
        watcher.wait()
        stage.board.views = later
        until(lambda: stage.studio.newest(GRID.frame) is not None)
        assert is_red(part(watcher.frames[-1], 0)).any()

    def test_more_cameras_than_tiles(self, stage: Set) -> None:
        """A camera without a tile is left out; the others keep their pictures (check 43)."""
        surplus = tuple(camera(stage.robots[0], None, key=key) for key in (90, 91))
        stage.board.views = (*stage.board.views, *surplus)
        watcher = Watcher()
        stage.studio.watch(GRID.frame, watcher)
        assert is_red(part(watcher.wait(), 0)).any()
        assert stage.studio.pictures == 3

    def test_a_camera_whose_robot_is_gone_shows_nothing(self, stage: Set) -> None:
        """Between a robot's end and that of its camera the tile is plain, and requests are met."""
        stage.yard.simulation.remove(stage.robots[0])
        stage.yard.simulation.settle()
        stage.world.set_time(0.0)
        watcher = Watcher()
        stage.studio.watch(GRID.region(0), watcher)
        assert empty(watcher.wait(), 0)

    def test_a_class_that_is_new_to_the_world(self, stage: Set) -> None:
        """The model grows under a running studio; pictures go on and show the newcomer."""
        watcher = Watcher()
        stage.studio.watch(GRID.region(1), watcher)
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
        pictures: list[object] = []

        def shoot() -> None:
            pictures.append(stage.studio.picture(self.VIEW))

        threads = [threading.Thread(target=shoot) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE)
        assert len(pictures) == 4
        first = np.asarray(pictures[0])
        assert is_red(first).any()
        assert all(np.array_equal(first, picture) for picture in pictures)  # type: ignore[arg-type]

    def test_its_array_is_the_callers_own(self, stage: Set) -> None:
        """Later pictures do not change earlier ones."""
        one = stage.studio.picture(self.VIEW)
        kept = one.copy()
        stage.studio.picture(View(looking((0.0, 0.0, 3.0), (0.0, 5.0, 0.0)), 1.0, 48, 36))
        assert np.array_equal(one, kept)

    def test_after_the_end(self, stage: Set) -> None:
        """A closed studio refuses instead of letting somebody wait."""
        stage.studio.close()
        with pytest.raises(UsarsimError, match="ending"):
            stage.studio.picture(self.VIEW)
        stage.studio.watch(GRID.frame, Watcher()).close()

    def test_an_old_snapshot(self, stage: Set) -> None:
        """What was can be drawn while somebody has a snapshot of it; then the studio goes on."""
        old = stage.world.look()
        for number in range(6):
            stage.yard.park(-8.0 - number, -8.0, model=cart(f"kind{number}"))
        stage.world.set_time(1.0)
        assert is_red(stage.studio.picture_of(self.VIEW, old)).any()
        assert is_red(stage.studio.picture(self.VIEW)).any()


class TestIdle:
    """While nobody watches."""

    def test_former_models_are_let_go(self, stage: Set, monkeypatch: pytest.MonkeyPatch) -> None:
        """The studio is ready for the present model, and holds no other."""
        monkeypatch.setattr(studios, "IDLE_REFRESH", 0.02)
        painted: list[int] = []
        real = Painter.picture

        def picture(painter: Painter, view: View, snapshot: Snapshot) -> np.ndarray:
            painted.append(snapshot.generation)
            return real(painter, view, snapshot)

        monkeypatch.setattr(Painter, "picture", picture)
        view = View(looking((0.0, 0.0, 3.0), (0.0, 5.0, 0.0)), 1.0, 48, 36)
        stage.studio.picture(view)
        before = stage.world.look().generation
        stage.yard.park(-8.0, -8.0, model=cart("newcomer"))
        stage.world.set_time(1.0)
        assert eventually(lambda: painted[-1] == stage.world.look().generation > before)


class TestTrouble:
    """Failures are contained."""

    def test_the_end_of_the_physics_ends_rendering(self, stage: Set) -> None:
        """When the simulation has ended the thread ends too, and closing does not wait."""
        watcher = Watcher()
        stage.studio.watch(GRID.region(0), watcher)
        watcher.wait()
        stage.world.ended = True
        thread = stage.studio._thread
        assert thread is not None
        stage.studio.newest(GRID.region(1))
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
        watcher = Watcher()
        stage.studio.watch(GRID.region(0), watcher)
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
        watcher = Watcher()
        stage.studio.watch(GRID.frame, watcher)
        frame = watcher.wait()
        assert empty(frame, 0)
        assert not empty(frame, 1)

    def test_watching_from_many_threads(self, stage: Set) -> None:
        """Watchers that come and go at once leave nothing behind and break nothing."""

        def visit() -> None:
            for number in range(20):
                watch = stage.studio.watch(GRID.region(number % 4), Watcher())
                stage.studio.newest(GRID.region(number % 4))
                watch.close()

        threads = [threading.Thread(target=visit) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE)
        assert not stage.studio._watches.tiles
        watcher = Watcher()
        stage.studio.watch(GRID.frame, watcher)
        watcher.wait()


def test_carts_stand_where_they_are_put() -> None:
    """The fakes of this file keep what they promise."""
    yard = Yard()
    robot = yard.park(1.0, 2.0, 0.3)
    snapshot = yard.look()
    assert snapshot.xpos[snapshot.layouts[robot].base] == pytest.approx([1.0, 2.0, 0.1], abs=0.02)
    assert standing(1.0, 2.0).position == (1.0, 2.0, 0.1)
