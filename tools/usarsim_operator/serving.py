"""Serves pages of one station until it is interrupted: what `console` and `demo` have in common."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import sys
import webbrowser
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usarsim_client import ProtocolError
from usarsim_operator.roles import Role, Tokens, hosts_of
from usarsim_operator.tokens import kept_tokens
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.extras import need as need_libraries
from usarsim_server.base.interrupts import GRACE, calling

if TYPE_CHECKING:
    from usarsim_operator.station import Settings, Station

PAGE = Path(__file__).parent / "page"
"""Where the built page is."""
FIRST_ANSWERS = 2.0
"""s of wall time that robots may take to say what they are, before pages are let in."""


@dataclass(frozen=True, slots=True)
class Serving:
    """How pages are served.

    Attributes:
        host, port: where; 0 is any free port. allowed: further values of `Host`.
        browser: the role that a browser is opened for; None: do not open one.
        robots: `CLASS` or `CLASS=NAME` to begin with. record: file to record to.
        tokens: file that keeps them over a restart; None: new ones each time.
        then: done when they are there, before pages are announced.
        framed_by: values of `Host` whose pages may show ours inside them (the desk of a study).
        seats: how many operators have a token of their own.
        told: takes the addresses by whom they are for (`operator`, or of several `operator 1` and
            so on, `instructor`, `viewer`), instead of printing them.
    """

    host: str
    port: int
    allowed: frozenset[str] = frozenset()
    browser: Role | None = None
    robots: Sequence[str] = ()
    record: Path | None = None
    tokens: Path | None = None
    then: Callable[[], Awaitable[None]] | None = None
    framed_by: frozenset[str] = frozenset()
    seats: int = 1
    told: Callable[[Mapping[str, str]], None] | None = None


def add_page_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that `console` and `demo` share."""
    parser.add_argument(
        "--console-port",
        metavar="N",
        type=port_number,
        help="port to serve pages at; 0: any free one (default 8080)",
    )
    parser.add_argument(
        "--viewer-delay",
        metavar="S",
        type=float,
        default=10.0,
        help="how much later viewers see everything (default 10)",
    )
    parser.add_argument(
        "--record", metavar="FILE", type=Path, help="record the session for `usarsim film`"
    )
    parser.add_argument(
        "--tokens",
        metavar="FILE",
        type=Path,
        help="keeps the tokens of the three roles, so that pages come back after a restart; made "
        "if it is not there (default new tokens each time)",
    )
    parser.add_argument("--no-browser", action="store_true", help="do not open a browser")


def port_number(text: str) -> int:
    """A port of the command line."""
    number = int(text)
    if not 0 <= number < 65536:
        raise argparse.ArgumentTypeError(f"must be from 0 to 65535, not {number}")
    return number


def need(arguments: argparse.Namespace) -> None:
    """Make sure that pages can be served at all.

    Raises:
        UsarsimError: if the extra is not installed, or an option cannot be obeyed.
    """
    need_libraries("aiohttp", extra="console", asker="the console")
    if not 0.0 <= arguments.viewer_delay <= 600.0:
        raise UsarsimError("--viewer-delay: must be from 0 to 600")
    if arguments.record is not None and os.path.lexists(arguments.record):
        raise UsarsimError(f"--record: {arguments.record} exists already (name another file)")


def has_page() -> bool:
    """Whether the page was built."""
    return (PAGE / "index.html").is_file()


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


async def serve(settings: Settings, serving: Serving) -> None:
    """Serve pages of a station of its own until cancelled.

    Raises:
        UsarsimError: if the server is not there, or the port or the file cannot be had.
    """
    from usarsim_operator.pulse import Pulse
    from usarsim_operator.station import Station

    tokens = None if serving.tokens is None else kept_tokens(serving.tokens)
    station = Station(settings)
    async with contextlib.AsyncExitStack() as stack:
        stack.push_async_callback(station.close)
        try:
            await station.open()
            if serving.record is not None:
                station.record(serving.record)
            for text in serving.robots:
                class_name, _, name = text.partition("=")
                await station.spawn(class_name, name or None)
        except (OSError, ProtocolError, TimeoutError, ValueError) as error:
            raise UsarsimError(f"{error} (is --connect right, does the server run?)") from None
        await _known(station)
        if serving.then is not None:
            await serving.then()
        await stack.enter_async_context(served(station, serving, tokens))
        await Pulse(station).run()


@contextlib.asynccontextmanager
async def served(
    station: Station, serving: Serving, tokens: Tokens | None = None
) -> AsyncIterator[None]:
    """Serve the pages of a station while inside; announces them.

    Args:
        station: whose. serving: how. tokens: of the roles; None: new ones.

    Raises:
        UsarsimError: if the port cannot be had.
    """
    from usarsim_operator.gate import gated
    from usarsim_operator.web import Web

    tokens = tokens or Tokens(seats=serving.seats)
    pages = Web(station, tokens=tokens, framed_by=serving.framed_by)
    host = serving.host
    async with gated(pages.app(), host, serving.port, option="--console-port") as port:
        pages.hosts = hosts_of(host, port) | serving.allowed
        shown = f"[{host}]" if ":" in host else host
        base = f"http://{shown}:{port}/"
        urls = {who: f"{base}#{token}" for who, token in pages.tokens.all()}
        if serving.told is not None:
            serving.told(urls)
        for who, url in urls.items() if serving.told is None else ():
            print(f"CONSOLE {url} {who}", flush=True)
        if serving.browser is not None:
            station.background(open_browser(base + pages.path_once(serving.browser)))
        yield


async def _known(station: Station) -> None:
    """Wait until our robots have said what they are: by then it is known whether the server is in
    lockstep, and no page comes too early for that."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(FIRST_ANSWERS):
            while True:
                if all(one.learned for one in station.robots.values() if one.own):
                    return
                await asyncio.sleep(0.01)


async def open_browser(url: str) -> None:
    """Open a browser, unless it would take over a terminal."""
    shown = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
    opened = False
    if shown or sys.platform in ("darwin", "win32"):
        with contextlib.suppress(webbrowser.Error, OSError):
            opened = await asyncio.to_thread(webbrowser.open, url)
    if not opened:
        print("no browser could be opened: open one of these addresses", file=sys.stderr)
