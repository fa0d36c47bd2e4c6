"""The web server of a desk: the page of each seat, and its WebSocket."""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
from collections import deque
from collections.abc import AsyncIterator, Mapping
from pathlib import Path

from aiohttp import WSCloseCode, WSMsgType, web

from usarsim_operator.places import NoPlaceError, PagePlaces
from usarsim_operator.roles import LONGEST, Limits
from usarsim_report.gate import admit, gated
from usarsim_report.page_files import page_file, page_headers
from usarsim_report.serving import PAGE, foreign, hosts_of
from usarsim_server.base.files import reason
from usarsim_server.base.private import exposed, private
from usarsim_server.base.toml import read_text
from usarsim_server.protocol.json_text import parse_json
from usarsim_study.errors import StudyError
from usarsim_study.session.desk import EXPERIMENTER, Desk
from usarsim_study.session.screens import Message, wait_message

FIRST = "study.html"
"""The page of all seats."""
TOKENS = ".desk.json"
"""Keeps the tokens of a study's seats, so that pages come back to a desk that was restarted."""
MOST_PAGES = 16
"""Pages at a time that have said who they are."""
KEPT_PAGES = 4
"""Places of them that are kept for the experimenter."""
MOST_TEXTS = 512
"""Texts that may wait for a page; one that lets more wait is shut out."""
HELLO_TIME = 5.0
"""s that a page has to say who it is."""
SEATS: Mapping[int, str] = {1: "operator 1", 2: "operator 2", EXPERIMENTER: "experimenter"}
"""What seats are called in addresses that are announced."""


def kept_tokens(path: Path) -> dict[int, str]:
    """The tokens of all seats, from a file that is made if it is not there.

    Raises:
        StudyError: it cannot be had, others may read it, or it is something else.
    """
    try:
        # It has its mode from the beginning: nobody sees it in between.
        with contextlib.suppress(FileExistsError), open(path, "x", opener=private) as file:
            json.dump({name: secrets.token_urlsafe(18) for name in SEATS.values()}, file)
        open_to_others = exposed(path)
        told = parse_json(read_text(path, StudyError))
        tokens = {seat: str(told[name]) for seat, name in SEATS.items()}
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)} (name a folder of yours)") from None
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{path}: holds no tokens (delete it for new ones)") from None
    if open_to_others:
        raise StudyError(f"{path}: others may read it (chmod 600, or delete it for new ones)")
    if len({one for one in tokens.values() if len(one) >= 16}) < len(tokens):
        raise StudyError(f"{path}: tokens are short or alike (delete it for new ones)")
    return tokens


class SocketPage:
    """A page at its socket: texts wait in a queue, and one task sends them.

    Attributes:
        limits: how much it may say. full: it took nothing for too long. ended: it is shut out.
        displaced: since another page took its place.
    """

    def __init__(self, socket: web.WebSocketResponse, now: float) -> None:
        self.limits, self.full, self.ended = Limits(now), False, False
        self.displaced = False
        self._socket = socket
        self._texts: deque[str] = deque()
        self._stirred = asyncio.Event()

    def tell(self, message: Message) -> None:
        """Send a text; never waits."""
        self._texts.append(json.dumps(message, ensure_ascii=False, separators=(",", ":")))
        if len(self._texts) > MOST_TEXTS:
            self.full = True
        self._stirred.set()

    def end(self) -> None:
        """Shut it out; it comes back by itself."""
        self.ended = True
        self._stirred.set()

    async def send_all(self) -> None:
        """Send what waits, until the socket fails or too much waits."""
        while not self.full and not self.ended:
            while self._texts:
                await self._socket.send_str(self._texts.popleft())
            self._stirred.clear()
            await self._stirred.wait()


