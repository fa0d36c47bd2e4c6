"""What a reader of a map format is, and how the right one is found.

A reader is one class in one file of this package, registered with `register`; another package
brings one through the entry point group `usarsim_server.importers`. Importing a reader's module
must be cheap: heavy or optional packages belong inside `read` (see `need`).
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import usarsim_server.importers as package
from usarsim_server.errors import MapImportError, at
from usarsim_server.importers.files import read_head
from usarsim_server.importers.findings import Findings
from usarsim_server.importers.scene import Scene
from usarsim_server.plugins import PluginTypes

__all__ = [
    "GROUP",
    "Context",
    "ImportOptions",
    "Reader",
    "find_reader",
    "need",
    "read_scene",
    "readers",
    "register",
]

PACKAGES = {"pxr": "pip install usd-core"}
"""How to get an optional package whose name is not that of its module."""

GROUP = "usarsim_server.importers"
"""Entry point group for readers of other packages."""

ANYTHING = {".txt"}
"""Extensions that say little: the first bytes are asked before the name."""


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What a user may say about a map; None leaves it to the file or the format's convention.

    Attributes:
        scale: units of the file per metre; replaces what the file says.
        up: axis of the file that points up, `Z` or `Y`.
        mirror: reflect the map (y becomes -y); for files written without regard to handedness.
        assets: folders searched for meshes, textures and models that the map names.
        placeholders: a box of 0.5 m stands in for every mesh that is missing.
        wall_height: m, of walls that come from occupancy grids.
    """

    scale: float | None = None
    up: str | None = None
    mirror: bool = False
    assets: tuple[Path, ...] = ()
    placeholders: bool = False
    wall_height: float | None = None


def _quiet(step: str, part: float) -> None:
    """Nobody watches."""


@dataclass(frozen=True, slots=True, eq=False)
class Context:
    """What a reader is given beside the file.

    Attributes:
        options: of the user.
        findings: where counts, missing files and warnings go.
        progress: call now and then with what is being done and the part of it that is done, 0 to
            1. It may raise to end the import.
    """

    options: ImportOptions = field(default_factory=ImportOptions)
    findings: Findings = field(default_factory=Findings)
    progress: Callable[[str, float], None] = _quiet


class Reader(ABC):
    """Reads one family of map files.

    Attributes:
        title: the format, for people.
        extensions: of the files it reads, lower case with the dot.
        meshes: its files may be meshes that other maps name.
    """

    title: ClassVar[str]
    extensions: ClassVar[tuple[str, ...]]
    meshes: ClassVar[bool] = True

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Whether the first 4 KiB of a file look like this format.

        Asked only where the extension does not decide: several readers want it, or none.
        """
        return False

    @abstractmethod
    def read(self, source: Path, context: Context) -> Scene:
        """Read one file.

        Raises:
            MapImportError: the file cannot be used; the message names file, place and cure.
                Missing decorations are findings, never errors.
        """


TYPES: PluginTypes[Reader] = PluginTypes("map reader", Reader, package, GROUP)

register = TYPES.register
"""Class decorator: `@register("t3d")` makes a reader known under this short name."""


def readers() -> dict[str, type[Reader]]:
    """All readers by short name, sorted."""
    return {name: TYPES.find(name, GROUP) for name in TYPES.names()}


def find_reader(source: Path) -> Reader:
    """The reader of a file, by extension and, where that does not decide, by the first bytes.

    Raises:
        MapImportError: there is no such file, or no reader wants it.
    """
    if not source.is_file():
        raise MapImportError(at(source, "no such file", "check the path of the map"))
    known = list(dict.fromkeys(readers().values()))
    suffix = source.suffix.lower()
    by_name = [cls for cls in known if suffix in cls.extensions]
    if len(by_name) == 1 and suffix not in ANYTHING:
        return by_name[0]()
    head = read_head(source)
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
    reader = find_reader(source)
    try:
        return reader.read(source, context)
    except MapImportError:
        raise
    except (RecursionError, MemoryError) as error:
        problem = f"too deeply nested or too large ({type(error).__name__})"
        raise MapImportError(at(source, problem, "import a smaller part of the map")) from None
    except OSError as error:
        raise MapImportError(
            at(error.filename or source, f"cannot be read: {error.strerror}", "check the file")
        ) from error


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
        raise MapImportError(
            at(
                source,
                f"{what_for} need the Python package {top!r}",
                PACKAGES.get(top, f"pip install {top}"),
            )
        ) from None
