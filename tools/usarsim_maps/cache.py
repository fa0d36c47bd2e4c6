"""Imported worlds are kept, under a key made of everything that went into them.

A key covers the bytes of the map and of its sidecar, the options, the listing of asset folders
and the version of this program; an entry also names every other file that was read, with size and
time of change (worlds 67, 68).
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from usarsim_maps.files import MAX_INDEXED, file_digest
from usarsim_maps.reader import ImportOptions
from usarsim_server import __version__
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.files import locked, publish_folder, read_regular
from usarsim_server.protocol.json_text import parse_json

FORMAT = 6
"""Raise it when the same map would give another world."""

KEPT = 32
"""Imported worlds that are kept; older ones go."""

RECORD = "import.json"

MAX_RECORD = 64 << 20
"""Bytes of a record; it names every file that was read."""

LOCK = ".in-use"
"""A file of each entry, locked by every process that needs the entry as it is."""

DOOR = ".lock"
"""A file of the cache, locked by whoever changes which entries there are."""

_held: list[int] = []
"""Descriptors of such locks; they end with this process."""


def default_cache() -> Path:
    """`$XDG_CACHE_HOME/usarsim/imports`, by default below `~/.cache`."""
    root = os.environ.get("XDG_CACHE_HOME")
    with contextlib.suppress(RuntimeError):
        return Path(root or Path.home() / ".cache") / "usarsim" / "imports"
    return Path(tempfile.gettempdir()) / f"usarsim-{os.getuid()}" / "imports"


class ImportCache:
    """Folders `<root>/<key>/<name>`, each a whole world with its record."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def key(self, source: Path, sidecar: Path | None, options: ImportOptions, name: str) -> str:
        """The key of an import; `MapImportError` if a file cannot be read."""
        digest = hashlib.sha256()
        said = [__version__, FORMAT, str(source), name, options.scale, options.up]
        said += [options.mirror, options.placeholders, options.wall_height, options.allow_outside]
        said += [options.limits.pieces, options.limits.memory]
        digest.update(json.dumps(said).encode())
        for path in (source, sidecar):
            digest.update(b"\0" if path is None else file_digest(path))
        for folder in options.assets:
            for line in _listing(folder):
                digest.update(line.encode(errors="replace"))
        return digest.hexdigest()[:32]

    def find(self, key: str, name: str) -> tuple[Path, dict[str, Any]] | None:
        """The folder and the record of an entry that is still true, else None."""
        for place in self._places(key):
            folder = place / name
            try:
                record = parse_json(read_regular(folder / RECORD, MAX_RECORD))
                if all(_stamp(Path(path)) == stamp for path, stamp in record["files"].items()):
                    os.utime(place)
                    return folder, record
            except (OSError, ValueError, KeyError, TypeError, AttributeError):
                pass
        return None

    @contextlib.contextmanager
    def changing(self) -> Iterator[None]:
        """While inside, no other process adds or removes entries; needed to find and hold one."""
        try:
            self._root.mkdir(parents=True, exist_ok=True)
            descriptor = locked(self._root / DOOR, fcntl.LOCK_EX)
        except OSError:  # a cache that cannot be written is never changed
            yield
            return
        try:
            yield
        finally:
            os.close(descriptor)

    def hold(self, folder: Path) -> int | None:
        """Keep an entry as it is until this process ends, or until `release`.

        A running server reads its world again whenever a robot of another class comes.
        """
        descriptor = _lock(folder.parent, fcntl.LOCK_SH)
        if descriptor is not None:
            _held.append(descriptor)
        return descriptor

    def release(self, descriptor: int | None) -> None:
        """End what `hold` returned."""
        if descriptor in _held:
            _held.remove(descriptor)
            os.close(descriptor)

    def _places(self, key: str) -> list[Path]:
        """Folders of a key, newest first; there are several if older ones were in use."""
        return sorted(self._root.glob(f"{key}*"), key=_age, reverse=True)

    @contextlib.contextmanager
    def building(self, source: Path) -> Any:
        """A fresh folder to build in, next to the entries; gone afterwards.

        Those of processes that were killed are removed, too. `MapImportError` if the cache cannot
        be written.
        """
        try:
            self._root.mkdir(parents=True, exist_ok=True)
            with self.changing():
                for left in self._root.glob(".new-*"):
                    if not _in_use(left):
                        shutil.rmtree(left, ignore_errors=True)
                workshop = Path(tempfile.mkdtemp(prefix=".new-", dir=self._root))
                lock = _lock(workshop, fcntl.LOCK_EX)
        except OSError as error:
            cure = "set XDG_CACHE_HOME to a folder that can be written"
            problem = f"the cache {self._root} cannot be written: {error.strerror}"
            raise MapImportError(at(source, problem, cure)) from error
        try:
            yield workshop
        finally:
            shutil.rmtree(workshop, ignore_errors=True)
            if lock is not None:
                os.close(lock)

    def store(self, key: str, built: Path, record: dict[str, Any], files: Iterable[Path]) -> Path:
        """Make a folder of `building` an entry, whole; returns where it is now.

        To be called within `changing`; `OSError` if the disk is full, for example.
        """
        record = {**record, "files": {str(path): _stamp(path) for path in files}}
        text = json.dumps(record, indent=1, default=str)
        (built / RECORD).write_text(text + "\n", encoding="utf-8")
        place, number = self._root / key, 1
        while _in_use(place):
            place, number = self._root / f"{key}-{number}", number + 1
        entry = built.with_name(".entry")
        entry.mkdir()
        os.rename(built, entry / built.name)
        publish_folder(entry, place)
        self._prune(place)
        return place / built.name

    def _prune(self, newest: Path) -> None:
        """Remove the oldest entries, but never the newest, whatever the clock has done."""
        entries = [path for path in self._root.iterdir() if not path.name.startswith(".")]
        entries.sort(key=lambda path: (path == newest, _age(path)), reverse=True)
        for path in entries[KEPT:]:
            if not _in_use(path):
                shutil.rmtree(path, ignore_errors=True)


def _age(place: Path) -> float:
    """Time of the last use; 0 for what another process has just removed."""
    try:
        return place.stat().st_mtime
    except OSError:
        return 0.0


def _lock(place: Path, kind: int) -> int | None:
    """The descriptor of a lock on an entry; None if there can be none."""
    try:
        return locked(place / LOCK, kind | fcntl.LOCK_NB)
    except OSError:
        return None


def _in_use(place: Path) -> bool:
    """Whether a process, this one included, holds an entry."""
    try:
        os.close(locked(place / LOCK, flags=0))
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _stamp(path: Path) -> list[int]:
    """Size and time of change; zeros for what is not there."""
    try:
        found = path.stat()
    except OSError:
        return [0, 0]
    return [found.st_size, found.st_mtime_ns]


def _listing(folder: Path) -> Iterable[str]:
    """Every file below a folder with its stamp."""
    count = 0
    for parent, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(files):
            count += 1
            if count > MAX_INDEXED:
                return
            path = Path(parent, name)
            yield f"{path}{_stamp(path)}\n"
