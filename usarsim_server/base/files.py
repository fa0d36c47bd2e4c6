"""Files: which of others may be read, how ours are written whole, where the shipped ones lie.

A map, a robot file or a scene names further files. Whoever wrote it may be a stranger, so it
decides nothing about this computer: what it names is read only from folders that the user gave
(`Folders`), and only from regular files of bounded size. A named pipe or a device would make its
reader wait for ever, or give bytes without end.

Files and folders that we write are there whole or not at all. What is new is written beside its
place, under another name, handed over to the disk, and only then given its name, in one step of the
file system (rename(2)). A program that is killed, or a disk that is full, leaves what was there
before; at most a hidden file with `.new-` in its name stays behind.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import os
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO, Literal

from usarsim_server.base.errors import UsarsimError, at, plain

MAX_TEXT = 16 << 20
"""Bytes of a file that people write: settings, robots, worlds. The largest known, the sheet of an
imported town, has 1.1 MB."""

ALLOW = "name its folder with --assets DIR, or give --allow-outside"
"""What lets a map read a file that lies elsewhere."""

COPY = "put a copy in its place"
"""What to do about a link that is not followed."""

_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
}


def open_regular(path: Path | str) -> BufferedReader:
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


def is_regular(path: Path | str) -> bool:
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


def named(text: str) -> str:
    """A name that stands in the text of a file, as this system takes it.

    In the C locale it takes other letters than those of ASCII as the bytes of UTF-8.
    """
    try:
        os.fsencode(text)
    except UnicodeEncodeError:
        return os.fsdecode(text.encode("utf-8", "surrogateescape"))
    return text


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

    def admit(self, path: Path | str) -> bool:
        """Whether a path lies inside, once all symbolic links in it are followed."""
        if self._everywhere:
            return True
        place = _real(path)
        return any(place.startswith(folder) for folder in self._folders)

    def refusal(self, path: Path | str, asker: Path) -> str | None:
        """Why a file is not read, naming it and the file that asks; None if it may be."""
        if self.admit(path):
            return None
        return f"{asker.name} asks for {str(path)[:300]!r}, which lies outside the given folders"


def check_links(folder: Path, error: type[UsarsimError]) -> None:
    """Refuse a folder that somebody may have sent, if a symbolic link in it leads out of it.

    Raises:
        error: naming the link.
    """
    inside = Folders([folder])
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(parent, name)
            if path.is_symlink() and not inside.admit(path):
                raise error(at(path, "is a link that leads out of its folder", COPY))


@contextlib.contextmanager
def held(folder: Path) -> Iterator[bool]:
    """Hold a folder for this program; gives False if another program holds it.

    The system releases the folder when this program ends, however it ends.

    Raises:
        OSError: it cannot be held.
    """
    try:
        file = locked(folder / ".held")
    except BlockingIOError:
        yield False
        return
    try:
        yield True
    finally:
        os.close(file)


def locked(path: Path, how: int = fcntl.LOCK_EX | fcntl.LOCK_NB, flags: int = os.O_CREAT) -> int:
    """Open and lock a file; the lock holds until its descriptor is closed, however that happens.

    Args:
        path: of the file. how: see flock(2). flags: to open it with; by default it is made.

    Returns:
        its descriptor.

    Raises:
        BlockingIOError: another program has it locked. OSError: it cannot be opened or locked.
    """
    file = os.open(path, os.O_RDWR | os.O_CLOEXEC | flags, 0o666)
    try:
        fcntl.flock(file, how)
    except OSError:
        os.close(file)
        raise
    return file


def _real(path: Path | str) -> str:
    """A path without symbolic links, with a separator at its end."""
    try:
        return os.path.join(os.path.realpath(path), "")
    except (OSError, ValueError):  # too long, or with a NUL: no file can lie there
        return os.path.join(os.devnull, "")


_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
"""renameat2(2): the two names change places."""


@contextlib.contextmanager
def replacing(path: Path, *, private: bool = False) -> Iterator[BinaryIO]:
    """A file to write to; at the end of the block, if all went well, it becomes that of the path.

    What is no regular file (a terminal, a pipe) is written to directly.

    Args:
        path: of the file.
        private: others may not read it, whatever it was before.

    Raises:
        OSError: it cannot be written; what was there before still is.
    """
    path = Path(os.path.realpath(path))
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        mode = None
    if mode is not None and not stat.S_ISREG(mode):
        with path.open("wb") as file:
            yield file
        return
    fresh = path.with_name(f".new-{secrets.token_hex(8)}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    descriptor = os.open(fresh, flags, 0o600 if private else 0o666)
    try:
        with os.fdopen(descriptor, "wb") as file:
            if mode is not None and not private:
                os.fchmod(descriptor, stat.S_IMODE(mode))
            yield file
            file.flush()
            os.fsync(descriptor)
        os.replace(fresh, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(fresh)
        raise
    _sync(path.parent)


def write_bytes(path: Path, data: bytes, *, private: bool = False) -> None:
    """Replace a file; see `replacing`.

    Raises:
        OSError: see `replacing`.
    """
    with replacing(path, private=private) as file:
        file.write(data)


def write_text(path: Path, text: str, *, private: bool = False) -> None:
    """Replace a file with text in UTF-8, also where paths of other letters stand in it.

    Raises:
        OSError: see `replacing`.
    """
    write_bytes(path, plain(text).encode(), private=private)


def publish_folder(fresh: Path, target: Path) -> None:
    """Let a finished folder take the place of another one, or of none; the other one is removed.

    Args:
        fresh: the folder, on the file system of the target.
        target: the name that it gets.

    Raises:
        OSError: it cannot be; what was there before still is.
    """
    _sync_folder(fresh)
    if not os.path.lexists(target):
        os.rename(fresh, target)
    elif _exchange(fresh, target):
        shutil.rmtree(fresh, ignore_errors=True)
    else:
        old = target.with_name(f".new-{secrets.token_hex(8)}")
        os.rename(target, old)
        os.rename(fresh, target)
        shutil.rmtree(old, ignore_errors=True)
    _sync(target.parent)


def _sync_folder(folder: Path) -> None:
    """Hand a folder and all that is in it over to the disk.

    Raises:
        OSError: the disk is full, for example.
    """
    for parent, _, files in os.walk(folder):
        for name in files:
            _sync(Path(parent, name))
        _sync(Path(parent))


def _exchange(one: Path, other: Path) -> bool:
    """Let two names change places in one step; False where the file system cannot."""
    try:
        renameat2 = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    names = os.fsencode(one), os.fsencode(other)
    found: int = renameat2(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE)
    return found == 0


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


_PACKAGE = Path(__file__).resolve().parents[1]


def data_directory(kind: Literal["worlds", "robots"]) -> Path:
    """Return the folder of shipped data.

    An installed wheel carries it inside the package; in a source tree it lies beside the package.
    """
    packaged = _PACKAGE / "_data" / kind
    return packaged if packaged.is_dir() else _PACKAGE.parent / kind
