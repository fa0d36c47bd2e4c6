"""Ports that tests choose themselves, and nobody else of the machine gets meanwhile."""

from __future__ import annotations

import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def held_port() -> Iterator[int]:
    """A port of 127.0.0.1 at which programs may listen one after the other while inside.

    It is bound, but nobody listens there: with `SO_REUSEADDR` a server can have it all the same on
    Linux, while the system gives it to nobody who asks for any port. Elsewhere two programs cannot
    be bound to one port; it is only known to have been free.
    """
    with socket.socket() as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        if sys.platform != "linux":
            holder.close()
        yield port