class Web:
    """Serves the pages of one desk after the other.

    Attributes:
        desk: the session that runs; None: none does. hosts: values of `Host` that are served.
        refused: requests that were shut out.
    """

    def __init__(self, tokens: Mapping[int, str], frames: str, files: Path = PAGE) -> None:
        """tokens: of all seats. frames: origins whose pages may be shown inside ours."""
        self.desk: Desk | None = None
        self.hosts: frozenset[str] = frozenset()
        self.refused = 0
        self._tokens, self._files = tokens, files.resolve()
        self._headers = page_headers(frames=frames)
        self._open: dict[SocketPage, int] = {}
        self._places: PagePlaces[SocketPage] = PagePlaces(MOST_PAGES, KEPT_PAGES)

    def app(self) -> web.Application:
        """The application for aiohttp."""
        app = web.Application(client_max_size=LONGEST)
        app.router.add_get("/socket", self._socket)
        app.router.add_get("/{path:.*}", self._file)
        return app

    def lead(self, desk: Desk | None) -> None:
        """Another session begins, or none; open pages go over to it."""
        before, self.desk = self.desk, desk
        for page, seat in self._open.items():
            if before is not None:
                before.leave(seat, page)
            if desk is not None and seat in (EXPERIMENTER, *desk.seats):
                desk.enter(seat, page)

    def _shut(self, request: web.Request, *, origin: bool) -> web.Response | None:
        why = foreign(request.headers, self.hosts, origin=origin)
        if not why:
            return None
        self.refused += 1
        return web.Response(status=403, text=why, headers=self._headers)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        shut = self._shut(request, origin=False)
        path = request.match_info["path"]
        accepted = request.headers.get("Accept-Encoding", "")
        return shut or page_file(self._files, path, self._headers, FIRST, accepted)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        if (shut := self._shut(request, origin=True)) is not None:
            return shut
        socket = web.WebSocketResponse(max_msg_size=LONGEST, timeout=2.0)
        await socket.prepare(request)
        seat = await self._hello(socket)
        page = SocketPage(socket, asyncio.get_running_loop().time())
        code, why = WSCloseCode.POLICY_VIOLATION, b"the token is wrong, or hello did not come"
        try:
            if seat is not None:
                self._give_place(page, seat)
                admit(request)
                await self._serve(socket, seat, page)
                return socket
        except NoPlaceError as error:
            code, why = WSCloseCode.TRY_AGAIN_LATER, str(error).encode()
        finally:
            self._places.leave(page)
        self.refused += 1
        await socket.close(code=code, message=why)
        return socket

    def _give_place(self, page: SocketPage, seat: int) -> None:
        """Give a page a place; the one that has been silent longest may lose its own.

        Raises:
            NoPlaceError: there is none for it.
        """
        lost = self._places.enter(page, leads=seat == EXPERIMENTER)
        if lost is not None:
            lost.displaced = True
            lost.end()

    async def _hello(self, socket: web.WebSocketResponse) -> int | None:
        """The seat of a page, once it has said its token."""
        with contextlib.suppress(TimeoutError, ValueError, AttributeError):
            first = await socket.receive(HELLO_TIME)
            said = parse_json(first.data) if first.type is WSMsgType.TEXT else {}
            given = str(said.get("token")).encode("utf-8", "replace")
            if said.get("type") == "hello":
                fits = [
                    seat
                    for seat, token in self._tokens.items()
                    if secrets.compare_digest(given, token.encode())
                ]
                return fits[0] if fits else None
        return None

    async def _serve(self, socket: web.WebSocketResponse, seat: int, page: SocketPage) -> None:
        self._open[page] = seat
        if self.desk is not None and seat in (EXPERIMENTER, *self.desk.seats):
            self.desk.enter(seat, page)
        else:
            page.tell(wait_message(0, "Please wait: no session runs."))
        tasks = [
            asyncio.create_task(self._listen(socket, seat, page)),
            asyncio.create_task(page.send_all()),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            del self._open[page]
            if self.desk is not None and seat in (EXPERIMENTER, *self.desk.seats):
                self.desk.leave(seat, page)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            with contextlib.suppress(OSError, TimeoutError, RuntimeError):
                async with asyncio.timeout(3.0):
                    code, why = WSCloseCode.OK, b""
                    if page.displaced:
                        code, why = WSCloseCode.TRY_AGAIN_LATER, b"another page took this place"
                    elif page.limits.exhausted or page.full:
                        code, why = WSCloseCode.POLICY_VIOLATION, b"too much"
                    await socket.close(code=code, message=why)

    async def _listen(self, socket: web.WebSocketResponse, seat: int, page: SocketPage) -> None:
        clock = asyncio.get_running_loop().time
        async for message in socket:
            self._places.heard(page)
            long = len(message.data) if message.type is WSMsgType.TEXT else 0
            heard = page.limits.hears(clock(), long)
            if message.type is not WSMsgType.TEXT:
                page.limits.refuse()
            elif heard and self.desk is not None:
                self.desk.hear(seat, page, message.data)
            elif heard and '"ping"' in message.data[:64]:
                page.tell({"type": "pong"})
            if page.limits.exhausted:
                return


@contextlib.asynccontextmanager
async def serving(pages: Web, host: str, port: int) -> AsyncIterator[dict[int, str]]:
    """Serve while inside; yields the address of each seat.

    Raises:
        UsarsimError: the port cannot be had.
    """
    async with gated(pages.app(), host, port) as bound:
        pages.hosts = hosts_of(host, bound)
        shown = f"[{host}]" if ":" in host else host
        yield {seat: f"http://{shown}:{bound}/#{token}" for seat, token in pages._tokens.items()}
