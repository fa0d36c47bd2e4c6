"""The live page of a run: pictures of any step, drawn as files are, while the run goes on.

Served is to this computer alone, and nothing that is asked changes the run.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from aiohttp import web
from aiohttp.typedefs import Handler

from usarsim_exploration.showing.overlays import OVERLAYS
from usarsim_exploration.showing.picture import draw, png
from usarsim_exploration.showing.tape import Tape
from usarsim_report.gate import GateLimits, gated
from usarsim_report.page_files import page_file, page_headers
from usarsim_report.serving import PAGE, foreign, hosts_of, open_browser

HOST = "127.0.0.1"
_LIMITS = GateLimits(share=1.0)  # who looks is who started it, and pictures are drawn for each


class Page:
    """Answers the requests of browsers.

    Attributes:
        hosts: values of `Host` that are served.
    """

    def __init__(self, tape: Tape, files: Path = PAGE) -> None:
        self.hosts: frozenset[str] = frozenset()
        self._tape, self._files = tape, files.resolve()
        self._headers = page_headers()

    def app(self) -> web.Application:
        """The application for aiohttp."""
        app = web.Application(middlewares=[self._guard])
        for name in ("run", "progress", "figures", "picture"):
            app.router.add_get(f"/{name}", getattr(self, f"_{name}"))
        app.router.add_get("/{path:.*}", self._file)
        return app

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Nobody from elsewhere; what cannot be understood is answered with the reason."""
        why = foreign(request.headers, self.hosts, origin=False)
        if why:
            return web.Response(status=403, text=why, headers=self._headers)
        try:
            return await handler(request)
        except ValueError as error:
            return web.Response(status=400, text=str(error), headers=self._headers)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        path = request.match_info["path"]
        accepted = request.headers.get("Accept-Encoding", "")
        return page_file(self._files, path, self._headers, "explore.html", accepted)

    async def _run(self, request: web.Request) -> web.StreamResponse:
        """What stays as it is."""
        shown = [
            {"name": one.name, "default": one.default, "help": one.help}
            for one in OVERLAYS.values()
        ]
        tape = self._tape
        return self._json({"title": tape.title, "names": tape.names, "overlays": shown})

    async def _progress(self, request: web.Request) -> web.StreamResponse:
        """How far the run is, and what all know by step, from a step on."""
        tape, since = self._tape, _whole(request, "since")
        # the run ends before its last step is noted
        ended = tape.run.ended if len(tape) > tape.run.cycle.step else None
        return self._json({"ended": ended, "shares": tape.shares[since : len(tape)]})

    async def _figures(self, request: web.Request) -> web.StreamResponse:
        """Role, state and what all have to bring, at a step."""
        figures = self._tape.scene(self._step(request)).figures
        return self._json(
            [
                {"name": one.name, "role": one.role, "state": one.state, "works": one.works,
                 "own": one.own}
                for one in figures
            ]
        )  # fmt: skip

    async def _picture(self, request: web.Request) -> web.StreamResponse:
        """A step with overlays, as PNG."""
        overlays = frozenset(filter(None, request.query.get("overlays", "").split(",")))
        if unknown := overlays - set(OVERLAYS):
            raise ValueError(f"there is no overlay {min(unknown)!r}")
        name = request.query.get("robot") or None
        if name is not None and name not in self._tape.names:
            raise ValueError(f"there is no robot {name!r}")
        robot = None if name is None else self._tape.names.index(name)
        picture = draw(self._tape.scene(self._step(request)), overlays, robot)
        return web.Response(body=png(picture), content_type="image/png", headers=self._headers)

    def _step(self, request: web.Request) -> int:
        step = _whole(request, "step")
        if step >= len(self._tape):
            raise ValueError(f"step {step} has not come")
        return step

    def _json(self, value: object) -> web.Response:
        return web.json_response(value, headers=self._headers)


def _whole(request: web.Request, name: str) -> int:
    text = request.query.get(name, "0")
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise ValueError(f"{name} must be a whole number")
    return int(text)


@contextlib.asynccontextmanager
async def served(page: Page, port: int = 0) -> AsyncIterator[str]:
    """Serve a page while inside; its address.

    Args:
        port: 0 is any free one.

    Raises:
        UsarsimError: the port cannot be had.
    """
    async with gated(page.app(), HOST, port, limits=_LIMITS) as bound:
        page.hosts = hosts_of(HOST, bound)
        yield f"http://{HOST}:{bound}/"


async def show(tape: Tape, work: Callable[[Callable[[], bool]], object], port: int = 0) -> None:
    """Do the work that drives a tape in a thread, and serve its page until cancelled.

    Args:
        work: is given what says whether to go on.

    Raises:
        UsarsimError: of the work, or the port cannot be had.
    """
    page, stopped = Page(tape), asyncio.Event()
    async with served(page, port) as address:
        print(f"SHOW {address}", flush=True)
        browser = asyncio.create_task(open_browser(address))
        working = asyncio.create_task(asyncio.to_thread(work, lambda: not stopped.is_set()))
        try:
            await asyncio.shield(working)
            await asyncio.Event().wait()
        finally:
            stopped.set()
            browser.cancel()
            await asyncio.wait([working])
            working.result()
