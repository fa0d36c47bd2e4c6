"""Worlds of one process share what never changes and costs more than a small world to make: the
classes of the robot files and the sheets, and scenery and bodies that are made ready for rays.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar
from unittest import mock

import mujoco
import numpy as np

from usarsim_server import app
from usarsim_server.base.files import data_directory
from usarsim_server.robots import catalog
from usarsim_server.robots.catalog import Library, RobotCatalog, RobotFile, load_catalog
from usarsim_server.simulation import simulation
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.rays.groups import RigidGroup
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.scenery import StaticGeometry
from usarsim_server.simulation.rays.triangles import TriangleScene
from usarsim_server.worlds.avatars.bodies import load_avatars
from usarsim_server.worlds.objects.bodies import load_objects

_HOME = data_directory("robots")
_WORLDS = data_directory("worlds")
_MOST_SCENES = 16
"""Scenes kept; maps of hundreds of thousands of triangles take some 100 MB each."""
_MOST_BODIES = 256
"""Bodies kept; few have more than some thousand triangles."""

_scenery: dict[bytes, StaticGeometry] = {}
_bodies: dict[bytes, TriangleScene] = {}
_Kind = TypeVar("_Kind")
_make_body = DynamicGeometry._scene


@functools.cache
def shipped_robots() -> RobotCatalog:
    """The classes of the shipped robot files, read once in this process."""
    return load_catalog()


class _SharingLibrary(Library):
    """Folders of robot files; the shipped ones are read once in this process."""

    def __init__(self, folders: Sequence[Path], *, allow_outside: bool = False) -> None:
        super().__init__(folders, allow_outside=allow_outside)
        # A shipped class may extend one that a further folder replaces: then all are read anew.
        if folders[0] == _HOME and not self.replacements():
            self._read.update(self._shipped())

    @staticmethod
    @functools.cache
    def _shipped() -> dict[Path, RobotFile]:
        library = Library([_HOME])
        library.layers()
        return library._read


@contextlib.contextmanager
def shared_parts(*, own_robots: bool = False) -> Iterator[None]:
    """Inside, servers of this process share the shipped robots, equal scenery and equal bodies.

    Args:
        own_robots: share classes of further folders, too: no robot file may change meanwhile.
    """
    home = data_directory("robots")
    shipped = functools.cache(lambda folder: shipped_robots() if folder == home else load_catalog())

    def load(extra: Sequence[Path] = (), *, allow_outside: bool = False) -> RobotCatalog:
        if extra:
            return load_catalog(extra, allow_outside=allow_outside)
        return shipped(data_directory("robots"))

    with (
        mock.patch.object(
            app, "load_catalog", functools.cache(load_catalog) if own_robots else load
        ),
        mock.patch.object(catalog, "Library", _SharingLibrary),
        mock.patch.object(app, "load_objects", _shared_sheets(load_objects)),
        mock.patch.object(app, "load_avatars", _shared_sheets(load_avatars)),
        mock.patch.object(simulation, "StaticGeometry", _shared_scenery),
        mock.patch.object(DynamicGeometry, "_scene", _shared_body),
    ):
        yield


def _shared_sheets(load: Callable[[Iterable[Path]], _Kind]) -> Callable[[Iterable[Path]], _Kind]:
    """What reads sheets of classes, but the shipped ones only once."""
    shipped = functools.cache(lambda sheet: load([sheet]))

    def load_what_exists(sheets: Iterable[Path]) -> _Kind:
        there = [sheet for sheet in sheets if os.path.lexists(sheet)]
        if len(there) == 1 and there[0].is_relative_to(_WORLDS):
            return shipped(there[0])
        return load(there)

    return load_what_exists


def _shared_scenery(world: CompiledWorld) -> StaticGeometry:
    """The geometry of a world; that of an equal model, if there was one before."""
    model = np.empty(mujoco.mj_sizeModel(world.model), np.uint8)
    mujoco.mj_saveModel(world.model, None, model)
    key = hashlib.blake2b(model.tobytes()).digest()
    if key not in _scenery:
        _keep(_scenery, _MOST_SCENES, key, StaticGeometry(world))
    return _scenery[key]


def _shared_body(
    geometry: DynamicGeometry,
    model: mujoco.MjModel,
    rigid_group: RigidGroup,
    shown: list[bool],
    known: dict[bytes, TriangleScene],
) -> TriangleScene:
    """The scene of a body; that of one of an equal shape, if there was one before."""
    before = len(geometry._scenes)
    scene = _make_body(geometry, model, rigid_group, shown, ChainMap(known, _bodies))
    if len(geometry._scenes) > before:
        key = next(reversed(geometry._scenes))
        if key not in _bodies:
            _keep(_bodies, _MOST_BODIES, key, scene)
    return scene


def _keep(made: dict[bytes, _Kind], most: int, key: bytes, value: _Kind) -> None:
    """Remember one more; the oldest is forgotten for it where there are too many."""
    if len(made) == most:
        made.pop(next(iter(made)), None)
    made[key] = value
