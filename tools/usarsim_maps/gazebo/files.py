"""Where Gazebo's URIs lead: models, meshes and pictures on this computer.

They are looked for where Gazebo looks, and then, by the end of their path, anywhere below some
folders.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias
from urllib.parse import unquote

from usarsim_maps.files import MAX_INDEXED
from usarsim_maps.meshes.xml_text import Node, read_xml
from usarsim_maps.reader import Context
from usarsim_server.base.errors import MapImportError
from usarsim_server.base.files import is_regular, read_regular

Kind: TypeAlias = Callable[[Path], bool]
"""What is wanted: a file, a model, anything."""

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

MODELS = (".sdf", ".urdf")
"""Files of models, those with precedence first."""

BUILTIN = ("sun", "ground_plane")
"""Models that Gazebo brings along."""

_FUEL = re.compile(
    r"^(?:https?|fuel)://[^?#]*?(?:([^/?#]+)/)?(?:fuel/)?models/([^/?#]+)"
    r"(?:/(tip|\d+))?(?:/files)?(?:/([^?#]*))?(?:[?#].*)?$",
    re.I,
)
"""Addresses of models: owner, name, version, path in the model."""

_DATABASE = re.compile(r"^https?://models\.gazebosim\.org/([^/?#]+)(?:/([^?#]*))?$", re.I)
"""Addresses of the models of old versions of Gazebo."""

_BLANK = re.compile(r"[\s_+-]+")
"""Between the words of a model's name, which programs write in different ways."""

MAX_FOLDERS = 100_000

MAX_MANIFEST = 1 << 20

COMMON = {
    "base_link", "body", "collision", "materials", "media", "mesh", "meshes", "model", "models",
    "scene", "scripts", "share", "src", "textures", "untitled", "visual", "worlds",
}  # fmt: skip
"""Names of folders and files that any model or package has: that they agree says nothing."""

_PACKAGE = re.compile(rb"<name>\s*([\w.-]+)\s*</name>")


def entries(folder: Path) -> list[Path]:
    """What is in a folder, sorted; nothing if there is no such folder."""
    try:
        return sorted(folder.iterdir()) if folder.is_dir() else []
    except OSError:
        return []


def walk(folder: Path, parts: Sequence[str]) -> Path | None:
    """A path below a folder, without regard to case; versions of a model may be left out."""
    place = folder
    for part in parts:
        found = _inside(place, part)
        if found is None and (newest := newest_version(place)) != place:
            found = _inside(newest, part)
        if found is None:
            return None
        place = found
    return place


def _inside(place: Path, part: str) -> Path | None:
    direct = place / part
    try:
        if direct.exists():
            return direct
    except (OSError, ValueError):
        return None
    wanted = part.lower()
    return next((path for path in entries(place) if path.name.lower() == wanted), None)


def newest_version(place: Path) -> Path:
    """The folder of the newest version, as downloads of models have them; else the place itself."""
    if (place / "model.config").exists() or (place / "model.sdf").exists():
        return place
    numbered = [path for path in entries(place) if _is_version(path.name) and path.is_dir()]
    return max(numbered, key=lambda path: int(path.name), default=place)


def _is_version(name: str) -> bool:
    return name.isascii() and name.isdigit() and len(name) < 5


def holds_model(place: Path) -> bool:
    """Whether a path is a file, or the folder of a model."""
    if is_regular(place):
        return True
    inside = entries(newest_version(place))
    return any(path.name == "model.config" or path.suffix in MODELS for path in inside)


