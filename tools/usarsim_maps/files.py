"""Reading files of unknown origin with bounded memory, and finding those that a map names.

A file that cannot be read, or is too large, is a `MapImportError`.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import itertools
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING
from urllib.parse import unquote

from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.files import Folders, is_regular, open_regular, reason

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

MAX_BYTES = 1 << 30
"""Largest map or mesh file that is read; the largest known map of the leagues has 60 MB."""

MAX_INDEXED = 200_000
"""Files that are looked at in asset folders."""

MAX_NAME = 4096
"""Characters of a path in a map that are looked at; no system has longer ones."""

HEAD = 4096

MAX_PIXELS = 64 << 20
"""Larger pictures are not opened: 64 megapixels take 192 MB."""

FORMATS = ("PNG", "JPEG", "TGA", "DDS", "BMP", "TIFF", "WEBP", "GIF", "PPM")  # JPEG brings MPO
"""That are decoded, whatever the name says. Pillow knows some that start other programs."""

USUAL = {"meshes", "staticmeshes", "textures", "materials", "models", "assets", "images"}
"""Folders beside a map that are searched without being told."""


@contextlib.contextmanager
def opened(path: Path, limit: int | None = None) -> Iterator[io.BufferedReader]:
    """A file while it is open, if it is not larger than the limit."""
    try:
        with open_regular(path) as file:
            if limit is not None:
                check_size(path, os.fstat(file.fileno()).st_size, limit)
            yield file
    except OSError as error:
        problem = f"cannot be read: {reason(error)}"
        raise MapImportError(at(path, problem, "check the path")) from error


def read_head(path: Path) -> bytes:
    """The first 4 KiB of a file."""
    with opened(path) as file:
        return file.read(HEAD)


def read_bytes(path: Path, limit: int = MAX_BYTES) -> bytes:
    """A whole file, or a refusal if it is larger than the limit."""
    with opened(path, limit) as file:
        # Python takes memory for as many bytes as it is asked for.
        content = file.read(min(limit, os.fstat(file.fileno()).st_size) + 1)
    check_size(path, len(content), limit)
    return content


def check_size(path: Path, size: int, limit: int = MAX_BYTES) -> None:
    """Refuse a file that is too large, before anybody reads it."""
    if size > limit:
        problem = f"larger than {limit >> 20} MiB"
        raise MapImportError(at(path, problem, "export the map in smaller parts"))


def file_digest(path: Path, limit: int = MAX_BYTES) -> bytes:
    """SHA-256 of a file, read in pieces."""
    with opened(path, limit) as file:
        return hashlib.file_digest(file, "sha256").digest()


def read_text(path: Path, limit: int = MAX_BYTES) -> str:
    """A text file in UTF-8, UTF-16 (with or without mark) or Latin-1; line ends become LF."""
    content = read_bytes(path, limit)
    return decode(content).replace("\r\n", "\n").replace("\r", "\n")


def decode(content: bytes) -> str:
    """Text of bytes in UTF-8, UTF-16 or Latin-1, whatever they are."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    if content[1:2] == b"\0" and content[3:4] == b"\0":
        return content.decode("utf-16-le", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


@contextlib.contextmanager
def open_picture(source: Path | bytes, name: str, most: int = MAX_PIXELS) -> Iterator[Picture]:
    """A picture while it is open; its pixels are not decoded before somebody asks for them.

    Given a file, or what is in it, and a name for errors: a `MapImportError` if it cannot be
    opened, has more than `most` pixels, or, while it is open, is damaged.
    """
    from PIL import Image

    cure = "save it again as PNG"
    try:
        with (
            warnings.catch_warnings(),
            io.BytesIO(source) if isinstance(source, bytes) else open_regular(source) as file,
            Image.open(file, formats=FORMATS) as image,
        ):
            warnings.simplefilter("ignore")
            if image.width * image.height > most:
                problem = f"{image.width} x {image.height} pixels are too many"
                raise MapImportError(at(name, problem, "reduce the picture"))
            yield image
    except MapImportError:
        raise
    except Image.DecompressionBombError:
        raise MapImportError(at(name, "far too many pixels", "reduce the picture")) from None
    except Exception as error:  # Pillow's decoders raise whatever they like
        text = f"the picture cannot be read ({type(error).__name__}: {error})"
        raise MapImportError(at(name, " ".join(text.split())[:300], cure)) from None


class AssetIndex:
    """Files below some folders, found by name without regard to case or lost directories."""

    def __init__(
        self,
        folders: Iterable[Path],
        beside: Path | None = None,
        admit: Callable[[Path], bool] | None = None,
    ) -> None:
        """Look through the folders, and all below them, at the first question, not now.

        The folder of the map `beside` is searched too, but of what is below only folders with the
        usual names, for a map may lie in somebody's home. `admit` says whether a file may be read;
        by default those in the folders may, links followed.
        """
        self._folders = tuple(dict.fromkeys(Path(folder) for folder in folders))
        self._near = () if beside is None else tuple(_usual_folders(beside.parent))
        self._admit = admit or Folders([*self._folders, *self._near]).admit
        self._by_name: dict[str, list[Path]] | None = None

    def find(self, name: str, extensions: Sequence[str] = ()) -> Path | None:
        """A file by the name that a map gives.

        Args:
            name: path in any style (`C:\\\\tex\\\\a.tga`, `file:///a%20b.png`, `textures/a.jpg`),
                with or without extension.
            extensions: tried in this order in place of or behind the written one.
        """
        found = self._search(name, extensions)
        return found if found is not None and self._admit(found) else None

    def _search(self, name: str, extensions: Sequence[str]) -> Path | None:
        plain = _plain(name)
        for folder in (*self._folders, *self._near):
            direct = folder / plain
            if plain and is_regular(direct):
                return direct
        last = PurePosixPath(plain).name.lower()
        if not last:
            return None
        wanted = [last, *(last + ext for ext in extensions)]
        stem = PurePosixPath(last).stem
        wanted += [stem + ext for ext in extensions]
        found = self._index()
        for candidate in wanted:
            if candidate in found:
                return _nearest(found[candidate], plain)
        return None

    def _index(self) -> dict[str, list[Path]]:
        if self._by_name is None:
            self._by_name = {}
            deep = (path for folder in self._folders for path in _below(folder))
            flat = (path for folder in self._near for path in _inside(folder))
            for path in itertools.islice(itertools.chain(deep, flat), MAX_INDEXED):
                self._by_name.setdefault(path.name.lower(), []).append(path)
        return self._by_name


def _usual_folders(folder: Path) -> Iterator[Path]:
    """A map's folder and those below it where exporters put meshes and pictures."""
    yield folder
    for path in _sorted(folder):
        if path.is_dir() and path.name.lower() in USUAL:
            yield path


def _below(folder: Path) -> Iterator[Path]:
    """All files below a folder, folder by folder in order; links are not followed."""
    for parent, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(files):
            yield Path(parent, name)


def _inside(folder: Path) -> Iterator[Path]:
    """All files of a folder."""
    yield from (path for path in _sorted(folder) if is_regular(path))


def _sorted(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _plain(name: str) -> str:
    """A relative path with forward slashes."""
    name = name[:MAX_NAME].strip().strip('"')
    for scheme in ("file://", "model://", "package://"):
        if name.lower().startswith(scheme):
            name = name[len(scheme) :]
    if "%" in name:
        name = unquote(name)
    windows = PureWindowsPath(name)
    parts = [part for part in windows.parts if part not in (windows.anchor, "..", ".", "/")]
    return "/".join(parts)


def _nearest(paths: Sequence[Path], wanted: str) -> Path:
    """Of files with the same name the one that shares most folder names with the wanted path."""
    folders = {part.lower() for part in PurePosixPath(wanted).parts[:-1]}
    return max(paths, key=lambda path: len(folders & {part.lower() for part in path.parts[:-1]}))
