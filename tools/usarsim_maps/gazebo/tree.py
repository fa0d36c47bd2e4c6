"""All that lies below some folders, found by the end of its path."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

from usarsim_maps.files import MAX_INDEXED
from usarsim_server.files import is_regular, read_regular

Kind: TypeAlias = Callable[[Path], bool]
"""What is wanted: a file, a model, anything."""

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
    return any(path.name == "model.config" or path.suffix == ".sdf" for path in inside)


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

        Args:
            parts: the path.
            asker: the file that asks; among equals what is nearest to it is taken.
            wanted: what it has to be.
            exact: the whole path has to agree, for it begins with the name of a model or package.
                Else as much as possible, but never only names that all models have; the name of a
                file alone will do where there is one such file, or one near the asker.
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
