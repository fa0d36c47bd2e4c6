"""Files and folders that are there whole or not at all, whatever happens while they are written.

What is new is written beside its place, under another name, handed over to the disk, and only then
given its name, in one step of the file system (rename(2)). A program that is killed, or a disk that
is full, leaves what was there before; at most a hidden file with `.new-` in its name stays behind.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

__all__ = ["publish_folder", "replacing", "write_bytes", "write_text"]

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
"""renameat2(2): the two names change places."""


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file to write to; at the end of the block, if all went well, it becomes that of the path.

    What is no regular file (a terminal, a pipe) is written to directly.

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
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        with os.fdopen(descriptor, "wb") as file:
            if mode is not None:
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


def write_bytes(path: Path, data: bytes) -> None:
    """Replace a file.

    Raises:
        OSError: see `replacing`.
    """
    with replacing(path) as file:
        file.write(data)


def write_text(path: Path, text: str) -> None:
    """Replace a file with text in UTF-8.

    Raises:
        OSError: see `replacing`.
    """
    write_bytes(path, text.encode())


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