class FolderTree:
    """Files and folders below some folders, these included; nearest first, links not followed."""

    def __init__(self, folders: Iterable[Path], most: int = MAX_FOLDERS) -> None:
        """Look through the folders at the first question, at no more than `most` of them."""
        self._folders = tuple(folders)
        self._most = most
        self._by_name: dict[str, list[Path]] | None = None
        self._packages: dict[str, Path] = {}

    def find(self, parts: Sequence[str], asker: Path, wanted: Kind, *, exact: bool) -> Path | None:
        """What lies at a path that ends so, capitals and numbers of versions aside.

        Among equals that are what is wanted, what is nearest to the asker is taken. If `exact`, the
        whole path has to agree, for it begins with the name of a model or package. Else as much as
        possible, but never only names that all models have; the name of a file alone will do where
        there is one such file, or one near the asker.
        """
        names = self._index()
        plain = [part.lower() for part in parts if part != ".."]
        if not plain:
            return None
        if exact and plain[0] in self._packages:
            found = walk(self._packages[plain[0]], parts[1:])
            if found is not None and wanted(found):
                return found
        rated: dict[int, list[Path]] = {}
        for path in names.get(plain[-1], ()):
            rated.setdefault(_agreement(path, plain), []).append(path)
        best = 0
        chosen: list[Path] = []
        for best in sorted(rated, reverse=True):
            chosen = [path for path in rated[best] if wanted(path)]
            if chosen or exact:
                break
        if not chosen or (exact and best < len(plain)):
            return None
        told = plain[-best:] if chosen[0].is_dir() else plain[-best:-1]
        if exact or set(told) - COMMON:
            return max(chosen, key=lambda path: _common(path, asker))
        near = [path for path in chosen if asker.parent in path.parents] or chosen
        return near[0] if len(near) == 1 and near[0].stem.lower() not in COMMON else None

    def _index(self) -> dict[str, list[Path]]:
        if self._by_name is None:
            self._by_name = {}
            for number, path in enumerate(self._walk()):
                if number >= MAX_INDEXED:
                    break
                self._by_name.setdefault(path.name.lower(), []).append(path)
                if path.name == "package.xml":
                    self._packages.setdefault(_package(path), path.parent)
        return self._by_name

    def _walk(self) -> Iterator[Path]:
        level: list[Path] = list(self._folders)
        yield from level
        count = 0
        while level:
            deeper: list[Path] = []
            for folder in level:
                count += 1
                if count > self._most:
                    return
                try:
                    with os.scandir(folder) as found:
                        inside = sorted(found, key=lambda entry: entry.name)
                except OSError:
                    continue
                for entry in inside:
                    if entry.name.startswith("."):
                        continue
                    path = folder / entry.name
                    yield path
                    if entry.is_dir(follow_symlinks=False):
                        deeper.append(path)
            level = deeper


def _agreement(path: Path, parts: Sequence[str]) -> int:
    """How many parts at the ends agree; versions in the path do not count."""
    score = 0
    for part in reversed(path.parts):
        if score == len(parts):
            break
        if part.lower() == parts[-1 - score]:
            score += 1
        elif not _is_version(part):
            break
    return score


def _common(path: Path, other: Path) -> int:
    """Number of folders that two paths begin with alike."""
    same = 0
    for one, two in zip(path.parts, other.parts, strict=False):
        if one != two:
            break
        same += 1
    return same


def _package(manifest: Path) -> str:
    """Name of a ROS package, in small letters; empty if its file does not tell."""
    try:
        found = _PACKAGE.search(read_regular(manifest, MAX_MANIFEST))
    except OSError:
        return ""
    return "" if found is None else found[1].decode("latin-1").lower()


def model_name(uri: str) -> str:
    """The name of the model that a URI of an include means."""
    address = address_of(uri)
    if address.name:
        return address.name
    last = address.path.rstrip("/").rpartition("/")
    is_file = last[2].lower().endswith((".sdf", ".config", ".urdf"))
    return last[0].rpartition("/")[2] if is_file else last[2]


def builtin_name(name: str) -> str:
    """The name of a model as those of `BUILTIN` are written: `Ground Plane` is `ground_plane`."""
    return _BLANK.sub("_", name.strip().lower())


