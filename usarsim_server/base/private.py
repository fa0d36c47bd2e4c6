"""Makes and reads files for their owner alone: tokens, recordings, answers of participants.

Such a file has mode 0600 from the beginning. A token is not taken from a file that other users of
the machine may read.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import is_regular
from usarsim_server.base.toml import read_text

MODE = 0o600
"""Of such a file: its owner reads and writes it."""
FOLDER_MODE = 0o700


def private(path: str | Path, flags: int) -> int:
    """The descriptor of a file, also for `open(..., opener=private)`; a new one is private."""
    return os.open(path, flags | os.O_CLOEXEC, MODE)


def exposed(path: Path) -> bool:
    """Whether others than its owner may read or change a file.

    Raises:
        OSError: it is not there.
    """
    return os.name == "posix" and bool(stat.S_IMODE(path.stat().st_mode) & 0o077)


def same_user(client: int, server: int) -> bool:
    """Whether a program of this user is at the other end of a connection from this machine; also
    where the system does not tell (it does on Linux).

    Args:
        client: its port. server: ours.
    """
    tables = [Path(f"/proc/net/{name}") for name in ("tcp", "tcp6")]
    if not any(table.exists() for table in tables):
        return True
    rows = [line.split() for table in tables if table.exists() for line in _lines(table)]
    ends = f":{client:04X}", f":{server:04X}"
    users = [row[7] for row in rows if row[1].endswith(ends[0]) and row[2].endswith(ends[1])]
    return bool(users) and set(users) == {str(os.getuid())}


def _lines(table: Path) -> list[str]:
    return table.read_text(encoding="ascii").splitlines()[1:]


def read_secret(path: Path) -> str:
    """What stands in a file with a token, without blanks around it.

    Raises:
        UsarsimError: it cannot be read, is empty, or others may read it.
    """
    text = read_text(path, UsarsimError).strip()
    if exposed(path):
        raise UsarsimError(at(path, "others may read this token", f"chmod 600 {path}"))
    if not text:
        raise UsarsimError(at(path, "is empty", "write a token into it"))
    return text


def secret(given: str) -> str:
    """A token, or what stands in the file of that name.

    Raises:
        UsarsimError: see `read_secret`.
    """
    given = given.strip()
    return read_secret(Path(given)) if given and is_regular(given) else given
