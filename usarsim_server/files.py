"""Files that others wrote: which may be read, and reading them without waiting for ever.

A map, a robot file or a scene names further files. Whoever wrote it may be a stranger, so it
decides nothing about this computer: what it names is read only from folders that the user gave
(`Folders`), and only from regular files of bounded size. A named pipe or a device would make its
reader wait for ever, or give bytes without end.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable
from io import BufferedReader
from pathlib import Path

__all__ = [
    "ALLOW",
    "MAX_TEXT",
    "Folders",
    "is_folder",
    "is_regular",
    "open_regular",
    "read_regular",
    "reason",
]

MAX_TEXT = 16 << 20
"""Bytes of a file that people write: settings, robots, worlds. The largest known, the sheet of an
imported town, has 1.1 MB."""

ALLOW = "name its folder with --assets DIR, or give --allow-outside"
"""What lets a map read a file that lies elsewhere."""

_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
}


def open_regular(path: Path) -> BufferedReader:
    """Open a regular file for reading; never waits.

    Raises:
        OSError: there is no such file, its name is impossible, or it is a pipe, a device or a
            folder.
    """
    try:
        # Without O_NONBLOCK, to open a pipe is to wait for somebody who writes into it.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except ValueError:  # a NUL in the name
        raise OSError(errno.EINVAL, "no file can have this name", str(path)) from None
    except OSError as error:
        if error.errno == errno.ENXIO:  # what a socket answers
            raise OSError(errno.ENXIO, "it is a socket, no regular file", str(path)) from None
        raise
    try:
        mode = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode):
            kind = _KINDS.get(stat.S_IFMT(mode), "something else")
            raise OSError(errno.EINVAL, f"it is {kind}, no regular file", str(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: Path, limit: int = MAX_TEXT) -> bytes:
    """A whole regular file.

    Raises:
        OSError: see `open_regular`; or it is longer than so many bytes.
    """
    with open_regular(path) as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise OSError(errno.EFBIG, f"it is larger than {limit / 2**20:.3g} MiB", str(path))
    return content


def is_regular(path: Path) -> bool:
    """Whether a regular file is there; impossible names are none."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether a folder is there; impossible names are none."""
    try:
        return stat.S_ISDIR(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def reason(error: OSError) -> str:
    """What is wrong with a file, in a few words."""
    return error.strerror or str(error)


class Folders:
    """The folders out of which a map, a world or a robot may read."""

    def __init__(self, folders: Iterable[Path], *, allow_outside: bool = False) -> None:
        """Take folders, with everything below them.

        Args:
            folders: that the user gave.
            allow_outside: everything may be read, wherever it lies.
        """
        self._folders = tuple(_real(folder) for folder in folders)
        self._everywhere = allow_outside

    def with_more(self, folders: Iterable[Path]) -> Folders:
        """These folders and others."""
        both = Folders(folders, allow_outside=self._everywhere)
        both._folders += self._folders
        return both

    def admit(self, path: Path) -> bool:
        """Whether a path lies inside, once all symbolic links in it are followed."""
        if self._everywhere:
            return True
        place = _real(path)
        return any(place == folder or folder in place.parents for folder in self._folders)

    def refusal(self, path: Path | str, asker: Path) -> str | None:
        """Why a file is not read, naming it and the file that asks; None if it may be."""
        if self.admit(Path(path)):
            return None
        return f"{asker.name} asks for {str(path)[:300]!r}, which lies outside the given folders"


def _real(path: Path) -> Path:
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError):  # too long, or with a NUL: no file can lie there
        return Path(os.devnull)