@dataclass(frozen=True, slots=True)
class Address:
    """The parts of a URI."""

    name: str  # of a model or package; empty if the URI is a path
    path: str  # in the model, or the whole
    owner: str = ""  # of the model on a server
    version: str = ""

    def ways(self) -> Iterator[list[str]]:
        """Paths that may lead there, the most exact first."""
        rest = [part for part in self.path.split("/") if part not in ("", ".")]
        if not self.name:
            yield rest
            return
        owned = [[self.owner, "models"], []] if self.owner else [[]]
        versions = [[self.version], []] if self.version.isdigit() else [[]]
        for name in _spellings(self.name):
            for owner in owned:
                for version in versions:
                    yield [*owner, name, *version, *rest]


def _spellings(name: str) -> list[str]:
    """A model's name as programs write it: with blanks, underscores or dashes, or in one word."""
    words = [word for word in _BLANK.split(name) if word]
    return list(dict.fromkeys([name, *(sign.join(words) for sign in (" ", "_", "-", ""))]))


def address_of(uri: str) -> Address:
    """The parts of a URI, with `%20` and the like undone."""
    uri = unquote(uri.strip()).replace("\\", "/").replace("\0", "")[:1000]
    fuel = _FUEL.match(uri)
    if fuel is not None:
        owner, name, version, path = (part or "" for part in fuel.groups())
        return Address(name.strip(), path, owner, version)
    database = _DATABASE.match(uri)
    if database is not None:
        return Address(database[1], database[2] or "")
    scheme, _, rest = uri.partition("://")
    if scheme.lower() in ("model", "package") and rest:
        name, _, path = rest.strip("/").partition("/")
        return Address(name.strip(), path)
    if scheme.lower() == "file" and rest:
        return Address("", rest)
    return Address("", uri)


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
    """

    source: Path  # the world
    context: Context
    files: list[Path] = field(default_factory=list)  # everything that was found

    _found: dict[tuple[str, Path, Kind], Path | None] = field(default_factory=dict)
    _trees: list[FolderTree] = field(default_factory=list)

    def find(self, uri: str, asker: Path) -> Path | None:
        """What a URI in the file `asker` names; None if it is missing or, a finding, forbidden."""
        return self._known(uri, asker, os.path.lexists)

    def file(self, uri: str, asker: Path) -> Path | None:
        """A regular file, as `find`."""
        return self._known(uri, asker, is_regular)

    def model(self, uri: str, asker: Path) -> Path | None:
        """The SDF file of the model that an include means, as `find`."""
        place = self._known(uri, asker, holds_model)
        return None if place is None else self.sdf(place)

    def sdf(self, place: Path) -> Path | None:
        """The SDF or URDF file of a model: the newest one of its `model.config`, or any."""
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
                named = [*root.all("sdf"), *root.all("urdf")]
                for node in sorted(named, key=_newest, reverse=True):
                    found = walk(place, [node.text])
                    if found is not None and is_regular(found):
                        return self.keep(found, manifest)
        found = walk(place, ["model.sdf"])
        if found is None:
            inside = entries(place)
            files = [path for suffix in MODELS for path in inside if path.suffix == suffix]
            found = next(iter(files), None)
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
        address = address_of(uri)
        outside: Path | None = None
        ways = [way for way in address.ways() if way]
        if not ways or (address.name and ".." in ways[0]):
            return None
        for way in ways:
            for found in self._usual(way, asker, "" if address.name else address.path):
                if not wanted(found):
                    continue
                if self.context.confined().admit(found):
                    return found
                outside = outside or found
        for tree in self._below():
            for way in ways:
                found_below = tree.find(way, asker, wanted, exact=bool(address.name))
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


def _newest(node: Node) -> tuple[bool, tuple[int, ...]]:
    """Order of the files that a model has: SDF after URDF, then by version."""
    return node.tag == "sdf", _version(node.get("version"))


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".") if part.isdigit() and len(part) < 9)
