"""Reads maps and mesh packages of UDK as its editor saves them (worlds reference 5)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Scene
from usarsim_maps.unreal.actors import LevelReader, level_of
from usarsim_maps.unreal.archive import PackageError
from usarsim_maps.unreal.brushes import BuiltLevel, read_built_level
from usarsim_maps.unreal.check import agreement
from usarsim_maps.unreal.compression import TAG
from usarsim_maps.unreal.level import UnrealLevel
from usarsim_maps.unreal.library import as_error, load_package
from usarsim_maps.unreal.package import Export, Package
from usarsim_server.errors import MapImportError, at

__all__ = ["UdkReader"]

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
