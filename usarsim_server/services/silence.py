"""Machines that are gone: what is sent to them stays unacknowledged.

A machine that is switched off, or whose cable is pulled, says no goodbye. As long as bytes for it
are in flight, keepalive sends nothing, and the kernel gives up after a quarter of an hour. Here the
kernel is asked again and again what it has heard of the other side (`TCP_INFO`).

A client that lives and does not read, in a debugger for example, is not gone. Its kernel says that
its buffer is full. Then nothing is in flight, and the kernel's probes are up to two minutes apart.
Where its kernel drops what it has no room for, bytes do stay in flight, but each repetition is
answered, and those too are up to two minutes apart.

Linux only: elsewhere nothing is watched, and keepalive (`listener.tune`) ends connections on which
nothing is in flight.
"""

from __future__ import annotations

import asyncio
import socket
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Self

from usarsim_server.base.logs import Log

GONE = "its machine does not answer any more"
"""Why such a connection ends."""
PATIENCE = 30.0
"""s of wall time without any answer after which a machine counts as gone."""
_LOOKS = 10
"""Looks at a connection in this time."""
_KNOWN = sys.platform == "linux"
_INFO = struct.Struct("=8x I 12x I 24x 2I")
"""The fields of Linux's `struct tcp_info` (include/uapi/linux/tcp.h) that count here: time until
what is unacknowledged is sent again (us), segments in flight, time since data came, and since an
acknowledgement came (ms)."""


_GRAIN = 0.05
"""s by which two times of one event may differ: the kernel counts jiffies of up to 10 ms."""


@dataclass(frozen=True, slots=True)
class TcpInfo:
    """What the kernel knows of a connection.

    Attributes:
        in_flight: segments that were sent and are not acknowledged.
        age: s since anything came: data, or an acknowledgement.
        repeat: s from the last sending of what is in flight to the next.
    """

    in_flight: int
    age: float
    repeat: float

    @classmethod
    def parse(cls, info: bytes) -> Self | None:
        """Take Linux's `TCP_INFO` apart; None if the kernel tells less than that."""
        if len(info) < _INFO.size:
            return None
        repeat, in_flight, data_age, acknowledgement_age = _INFO.unpack_from(info)
        return cls(in_flight, min(data_age, acknowledgement_age) / 1e3, repeat / 1e6)

    @classmethod
    def of(cls, client: socket.socket) -> Self | None:
        """Ask the kernel; None where it does not tell, or the socket is closed."""
        if not _KNOWN:
            return None
        try:
            return cls.parse(client.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _INFO.size))
        except OSError:
            return None


class Silence:
    """Decides whether the machine at the other side of a connection is gone, look by look."""

    def __init__(self, most: float, now: float) -> None:
        """Begin with a connection that is fine.

        Args:
            most: s of silence while bytes are in flight after which the machine is gone.
            now: s of any clock that never goes back.
        """
        self._most = most
        self._since = now
        self._repeat = 0.0

    def too_long(self, info: TcpInfo, now: float) -> bool:
        """Whether the machine is gone.

        Args:
            info: what the kernel knows. now: s of the same clock, not after it was asked.
        """
        if info.in_flight == 0:
            self._since, self._repeat = now, info.repeat
        elif (heard := now - info.age) > self._since + _GRAIN:
            # There is nothing to be heard before the kernel repeats what is in flight.
            self._since, self._repeat = heard, info.repeat
        return now - self._since > self._most + self._repeat


@contextmanager
def ends_when_gone(
    client: socket.socket, log: Log, seconds: float = PATIENCE, **facts: object
) -> Iterator[None]:
    """Cancel the running task, with `GONE`, once the machine at the other side is gone.

    Args:
        client: stays open while inside.
        log: is told so. facts: of the line.
        seconds: s of silence, see `Silence`.
    """
    task = asyncio.current_task()
    assert task is not None
    loop = asyncio.get_running_loop()
    silence = Silence(seconds, loop.time())
    timer: asyncio.TimerHandle | None = None

    def look() -> None:
        nonlocal timer
        now, info = loop.time(), TcpInfo.of(client)
        if info is None:
            return
        if silence.too_long(info, now):
            log.warning(f"connection closed by the server: {GONE}", silence=seconds, **facts)
            task.cancel(GONE)
        else:
            timer = loop.call_later(seconds / _LOOKS, look)

    look()
    try:
        yield
    finally:
        if timer is not None:
            timer.cancel()
