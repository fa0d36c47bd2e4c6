"""Serves a page of this machine: which requests are its own, opening a browser, the end."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import webbrowser
from collections.abc import Coroutine, Iterable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from usarsim_server.base.interrupts import GRACE, calling

PAGE = Path(__file__).parents[1] / "usarsim_operator" / "page"
"""Where the built pages are: the TypeScript of the console builds all of them."""


def hosts_of(address: str, port: int) -> frozenset[str]:
    """Values of `Host` under which a gateway at an address is reached.

    A gateway at a loopback address, or at all of them, is `localhost`, too. At all addresses of a
    machine the names of that machine cannot be known: name them by an option.
    """
    names = {address}
    if address in ("127.0.0.1", "::1", "0.0.0.0", "::", "localhost"):
        names |= {"127.0.0.1", "localhost", "::1"}
    shown = {f"[{name}]" if ":" in name else name for name in names}
    ported = {f"{name}:{port}" for name in shown}
    return frozenset(ported | shown) if port == 80 else frozenset(ported)


def foreign(headers: Mapping[str, str], hosts: Iterable[str], *, origin: bool) -> str:
    """Why a request does not come from our own page; empty if it does.

    Args:
        headers: of the request.
        hosts: values of `Host` under which the gateway is reached.
        origin: whether `Origin` must be there, as browsers send it with a WebSocket.
    """
    known = {host.lower() for host in hosts}
    if (headers.get("Host") or "").lower() not in known:
        return "this Host is not served here"
    given = headers.get("Origin")
    if given is None:
        return "no Origin" if origin else ""
    try:
        parts = urlsplit(given)
    except ValueError:
        return "this Origin may not come in"
    same = parts.netloc.lower() == (headers.get("Host") or "").lower()
    return "" if same and parts.scheme in ("http", "https") else "this Origin may not come in"


async def until_interrupted(work: Coroutine[Any, Any, None], grace: float = GRACE) -> None:
    """Do something until it ends, or until SIGINT or SIGTERM cancels it.

    Args:
        work: what. grace: s of wall time that it gets to tidy up.
    """
    task, loop = asyncio.ensure_future(work), asyncio.get_running_loop()
    with (
        calling(lambda: loop.call_soon_threadsafe(task.cancel), grace),
        contextlib.suppress(asyncio.CancelledError),
    ):
        await task


async def open_browser(url: str) -> None:
    """Open a browser, unless it would take over a terminal."""
    shown = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
    opened = False
    if shown or sys.platform in ("darwin", "win32"):
        with contextlib.suppress(webbrowser.Error, OSError):
            opened = await asyncio.to_thread(webbrowser.open, url)
    if not opened:
        print("no browser could be opened: open one of these addresses", file=sys.stderr)
