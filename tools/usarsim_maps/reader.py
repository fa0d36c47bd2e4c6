"""What a reader of a map format is, and how the right one is found.

A reader is one class in one file of a folder of this package, registered with `register`; another
package brings one through the entry point group `usarsim_maps.readers`. Importing a reader's module
must be cheap: heavy or optional packages belong inside `read` (see `need`).
"""

from __future__ import annotations

import importlib
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import ClassVar

from usarsim_maps.files import AssetIndex, read_head
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Scene
from usarsim_maps.support import SupportTable
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.extras import install
from usarsim_server.base.files import ALLOW, Folders
from usarsim_server.base.plugins import PluginTypes
from usarsim_server.world_cost import LIMITS, WorldLimits

EXTRAS = {"pxr": "usd", "ufbx": "fbx", "yaml": "maps"} | dict.fromkeys(
    ("DracoPy", "lxml", "meshopt", "networkx", "trimesh"), "meshes"
)
"""Extras that bring the optional packages."""

GROUP = "usarsim_maps.readers"
"""Entry point group for readers of other packages."""

ANYTHING = {".txt"}
"""Extensions that say little: the first bytes are asked before the name."""


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What a user may say about a map; None leaves it to the file or the format's convention."""

    scale: float | None = None  # units of the file per metre; replaces what the file says
    up: str | None = None  # axis of the file that points up, `Z` or `Y`
    mirror: bool = False
    """Reflect the map (y becomes -y); for files written without regard to handedness."""
    assets: tuple[Path, ...] = ()
    """Folders searched for meshes, textures and models that the map names."""
    placeholders: bool = False  # a box of 0.5 m stands in for every mesh that is missing
    wall_height: float | None = None  # m, of walls that come from occupancy grids
    allow_outside: bool = False
    """What the map names is read wherever it lies, not only in its own folder and those of
    `assets`."""
    limits: WorldLimits = LIMITS  # of what becomes of the map


def unwatched(step: str, part: float) -> None:
    """Nobody watches."""


@dataclass(frozen=True, slots=True, eq=False)
class Context:
    """What a reader is given beside the file."""

    options: ImportOptions = field(default_factory=ImportOptions)  # of the user
    findings: Findings = field(default_factory=Findings)
    """Where counts, missing files and warnings go."""
    progress: Callable[[str, float], None] = unwatched
    """Call now and then with what is being done and the part of it that is done, 0 to 1. It may
    raise to end the import."""
    folders: Folders | None = None
    """What may be read; None stands for the asset folders. `read_scene` adds the map's."""

    def admit(self, path: Path, asker: Path) -> bool:
        """Whether a file or folder may be read; a refusal is a finding.

        Args:
            path: that was found.
            asker: the file that names it.
        """
        refusal = self.confined().refusal(path, asker)
        if refusal is not None:
            self.findings.warn(asker.name, f"{refusal}; {ALLOW}")
        return refusal is None

    def index(self, source: Path) -> AssetIndex:
        """Finds by name what a file names, beside it and in the asset folders."""
        return AssetIndex(self.options.assets, source, lambda path: self.admit(path, source))

    def confined(self) -> Folders:
        """The folders that may be read."""
        options = self.options
        return self.folders or Folders(options.assets, allow_outside=options.allow_outside)


