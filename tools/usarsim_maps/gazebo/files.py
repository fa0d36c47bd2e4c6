"""Where Gazebo's URIs lead: models, meshes and pictures on this computer."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from usarsim_maps.gazebo.tree import FolderTree, Kind, entries, holds_model, newest_version, walk
from usarsim_maps.meshes.xml_text import read_xml
from usarsim_maps.reader import Context
from usarsim_server.errors import MapImportError
from usarsim_server.files import is_regular

VARIABLES = (
    "GAZEBO_MODEL_PATH",
    "GAZEBO_RESOURCE_PATH",
    "GZ_SIM_RESOURCE_PATH",
    "IGN_GAZEBO_RESOURCE_PATH",
    "SDF_PATH",
)
"""Environment variables with lists of folders."""

MAX_BESIDE = 5_000
"""Folders that are looked at below the world's own, which may be somebody's home."""

_FUEL = re.compile(
    r"^https?://[^/]+/.*?models/([^/]+)(?:/(?:tip|\d+))?(?:/files)?(?:/(.*))?$", re.I
)


def model_name(uri: str) -> str:
    """The name of the model that a URI of an include means."""
    name, rest = _split(uri)
    if name:
        return name
    last = rest.rstrip("/").rpartition("/")
    return last[0].rpartition("/")[2] if last[2].lower().endswith((".sdf", ".config")) else last[2]


def _split(uri: str) -> tuple[str, str]:
    """Model or package, empty if there is none, and the path in it."""
    uri = unquote(uri.strip()).replace("\\", "/").replace("\0", "")[:1000]
    fuel = _FUEL.match(uri)
    if fuel is not None:
        return fuel[1], fuel[2] or ""
    scheme, _, rest = uri.partition("://")
    if scheme.lower() in ("model", "package") and rest:
        name, _, path = rest.strip("/").partition("/")
        return name, path
    if scheme.lower() == "file" and rest:
        return "", rest
    return "", uri


def gazebo_folders() -> Iterator[Path]:
    """Folders that the user gave to Gazebo: by its environment variables, or by custom."""
    for variable in VARIABLES:
        for text in os.environ.get(variable, "").split(os.pathsep):
            if text:
                yield Path(text)
    with contextlib.suppress(RuntimeError):
        yield Path.home() / ".gazebo" / "models"


@dataclass(slots=True)
class GazeboFiles:
    """Finds what a world names, whatever the scheme of the URI.

    First where Gazebo looks: beside the file that asks, beside the world, in the asset folders and
    those that the user gave to Gazebo. Then anywhere below the asset folders, and last below the
    world's own folder, by as many folders of the URI as there are.

    Attributes:
        source: the world.
        context: of the import.
        files: everything that was found.
    """

    source: Path
    context: Context
    files: list[Path] = field(default_factory=list)
    _found: dict[tuple[str, Path, Kind], Path | None] = field(default_factory=dict)
    _trees: list[FolderTree] = field(default_factory=list)

    def find(self, uri: str, asker: Path) -> Path | None:
        """A file or folder; None if it is not there, or, which is a finding, may not be read.

        Args:
            uri: as written.
            asker: the file in which it is written.
        """
        return self._known(uri, asker, os.path.lexists)

    def file(self, uri: str, asker: Path) -> Path | None:
        """A regular file, as `find`."""
        return self._known(uri, asker, is_regular)

    def model(self, uri: str, asker: Path) -> Path | None:
        """The SDF file of the model that an include means, as `find`."""
        place = self._known(uri, asker, holds_model)
        return None if place is None else self.sdf(place)

    def sdf(self, place: Path) -> Path | None:
        """The SDF file of a model: the newest one of its `model.config`, or any."""
        if is_regular(place):
            return place
        place = newest_version(place)
        manifest = self.keep(walk(place, ["model.config"]), self.source)
        if manifest is not None:
            try:
                root = read_xml(manifest, limit=1 << 20).root
            except MapImportError as error:
                self.context.findings.warn(place.name, str(error))
            else:
                named = sorted(root.all("sdf"), key=lambda node: _version(node.get("version")))
                for node in reversed(named):
                    found = walk(place, [node.text])
                    if found is not None and is_regular(found):
                        return self.keep(found, manifest)
        found = walk(place, ["model.sdf"])
        if found is None:
            found = next((path for path in entries(place) if path.suffix == ".sdf"), None)
        return self.keep(found, self.source)

    def keep(self, found: Path | None, asker: Path) -> Path | None:
        """Note what was found for a file; None if it may not be read."""
        if found is None or not self.context.admit(found, asker):
            return None
        if is_regular(found):
            self.files.append(found)
        return found

    # ---- searching -------------------------------------------------------------------------

    def _known(self, uri: str, asker: Path, wanted: Kind) -> Path | None:
        key = (uri, asker.parent, wanted)
        if key not in self._found:
            self._found[key] = self._search(uri, asker, wanted)
        found = self._found[key]
        if found is not None and is_regular(found):
            self.files.append(found)
        return found

    def _search(self, uri: str, asker: Path, wanted: Kind) -> Path | None:
        name, path = _split(uri)
        parts = [part for part in f"{name}/{path}".split("/") if part not in ("", ".")]
        if not parts or (name and ".." in parts):
            return None
        outside: Path | None = None
        for found in self._usual(parts, asker, "" if name else path):
            if not wanted(found):
                continue
            if self.context.confined().admit(found):
                return found
            outside = outside or found
        for tree in self._below():
            found_below = tree.find(parts, asker, wanted, exact=bool(name))
            if found_below is not None and self.context.confined().admit(found_below):
                return found_below
        return self.keep(outside, asker)

    def _usual(self, parts: list[str], asker: Path, path: str) -> Iterator[Path]:
        """Where Gazebo looks; `path` is that of a URI without the name of a model or package."""
        here = self.source.parent
        places: list[tuple[Path, list[str]]] = []
        if path.startswith("/"):
            if os.path.lexists(path):
                yield Path(path)
            return
        if path:
            places += [(asker.parent, parts), (here, parts)]
        if ".." not in parts:
            for root in (here, here.parent, *self.context.options.assets, *gazebo_folders()):
                places += [(root, parts), (root / "models", parts)]
        for folder, steps in places:
            found = walk(folder, steps)
            if found is not None:
                yield found

    def _below(self) -> Iterator[FolderTree]:
        """What is below the asset folders, then what is below the world's own folder."""
        if not self._trees:
            assets, here = self.context.options.assets, self.source.parent
            self._trees = [FolderTree(assets), FolderTree((here,), MAX_BESIDE)]
        yield from self._trees


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".") if part.isdigit() and len(part) < 9)
