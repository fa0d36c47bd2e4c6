"""Where Gazebo's URIs lead: models, meshes and pictures on this computer."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from usarsim_server.errors import MapImportError
from usarsim_server.files import is_regular
from usarsim_server.importers.reader import Context
from usarsim_server.importers.xml_text import read_xml

__all__ = ["GazeboFiles", "gazebo_folders", "model_name"]

VARIABLES = (
    "GAZEBO_MODEL_PATH",
    "GAZEBO_RESOURCE_PATH",
    "GZ_SIM_RESOURCE_PATH",
    "IGN_GAZEBO_RESOURCE_PATH",
    "SDF_PATH",
)
"""Environment variables with lists of folders."""

MAX_FOLDERS = 20_000
"""Folders that are looked at below --assets."""

MAX_DEPTH = 5

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
    """Finds what a world names.

    Models are looked for beside the world, beside the folder that it is in, in the asset folders
    and whatever is below them, and where Gazebo looks: its environment variables and
    `~/.gazebo/models`.

    Attributes:
        source: the world.
        context: of the import.
        files: everything that was found.
    """

    source: Path
    context: Context
    files: list[Path] = field(default_factory=list)
    _models: dict[str, Path | None] = field(default_factory=dict)
    _deep: dict[str, Path] | None = None

    def find(self, uri: str, asker: Path) -> Path | None:
        """A file or folder; None if it is not there, or, which is a finding, may not be read.

        Args:
            uri: as written.
            asker: the file in which it is written.
        """
        name, path = _split(uri)
        parts = [part for part in path.split("/") if part not in ("", ".")]
        if name:
            if ".." in parts:
                return None
            folder = self.model(name, asker)
            return None if folder is None else self.keep(_walk(folder, parts), asker)
        if path.startswith("/"):
            found = Path(path) if os.path.lexists(path) else None
        else:
            found = _walk(asker.parent, parts) or _walk(self.source.parent, parts)
        return self.keep(found, asker)

    def model(self, name: str, asker: Path) -> Path | None:
        """The folder of a model that a file names."""
        key = name.lower()
        if key not in self._models:
            self._models[key] = self._search(name, asker)
        return self._models[key]

    def sdf(self, place: Path) -> Path | None:
        """The SDF file of a model: the newest one of its `model.config`, or any."""
        if is_regular(place):
            return place
        manifest = self.keep(_walk(place, ["model.config"]), self.source)
        if manifest is not None:
            try:
                root = read_xml(manifest, limit=1 << 20).root
            except MapImportError as error:
                self.context.findings.warn(place.name, str(error))
            else:
                named = sorted(root.all("sdf"), key=lambda node: _version(node.get("version")))
                for node in reversed(named):
                    found = _walk(place, [node.text])
                    if found is not None and is_regular(found):
                        return self.keep(found, manifest)
        found = _walk(place, ["model.sdf"])
        if found is None:
            found = next((path for path in _entries(place) if path.suffix == ".sdf"), None)
        return self.keep(found, self.source)

    def keep(self, found: Path | None, asker: Path) -> Path | None:
        """Note what was found for a file; None if it may not be read."""
        if found is None or not self.context.admit(found, asker):
            return None
        if is_regular(found):
            self.files.append(found)
        return found

    # ---- searching -------------------------------------------------------------------------

    def _roots(self) -> Iterator[Path]:
        here = self.source.parent
        for folder in (here, here.parent, *self.context.options.assets, *gazebo_folders()):
            yield folder
            yield folder / "models"

    def _search(self, name: str, asker: Path) -> Path | None:
        if not name or name in (".", ".."):
            return None
        outside: Path | None = None
        for root in self._roots():
            found = _walk(root, [name])
            if found is not None and found.is_dir():
                if self.context.confined().admit(found):
                    return found
                outside = outside or found
        if self._deep is None:
            self._deep = {}
            for folder in _below(self.context.options.assets):
                self._deep.setdefault(folder.name.lower(), folder)
        inside = self._deep.get(name.lower())
        return inside or self.keep(outside, asker)


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".") if part.isdigit() and len(part) < 9)


def _walk(folder: Path, parts: list[str]) -> Path | None:
    """A path below a folder, without regard to case."""
    place = folder
    for part in parts:
        direct = place / part
        try:
            if direct.exists():
                place = direct
                continue
        except (OSError, ValueError):
            return None
        wanted = part.lower()
        found = next((path for path in _entries(place) if path.name.lower() == wanted), None)
        if found is None:
            return None
        place = found
    return place


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir()) if folder.is_dir() else []
    except OSError:
        return []


def _below(folders: tuple[Path, ...]) -> Iterator[Path]:
    """Folders with a model, nearest first."""
    count = 0
    level = list(folders)
    for _ in range(MAX_DEPTH):
        deeper = []
        for folder in level:
            for path in _entries(folder):
                if path.is_dir() and not path.is_symlink():
                    count += 1
                    if count > MAX_FOLDERS:
                        return
                    deeper.append(path)
                    if any(is_regular(path / name) for name in ("model.config", "model.sdf")):
                        yield path
        level = deeper
