"""Another machine on a cable of its own, which can be switched off: a network namespace.

It needs root and `ip` (iproute2); where these are missing tests that use it are skipped.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator

_NEW_NET = 0x40000000  # CLONE_NEWNET of sched.h


class FarMachine:
    """A machine beside this one.

    Attributes:
        here: our address, as it sees it.
        address: its own.
    """

    def __init__(self) -> None:
        """Plug it in.

        Raises:
            OSError: if this process may not make network namespaces.
        """
        number = os.getpid() % (1 << 16)
        # 198.18.0.0/15 is set aside for tests of networks (RFC 2544); four addresses for a cable.
        net = f"198.18.{number >> 6 & 255}.{4 * (number & 63)}".rpartition(".")
        self.here, self.address = (f"{net[0]}.{int(net[2]) + host}" for host in (1, 2))
        self._name = f"usarsim-{os.getpid()}"
        self._ours, self._theirs = f"us{number}a", f"us{number}b"
        try:
            _ip("netns", "add", self._name)
            _ip("link", "add", self._ours, "type", "veth", "peer", self._theirs)
            _ip("link", "set", self._theirs, "netns", self._name)
            _ip("addr", "add", f"{self.here}/30", "dev", self._ours)
            _ip("link", "set", self._ours, "up")
            _ip("-n", self._name, "addr", "add", f"{self.address}/30", "dev", self._theirs)
            _ip("-n", self._name, "link", "set", self._theirs, "up")
        except BaseException:
            self.remove()
            raise

    @contextlib.contextmanager
    def inside(self) -> Iterator[None]:
        """Sockets that this thread makes inside are of that machine."""
        with open("/proc/thread-self/ns/net") as home, open(f"/run/netns/{self._name}") as away:
            _enter(away.fileno())
            try:
                yield
            finally:
                _enter(home.fileno())

    def connect(self, port: int) -> socket.socket:
        """A connection from there to a port of ours."""
        with self.inside():
            return socket.create_connection((self.here, port), 10.0)

    def switch_off(self) -> None:
        """It answers nothing from now on, and says no goodbye; the cable stays plugged in."""
        _ip("-n", self._name, "addr", "flush", "dev", self._theirs)

    def unplug(self) -> None:
        """Pull the cable."""
        _ip("-n", self._name, "link", "set", self._theirs, "down")

    def remove(self) -> None:
        """Leave nothing of it."""
        for arguments in (("link", "del", self._ours), ("netns", "del", self._name)):
            subprocess.run(["ip", *arguments], capture_output=True, check=False)


def lacking() -> str:
    """Why there can be no such machine here; empty if there can."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        return "a machine that can be switched off needs root and ip (iproute2)"
    return ""


def _ip(*arguments: str) -> None:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")


def _enter(namespace: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.setns(namespace, _NEW_NET):
        raise OSError(ctypes.get_errno(), "setns")
