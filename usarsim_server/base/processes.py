"""Other programs of this machine: their names, and which of them listens on a port.

Everything is read below a folder that stands for `/proc` (proc(5)), so that tests can make one up.
"""

from __future__ import annotations

import os
import pwd
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
LISTENING = "0A"
"""State of a listening socket in `net/tcp`, TCP_LISTEN of the kernel's `tcp_states.h`."""
LONGEST_NAME = 60


@dataclass(frozen=True, slots=True)
class Process:
    """A program that runs."""

    pid: int  # its number
    name: str  # its command line, shortened
    cores: float = 0.0  # processors that it kept busy while that was watched


@dataclass(frozen=True, slots=True)
class Owner:
    """Who listens on a port."""

    process: Process | None  # the program, None if we may not see which
    user: str  # whose it is


def pids(proc: Path = PROC) -> list[int]:
    """Numbers of all processes that can be seen."""
    return [int(entry.name) for entry in proc.iterdir() if entry.name.isdigit()]


def name(proc: Path, pid: int) -> str:
    """The command line of a process, without the folder of the program."""
    with suppress(OSError):
        words = (proc / str(pid) / "cmdline").read_bytes().decode(errors="replace").split("\0")
        text = " ".join([os.path.basename(words[0]), *words[1:]]).strip()
        if text:
            text = "".join(one if one.isprintable() else " " for one in text)
            return text if len(text) <= LONGEST_NAME else text[: LONGEST_NAME - 3] + "..."
    with suppress(OSError):
        return (proc / str(pid) / "comm").read_text().strip()
    return "a program"


def port_owner(port: int, proc: Path = PROC) -> Owner | None:
    """Who listens on a TCP port of this machine; None if nobody is seen to."""
    sockets = {}
    for table in ("net/tcp", "net/tcp6"):
        with suppress(OSError):
            for line in (proc / table).read_text().splitlines()[1:]:
                fields = line.split()
                if fields[3] == LISTENING and int(fields[1].rpartition(":")[2], 16) == port:
                    sockets[fields[9]] = int(fields[7])
    for pid in pids(proc) if sockets else ():
        for inode, user in sockets.items():
            if inode in _sockets(proc, pid):
                return Owner(Process(pid, name(proc, pid)), _user(user))
    return next((Owner(None, _user(user)) for user in sockets.values()), None)


def port_taker(port: int) -> tuple[str, int | None]:
    """Words for who listens on a port, and the number of the process if that can be seen."""
    owner = port_owner(port)
    if owner is None:
        return "by whom cannot be seen", None
    if owner.process is None:
        return f"by a program of user {owner.user}", None
    if owner.process.pid == os.getpid():
        return "by this very program", owner.process.pid
    return f"by {owner.process.name} (pid {owner.process.pid})", owner.process.pid


def _sockets(proc: Path, pid: int) -> set[str]:
    """Inodes of the sockets that a process has open, as far as we may see them."""
    found = set()
    with suppress(OSError):
        for entry in os.scandir(proc / str(pid) / "fd"):
            with suppress(OSError):
                target = os.readlink(entry.path)
                if target.startswith("socket:["):
                    found.add(target[8:-1])
    return found


def _user(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"number {number}"