class Reader(ABC):
    """Reads one family of map files.

    Attributes:
        title: the format, for people.
        extensions: of the files it reads, lower case with the dot.
        head: what is in the first bytes of its files and in no others.
        meshes: its files may be meshes that other maps name.
        support: what happens to the elements of the format, by the name of the list that they
            stand in (`glTF extensions`); docs/import.md repeats it.
    """

    title: ClassVar[str]
    extensions: ClassVar[tuple[str, ...]]
    head: ClassVar[re.Pattern[bytes] | None] = None
    meshes: ClassVar[bool] = True
    support: ClassVar[Mapping[str, SupportTable]] = {}

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Whether the first 4 KiB of a file look like this format: whether `head` is found in them.

        Asked only where the extension does not decide: several readers want it, or none.
        """
        return cls.head is not None and cls.head.search(head) is not None

    @abstractmethod
    def read(self, source: Path, context: Context) -> Scene:
        """Read one file.

        Raises:
            MapImportError: the file cannot be used; the message names file, place and cure.
                Missing decorations are findings, never errors.
        """


FOLDERS = ("fbx", "gazebo", "grids", "meshes", "unreal", "usd")
"""Packages of this one that hold the built-in readers."""

TYPES: PluginTypes[Reader] = PluginTypes(
    "map reader", Reader, (f"usarsim_maps.{name}" for name in FOLDERS), GROUP
)

register = TYPES.register
"""Class decorator: `@register("t3d")` makes a reader known under this short name."""


def readers() -> dict[str, type[Reader]]:
    """All readers by short name, sorted."""
    return {name: TYPES.find(name, GROUP) for name in TYPES.names()}


def mesh_extensions() -> tuple[str, ...]:
    """Of files that may hold meshes which other maps name; those of the first readers first."""
    mesh_readers = (reader for reader in readers().values() if reader.meshes)
    return tuple(dict.fromkeys(ext for reader in mesh_readers for ext in reader.extensions))


def find_reader(source: Path) -> Reader:
    """The reader of a file, by extension and, where that does not decide, by the first bytes.

    Raises:
        MapImportError: there is no such file, or no reader wants it.
    """
    if not os.path.lexists(source):
        raise MapImportError(at(source, "no such file", "check the path of the map"))
    head = read_head(source)
    known = list(dict.fromkeys(readers().values()))
    suffix = source.suffix.lower()
    by_name = [cls for cls in known if suffix in cls.extensions]
    if len(by_name) == 1 and suffix not in ANYTHING:
        return by_name[0]()
    for cls in known if suffix in ANYTHING else by_name or known:
        if cls.recognises(head):
            return cls()
    if by_name:
        return by_name[0]()
    extensions = ", ".join(sorted({ext for cls in known for ext in cls.extensions}))
    problem = f"unknown kind of map {suffix!r}" if suffix else "a file without extension"
    raise MapImportError(at(source, problem, f"known extensions: {extensions}"))


def read_scene(source: Path, context: Context | None = None) -> Scene:
    """Read a map file of any known format, also for readers that need the meshes of other files.

    Raises:
        MapImportError: see `Reader.read`.
    """
    context = context or Context()
    if context.folders is None:
        context = replace(context, folders=context.confined().with_more([source.parent]))
    reader = find_reader(source)
    try:
        return without_refused(reader.read(source, context), context, source)
    except MapImportError:
        raise
    except (RecursionError, MemoryError) as error:
        problem = f"too deeply nested or too large ({type(error).__name__})"
        raise MapImportError(at(source, problem, "import a smaller part of the map")) from None
    except OSError as error:
        problem = f"cannot be read: {error.strerror}"
        raise MapImportError(at(error.filename or source, problem, "check the file")) from error


def without_refused(scene: Scene, context: Context, asker: Path) -> Scene:
    """The scene without pictures that lie where nothing may be read: the last place to look."""
    changed = {}
    for name, material in scene.materials.items():
        if material.texture is not None and not context.admit(material.texture, asker):
            material = replace(material, texture=None)
        mask = material.opacity and material.opacity.picture
        if isinstance(mask, Path) and not context.admit(mask, asker):
            material = replace(material, opacity=None)
        if material is not scene.materials[name]:
            changed[name] = material
    return replace(scene, materials={**scene.materials, **changed}) if changed else scene


def need(module: str, source: Path, what_for: str) -> ModuleType:
    """Import an optional package.

    Args:
        module: its name.
        source: the file that needs it.
        what_for: for example `USD files`.

    Raises:
        MapImportError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        top = module.partition(".")[0]
        problem = f"{what_for} need the Python package {top!r}"
        cure = install(EXTRAS[top]) if top in EXTRAS else f"pip install {top}"
        raise MapImportError(at(source, problem, cure)) from None
