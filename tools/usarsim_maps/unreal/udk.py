"""Reads maps and mesh packages of UDK as its editor saves them (worlds reference 5).

Do the brushes of a level give what the editor has built from them?

Two independent ways to the same answer: the order of the brushes with the winding number of each
about a point, and the tree that is stored in the map (worlds reference 5.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Brush, BrushOperation, Scene, Solidity
from usarsim_maps.unreal.actors import LevelReader, level_of
from usarsim_maps.unreal.archive import TAG, PackageError
from usarsim_maps.unreal.brushes import BuiltLevel, read_built_level
from usarsim_maps.unreal.level import UnrealLevel
from usarsim_maps.unreal.library import as_error, load_package
from usarsim_maps.unreal.package import Export, Package
from usarsim_server.errors import MapImportError, at

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

POINTS = 600
"""Points that are looked at in a whole level."""

MAX_BRUSHES = 2_000
"""Levels with more are not compared: it would take seconds."""


def agreement(brushes: Sequence[Brush], built: BuiltLevel, scale: float) -> tuple[int, int]:
    """How many points brushes and tree agree about, and how many were asked.

    Args:
        brushes: of the level, in order, in metres.
        built: the tree, in Unreal units.
        scale: Unreal units per metre.
    """
    solids = [brush for brush in brushes if brush.solidity is not Solidity.NONSOLID]
    if not solids or len(solids) > MAX_BRUSHES:
        return 0, 0
    generator = np.random.default_rng(0)
    share = max(2, POINTS // len(solids))
    points = np.concatenate([_sample(brush, share, generator) for brush in solids])
    told = built.solid(points * [1.0, -1.0, 1.0] * scale)
    return int((told == _program(solids, points, not built.outside)).sum()), len(points)


def _sample(brush: Brush, count: int, generator: np.random.Generator) -> Array:
    """Points in and close to a brush."""
    corners = np.concatenate([polygon.vertices for polygon in brush.polygons])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.05 * (high - low)
    return generator.uniform(low - margin, high + margin, (count, 3))


def _program(brushes: Sequence[Brush], points: Array, filled: bool) -> Bools:
    """Carry out the brushes at some points; semisolid ones act last."""
    solid = np.full(len(points), filled)
    late = [brush for brush in brushes if brush.solidity is Solidity.SEMISOLID]
    early = [brush for brush in brushes if brush.solidity is Solidity.SOLID]
    for brush in (*early, *late):
        corners = np.concatenate([polygon.vertices for polygon in brush.polygons])
        low, high = corners.min(axis=0), corners.max(axis=0)
        near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
        if len(near):
            covered = near[inside(brush, points[near])]
            solid[covered] = brush.operation is BrushOperation.ADD
    return solid


def inside(brush: Brush, points: Array) -> Bools:
    """Whether points (n, 3) are in a brush: its faces wind about them.

    The sum of solid angles (van Oosterom and Strackee 1983) needs neither convex nor closed faces.
    """
    total = np.zeros(len(points))
    for polygon in brush.polygons:
        corners = polygon.vertices
        for k in range(1, len(corners) - 1):
            a, b, c = (corners[i] - points for i in (0, k, k + 1))
            la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
            volume = (a * np.cross(b, c)).sum(axis=1)
            rest = la * lb * lc + (a * b).sum(axis=1) * lc
            rest += (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
            total += 2.0 * np.arctan2(volume, rest)
    answer: Bools = np.abs(total) > 2.0 * np.pi
    return answer


MAX_SUBLEVELS = 100

MAPS = (".udk", ".ut3", ".umap")
"""Extensions of maps, in the order in which sublevels are searched."""

ENOUGH = 0.98
"""Part of the points that brushes and the built level have to agree about."""


@register("udk")
class UdkReader(Reader):
    """Levels; packages of static meshes, which are laid out side by side.

    Files of other generations of the engine are taken, too, to say what helps with them.
    """

    title = "Unreal UDK package"
    extensions = (".udk", ".upk", ".ut3", ".umap", ".uasset", ".ut2", ".unr", ".usx")
    meshes = False  # they are found by package and name, not by the name of the file

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """It begins with the tag of packages, in either order of bytes."""
        return head[:4] in (TAG.to_bytes(4, "little"), TAG.to_bytes(4, "big"))

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`; an error names the byte (item 72)."""
        package = load_package(source)
        main = level_of(package)
        level = UnrealLevel(source, context, self.title)
        try:
            if main is None:
                return self._catalogue(package, source, level, context)
            return self._level(package, main, source, level, context)
        except PackageError as error:
            raise as_error(source, error) from None

    def _catalogue(
        self, package: Package, source: Path, level: UnrealLevel, context: Context
    ) -> Scene:
        count = LevelReader(package, source, level, context).add_catalogue()
        if not count:
            cure = "import a map; folders of packages go to --assets"
            problem = "a package without a level and without static meshes"
            raise MapImportError(at(source, problem, cure))
        context.findings.warn(
            source.name, f"no level: its {count} meshes stand side by side; --assets is for these"
        )
        return level.scene()

    def _level(
        self, package: Package, main: Export, source: Path, level: UnrealLevel, context: Context
    ) -> Scene:
        level.whole_map = True
        reader = LevelReader(package, source, level, context)
        reader.add_all(main)
        own = len(level.brushes)
        self._sublevels(reader.sublevels, source, level, context)
        built = _built(package, main, context)
        if built is not None:
            same, asked = agreement(level.brushes[:own], built, level.scale)
            if asked:
                told = f"agree at {same} of {asked} points"
                context.findings.fact("brushes and built level", told)
            if same < ENOUGH * asked:
                context.findings.warn(
                    "level",
                    f"brushes and the geometry that was built from them agree at {same} of "
                    f"{asked} points only; rebuild the geometry in the editor and look again",
                )
        scene = level.scene()
        return scene if built is None else replace(scene, filled=not built.outside)

    def _sublevels(
        self, names: list[str], source: Path, level: UnrealLevel, context: Context
    ) -> None:
        """Levels that the map loads at run time, and those that they load."""
        seen = {source.stem.lower()}
        todo = list(names)
        while todo and len(seen) <= MAX_SUBLEVELS:
            name = todo.pop(0)
            if name.lower() in seen:
                continue
            seen.add(name.lower())
            path = level.library.index.find(name, MAPS)
            if path is None or path.suffix.lower() not in MAPS:
                context.findings.missing("sublevel", name)
                continue
            try:
                package = load_package(path)
                inner = level_of(package)
                if inner is not None:
                    reader = LevelReader(package, path, level, context, main=False)
                    reader.add_all(inner)
                    level.files.append(path)
                    todo += reader.sublevels
            except (MapImportError, PackageError) as error:
                context.findings.warn(name, f"the sublevel was left out: {error}")


def _built(package: Package, level: Export, context: Context) -> BuiltLevel | None:
    """The built tree; without one the map can be used all the same."""
    try:
        return read_built_level(package, level)
    except PackageError as error:
        context.findings.warn("level", f"what the editor built cannot be read: {error}")
        return None
