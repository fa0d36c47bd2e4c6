"""All live cameras of a world and the tiles of the full frame that they fill.

A camera gets the lowest free tile when it appears and keeps that place until its robot leaves
(side channels reference 2.10). The tiles of a robot belong to the robot: its viewports may show
another of its cameras there, or nothing.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace

from usarsim_server.cameras.view import CameraView, Grid, Region
from usarsim_server.protocol.values import name_key
from usarsim_server.simulation.frames import Pose

MOST_TILES = 64
"""Largest number of tiles of the original's grid (side channels reference 2.10)."""

MOST_CLIENTS = 1024
"""Addresses whose view can be bound to a camera at one time, so that no client bloats the board."""


@dataclass(frozen=True, slots=True)
class _Place:
    """A taken tile: the robot it belongs to, None for a spectator's; the camera it shows."""

    robot: int | None
    shows: int | None


class CameraBoard:
    """Who looks from where, and onto which tile; safe to use from any thread."""

    def __init__(self, grid: Grid) -> None:
        """Start without cameras.

        Raises:
            ValueError: if the grid has no tiles or more than 64.
        """
        if not 1 <= grid.tiles <= MOST_TILES:
            raise ValueError(f"{grid.tiles} tiles, from 1 to {MOST_TILES} are possible")
        self._grid = grid
        self._lock = threading.Lock()
        self._keys = itertools.count(1)
        self._cameras: dict[int, CameraView] = {}
        self._places: dict[int, _Place] = {}
        self._echoes: dict[tuple[int, int], int] = {}
        self._bound: dict[str, int] = {}
        self._views: tuple[CameraView, ...] = ()

    @property
    def grid(self) -> Grid:
        """Geometry of the full frame."""
        return self._grid

    @property
    def views(self) -> tuple[CameraView, ...]:
        """All cameras in the order of their appearance, those without a tile included.

        A camera that fills several tiles is in here once for each of them, under a key of its own
        from the second one on.
        """
        return self._views

    def add(
        self,
        name: str,
        owner: str,
        robot: int | None,
        link: str | None,
        pose: Pose,
        fov: float,
        rate: float | None = None,
        size: tuple[int, int] | None = None,
    ) -> CameraView:
        """A camera appears and takes the lowest free tile, if there is one.

        Arguments are those of `CameraView`; a spectator has neither owner nor robot.
        """
        with self._lock:
            key = next(self._keys)
            self._cameras[key] = CameraView(
                key, name, owner, robot, link, pose, fov, None, rate, size
            )
            every = range(self._grid.tiles)
            tile = next((one for one in every if one not in self._places), None)
            if tile is not None:
                self._places[tile] = _Place(robot, key)
            self._refresh()
            return self._view(key)

    def remove(self, key: int) -> None:
        """A camera is gone; a spectator's tile becomes free. An unknown key does nothing."""
        with self._lock:
            if self._cameras.pop(key, None) is None:
                return
            for tile, place in tuple(self._places.items()):
                if place.shows == key:
                    if place.robot is None:
                        del self._places[tile]
                    else:
                        self._places[tile] = _Place(place.robot, None)
            self._refresh()

    def remove_robot(self, robot: int) -> None:
        """A robot has left: its cameras go, its tiles become free."""
        with self._lock:
            self._cameras = {k: one for k, one in self._cameras.items() if one.robot != robot}
            self._places = {t: one for t, one in self._places.items() if one.robot != robot}
            self._refresh()

    def set_fov(self, key: int, fov: float) -> None:
        """Change a camera's horizontal field of view (rad); an unknown key does nothing."""
        with self._lock:
            if key in self._cameras:
                self._cameras[key] = replace(self._cameras[key], fov=fov)
                self._refresh()

    def get(self, key: int) -> CameraView | None:
        """The camera with a key as it is now; None if it is gone."""
        with self._lock:
            return self._view(key) if key in self._cameras else None

    def find(self, name: str, owner: str = "") -> CameraView | None:
        """A camera by its name and the label of its robot, in any case; None if there is none.

        The only camera of a robot is found by any name: a client's ini names the Sedan's camera
        `Camera`, and its program says `RobotCamera`.
        """
        wanted, owner_key = name.strip().lower(), name_key(owner)
        with self._lock:
            own = {
                key: one.name.lower()
                for key, one in self._cameras.items()
                if name_key(one.owner) == owner_key
            }
            for key, camera in own.items():
                if camera == wanted:
                    return self._view(key)
            if owner and len(own) == 1:
                return self._view(next(iter(own)))
        return None

    # -- viewports ---------------------------------------------------------------------------

    def tiles(self, robot: int) -> tuple[int, ...]:
        """The tiles that belong to a robot, lowest first."""
        with self._lock:
            return self._tiles(robot)

    def show(self, robot: int, cameras: Sequence[int | None]) -> None:
        """Choose what the tiles of a robot show, by key of a camera of it, lowest tile first.

        None, or nothing at the end, leaves a tile black. What is too much, or no camera of
        this robot, is left out.
        """
        with self._lock:
            for index, tile in enumerate(self._tiles(robot)):
                key = cameras[index] if index < len(cameras) else None
                camera = None if key is None else self._cameras.get(key)
                mine = camera is not None and camera.robot == robot
                self._places[tile] = _Place(robot, key if mine else None)
            self._refresh()

    # -- views of certain clients ------------------------------------------------------------

    def bind(self, client: str, key: int | None) -> None:
        """Let a client of the picture port, by its address, see one camera only; None releases it.

        This is what `SET {Type Camera} {Robot} {Name} {Client}` asks for (side channels reference
        2.11). The binding ends with the camera.
        """
        with self._lock:
            self._bound.pop(client, None)
            if key in self._cameras and key is not None:
                while len(self._bound) >= MOST_CLIENTS:
                    del self._bound[next(iter(self._bound))]
                self._bound[client] = key

    def bound(self, client: str) -> Region | None:
        """Where the picture of the camera lies that an address is bound to; None: it sees all."""
        if not self._bound:
            return None
        with self._lock:
            key = self._bound.get(client)
            view = None if key is None else self._view(key)
        if view is None or view.tile is None:
            return None
        return self._grid.region(view.tile, view.size)

    # -- inside, with the lock held ----------------------------------------------------------

    def _tiles(self, robot: int) -> tuple[int, ...]:
        return tuple(sorted(t for t, place in self._places.items() if place.robot == robot))

    def _shown_on(self, key: int) -> list[int]:
        return sorted(tile for tile, place in self._places.items() if place.shows == key)

    def _view(self, key: int) -> CameraView:
        tiles = self._shown_on(key)
        return replace(self._cameras[key], tile=tiles[0] if tiles else None)

    def _refresh(self) -> None:
        """Make the views anew after any change."""
        self._bound = {c: key for c, key in self._bound.items() if key in self._cameras}
        echoes: dict[tuple[int, int], int] = {}
        views: list[CameraView] = []
        for key in self._cameras:
            views.append(self._view(key))
            for tile in self._shown_on(key)[1:]:
                echo = self._echoes.get((key, tile)) or next(self._keys)
                echoes[key, tile] = echo
                views.append(replace(self._cameras[key], key=echo, tile=tile))
        self._echoes = echoes
        self._views = tuple(views)
