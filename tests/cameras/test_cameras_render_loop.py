"""The render loop: who is rendered, when, what watchers get; by rays, on a clock of the test."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
import pytest
from camera_fakes import (
    GRID,
    MOMENT,
    Set,
    Watcher,
    camera,
    empty,
    is_red,
    part,
    until,
)

from usarsim_server.cameras.view import Frame, Region


class TestWatching:
    """What is watched is rendered, nothing else is."""

    def test_nobody_watches_nothing_is_rendered(self, stage: Set) -> None:
        """Without a watcher there is no frame for a camera, no thread, no renderer and no work."""
        stage.render_loop.open()
        assert stage.render_loop.newest(GRID.region(0)) is None
        time.sleep(MOMENT)
        assert stage.render_loop.pictures == 0
        assert stage.world.looks == 0
        assert stage.render_loop._thread is None

    def test_a_watched_tile_is_rendered_and_no_other(self, stage: Set) -> None:
        """One tile of a watched region is painted; the others stay black."""
        watcher = stage.watch(GRID.region(0))
        frame = watcher.wait()
        assert is_red(part(frame, 0)).any()
        assert all(empty(frame, tile) for tile in (1, 2, 3))
        assert stage.render_loop.newest(GRID.region(0)) is frame
        assert stage.render_loop.newest(GRID.region(1)) is None
        assert stage.render_loop.newest(GRID.frame) is None
        assert stage.render_loop.pictures == 1

    def test_every_camera_is_in_its_own_tile(self, stage: Set) -> None:
        """What a robot sees is in its tile and nowhere else (side channels 21)."""
        watcher = stage.watch(GRID.frame)
        frame = watcher.wait()
        assert [tile for tile in range(4) if is_red(part(frame, tile)).any()] == [0, 2]
        assert [tile for tile in range(4) if empty(frame, tile)] == [3]

    def test_two_watchers_of_different_tiles(self, stage: Set) -> None:
        """Each is told of frames with its own tile; a region over both is up to date, too."""
        one = stage.watch(GRID.region(0))
        one.wait()
        other = stage.watch(GRID.region(1))
        frame = other.wait()
        assert not empty(frame, 0)
        assert not empty(frame, 1)
        assert len(one.frames) == 1  # nothing was new in its tile
        both = Region(0, 0, 2 * GRID.tile_width, GRID.tile_height)
        assert stage.render_loop.newest(both) is not None

    def test_who_looks_away_leaves_nothing_behind(self, stage: Set) -> None:
        """After the last watcher has gone a tile is out of date and is not rendered any more."""
        watchers = [stage.watch(GRID.region(0)) for _ in range(2)]
        watchers[1].wait()
        watchers[0].watch.close()
        assert stage.render_loop.newest(GRID.region(0)) is not None
        watchers[1].watch.close()
        watchers[1].watch.close()
        assert stage.render_loop.newest(GRID.region(0)) is None
        done = stage.render_loop.pictures
        stage.world.set_time(5.0)
        time.sleep(MOMENT)
        assert stage.render_loop.pictures == done

    def test_a_watch_can_turn_elsewhere(self, stage: Set) -> None:
        """`look_at` renders the new region and forgets the old one."""
        watcher = stage.watch(GRID.region(0))
        watcher.wait()
        watcher.watch.look_at(GRID.region(2))
        until(lambda: stage.render_loop.newest(GRID.region(2)) is not None)
        assert stage.render_loop.newest(GRID.region(0)) is None

    def test_a_late_watcher_is_told_at_once(self, stage: Set) -> None:
        """Who begins to watch what is up to date need not wait for the next turn of the clock."""
        first = stage.watch(GRID.region(0))
        first.wait()
        second = stage.watch(GRID.region(0))
        assert second.wait() is first.frames[-1]

    def test_regions_without_cameras_need_no_rendering(self, stage: Set) -> None:
        """A plain tile is up to date without anybody watching; also before any robot
        (side channels 1)."""
        frame = stage.render_loop.newest(GRID.region(3))
        assert frame is not None
        assert empty(frame, 3)
        stage.board.views = ()
        assert stage.render_loop.newest(GRID.frame) is frame
        assert stage.render_loop.pictures == 0

    def test_a_watcher_of_plain_tiles_is_told_too(self, stage: Set) -> None:
        """Watching a region without cameras gives a frame as well."""
        watcher = stage.watch(GRID.region(3))
        assert empty(watcher.wait(), 3)

    def test_always_render(self, stage: Set) -> None:
        """With the option all cameras are up to date though nobody watches."""
        render_loop = stage.make(always=True)
        render_loop.open()
        try:
            until(lambda: render_loop.newest(GRID.frame) is not None)
        finally:
            render_loop.close()

    def test_one_bad_watcher_harms_nobody(self, stage: Set) -> None:
        """An exception in one callback does not keep the others from their frames."""

        def bad(frame: Frame) -> None:
            raise RuntimeError("oops")

        stage.render_loop.watch(GRID.region(0), bad)
        good = stage.watch(GRID.region(0))
        good.wait()
        stage.world.set_time(1.0)
        good.wait(2)


class TestFrames:
    """Frames are values."""

    def test_a_frame_never_changes(self, stage: Set) -> None:
        """A frame that somebody keeps stays as it was, and cannot be written to."""
        watcher = stage.watch(GRID.region(0))
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
        watcher = stage.watch(GRID.frame)
        watcher.wait()
        for step in range(1, 4):
            stage.world.set_time(float(step))
            until(lambda step=step: watcher.frames[-1].time == step)  # type: ignore[misc]
        numbers = [frame.number for frame in watcher.frames]
        assert numbers == sorted(set(numbers))

    def test_no_news_no_new_frame(self, stage: Set) -> None:
        """A region in which nothing was painted keeps its frame while others get new ones."""
        stage.board.views = stage.board.views[:2]
        stage.watch(GRID.region(2))
        other = stage.watch(GRID.region(0))
        other.wait()
        kept = stage.render_loop.newest(GRID.region(2))
        stage.world.set_time(1.0)
        other.wait(2)
        assert stage.render_loop.newest(GRID.region(2)) is kept


class TestTurns:
    """When a camera is rendered."""

    @pytest.mark.parametrize("rate", [15.0, 4.0])
    def test_at_most_so_many_pictures_per_simulated_second(self, stage: Set, rate: float) -> None:
        """However finely the clock moves, a camera gets its rate and no more
        (side channels 2.6)."""
        stage.world.speed = math.inf  # the clock goes as it likes
        render_loop = stage.make(rate=rate)
        watcher = Watcher()
        try:
            render_loop.watch(GRID.region(0), watcher)
            watcher.wait()
            for step in range(1, 101):
                stage.world.set_time(0.01 * step)
                looks = stage.world.looks
                until(lambda looks=looks: stage.world.looks > looks + 1)  # type: ignore[misc]
        finally:
            render_loop.close()
        assert render_loop.pictures == pytest.approx(rate, abs=1.1)

    def test_standing_time_renders_nothing_new(self, stage: Set) -> None:
        """While simulated time stands still there is nothing to be seen; looks become rare."""
        watcher = stage.watch(GRID.frame)
        watcher.wait()
        done, looks = stage.render_loop.pictures, stage.world.looks
        began = time.monotonic()
        time.sleep(0.3)
        passed = time.monotonic() - began
        assert stage.render_loop.pictures == done == 3
        assert stage.world.looks - looks < 20 + 100.0 * passed

    def test_a_changed_camera_is_rendered_at_once(self, stage: Set) -> None:
        """A zoom shows without waiting for the camera's turn."""
        watcher = stage.watch(GRID.region(0))
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

        original = stage.render_loop._atlas.paint

        def paint(tile: int, key: int, picture: object, now: float) -> None:
            times.append((tile, now))
            time.sleep(0.04)
            original(tile, key, picture, now)  # type: ignore[arg-type]

        stage.render_loop._atlas.paint = paint  # type: ignore[assignment,method-assign]
        ticking = threading.Thread(target=clock)
        ticking.start()
        try:
            stage.render_loop.watch(GRID.frame, Watcher())
            until(lambda: len(times) > 12)
        finally:
            stop.set()
            ticking.join()
        left = [now for tile, now in times if tile == 0]
        right = [now for tile, now in times if tile == 2]
        count = min(len(left), len(right))
        assert left[:count] == right[:count]
        assert {tile for tile, _ in times} == {0, 1, 2}  # and nobody starves
