"""The full frame while it is painted, and who is shown which part of it.

All that the rendering thread and everybody else have in common.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.logs import Log
from usarsim_server.cameras.view import Frame, Grid, Region

OnFrame = Callable[[Frame], None]

EMPTY = (0, 0, 0)
"""Colour of a tile without a camera."""

_log = Log("cameras")


class Atlas:
    """Tiles side by side; belongs to the rendering thread, its frames to everybody.

    Each picture is copied once, and what is in a tile never changes: readers keep frames as long as
    they like, and nobody waits for anybody.
    """

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._empty = self._tile()
        self._tiles = [self._empty] * grid.tiles
        self._shows: list[int | None] = [None] * grid.tiles
        self._time = 0.0
        self._changed: set[int] = set()
        self.frame = Frame(0, self._time, grid, tuple(self._tiles))

    @property
    def shows(self) -> tuple[int | None, ...]:
        """Key of the camera whose picture is in each tile; None: the tile is empty."""
        return tuple(self._shows)

    def paint(self, tile: int, key: int, picture: NDArray[np.uint8], time: float) -> None:
        """Put what a camera, by its key, saw at a simulated time (s) into a tile.

        The picture is (height, width, 3); what the tile has beyond it is empty.
        """
        self._tiles[tile] = self._tile(picture)
        self._shows[tile] = key
        self._time = max(self._time, time)
        self._changed.add(tile)

    def wipe(self, tile: int, key: int | None = None) -> None:
        """Empty a tile; a key stands for a camera that sees nothing at present."""
        self._tiles[tile] = self._empty
        self._shows[tile] = key
        self._changed.add(tile)

    def publish(self) -> tuple[Frame, frozenset[int]] | None:
        """A new frame and the tiles that are new in it; None if nothing has changed."""
        if not self._changed:
            return None
        changed, self._changed = frozenset(self._changed), set()
        self.frame = Frame(self.frame.number + 1, self._time, self._grid, tuple(self._tiles))
        return self.frame, changed

    def _tile(self, picture: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
        height, width = (0, 0) if picture is None else picture.shape[:2]
        tile = np.empty((self._grid.tile_height, self._grid.tile_width, 3), np.uint8)
        tile[height:], tile[:height, width:] = EMPTY, EMPTY
        if picture is not None:
            tile[:height, :width] = picture
        tile.flags.writeable = False
        return tile


@dataclass(slots=True, eq=False)
class _Spot:
    """A region that is watched, by any number of watchers."""

    tiles: frozenset[int]  # of the region
    frame: Frame  # the newest frame in which something in the region is new
    watchers: dict[_Watch, OnFrame] = field(default_factory=dict)  # what to call, by watch
    untold: set[_Watch] = field(default_factory=set)
    """Watchers that have not been told of any frame yet."""


class _Watch:
    """One watcher (see `Watch`)."""

    def __init__(self, watches: Watches, on_frame: OnFrame) -> None:
        self._watches = watches
        self._on_frame = on_frame
        self._region: Region | None = None

    def look_at(self, region: Region) -> None:
        """Change what is looked at."""
        self._watches.move(self, self._region, region, self._on_frame)
        self._region = region

    def close(self) -> None:
        """Look away; a second call does nothing."""
        self._watches.move(self, self._region, None, self._on_frame)
        self._region = None


class Watches:
    """All watchers, and what they are shown; safe to use from any thread."""

    def __init__(self, grid: Grid, blank: Frame, on_change: Callable[[], None]) -> None:
        """Start with nobody watching.

        `blank` is the frame before the first; `on_change` is told, by any thread, when what is
        watched has changed.
        """
        self._grid = grid
        self._on_change = on_change
        self._lock = threading.Lock()
        self._spots: dict[Region, _Spot] = {}
        self._frame = blank
        self._shows: tuple[int | None, ...] = (None,) * grid.tiles
        self._fresh: frozenset[int] = frozenset()

    def watch(self, region: Region, on_frame: OnFrame) -> _Watch:
        """See `FrameSource.watch`."""
        watch = _Watch(self, on_frame)
        watch.look_at(region)
        return watch

    def move(
        self, watch: _Watch, old: Region | None, new: Region | None, on_frame: OnFrame
    ) -> None:
        """Let a watcher look somewhere else, or away."""
        with self._lock:
            if old is not None:
                spot = self._spots[old]
                del spot.watchers[watch]
                spot.untold.discard(watch)
                if not spot.watchers:
                    del self._spots[old]
            if new is not None:
                spot = self._spots.setdefault(new, _Spot(self._tiles(new), self._frame))
                spot.watchers[watch] = on_frame
                spot.untold.add(watch)
            self._fresh &= self._watched()
        self._on_change()

    @property
    def waiting(self) -> bool:
        """Whether a watcher has not been told of any frame yet."""
        with self._lock:
            return any(spot.untold for spot in self._spots.values())

    @property
    def stale(self) -> frozenset[int]:
        """Tiles that somebody watches and nobody has painted since, plain ones included."""
        with self._lock:
            return self._watched() - self._fresh

    @property
    def tiles(self) -> frozenset[int]:
        """All tiles that somebody watches."""
        with self._lock:
            return self._watched()

    def newest(self, region: Region, keys: Mapping[int, int]) -> Frame | None:
        """See `FrameSource.newest`; `keys` are those of the cameras that there are now, by tile."""
        with self._lock:
            spot = self._spots.get(region)
            tiles = self._tiles(region) if spot is None else spot.tiles
            if not self._ready(tiles, keys):
                return None
            # Readers keep what they made of a frame by its number: no new one without news.
            return self._frame if spot is None else spot.frame

    def show(
        self,
        frame: Frame,
        shows: tuple[int | None, ...],
        changed: frozenset[int],
        keys: Mapping[int, int],
        kept: frozenset[int] = frozenset(),
    ) -> None:
        """Hand out what has been painted (by the rendering thread).

        Args:
            frame, shows: the newest frame, and keys of the cameras in its tiles.
            changed: tiles that are new in it; none: nothing is new, but a watcher may be.
            keys: of the cameras that there are now, by tile.
            kept: tiles whose older pictures are still up to date.
        """
        with self._lock:
            self._frame, self._shows = frame, shows
            self._fresh = (self._fresh | changed | kept) & self._watched()
            calls: list[tuple[OnFrame, Frame]] = []
            for spot in self._spots.values():
                news = not spot.tiles.isdisjoint(changed)
                if news:
                    spot.frame = frame
                if self._ready(spot.tiles, keys):
                    told = spot.watchers if news else spot.untold
                    calls += [(spot.watchers[watch], spot.frame) for watch in told]
                    spot.untold.clear()
        for on_frame, told_of in calls:
            try:
                on_frame(told_of)
            except Exception as error:
                # One watcher's mistake must not blind the others.
                _log.exception("a watcher of pictures failed", error)

    def _ready(self, tiles: Collection[int], keys: Mapping[int, int]) -> bool:
        """Whether tiles show what they should, and the pictures of cameras are up to date."""
        return all(
            self._shows[tile] == keys.get(tile) and (tile not in keys or tile in self._fresh)
            for tile in tiles
        )

    def _watched(self) -> frozenset[int]:
        return frozenset().union(*(spot.tiles for spot in self._spots.values()))

    def _tiles(self, region: Region) -> frozenset[int]:
        grid = self._grid
        return frozenset(t for t in range(grid.tiles) if grid.region(t).meets(region))
