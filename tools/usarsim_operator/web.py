"""The gateway's web server: files of the page, one WebSocket per page, the scene."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import secrets
from collections.abc import Awaitable, Callable
from pathlib import Path
from socket import IPPROTO_TCP, TCP_NOTSENT_LOWAT

from aiohttp import WSCloseCode, WSMsgType, web
from aiohttp.typedefs import Middleware

from usarsim_operator import messages
from usarsim_operator.impaired_link import ImpairedLink
from usarsim_operator.messages import PageError
from usarsim_operator.pages import Page
from usarsim_operator.places import NoPlaceError, PagePlaces
from usarsim_operator.requests import Desk
from usarsim_operator.roles import LONGEST, Role, Tokens
from usarsim_operator.station import Station
from usarsim_operator.watchdog import DRIVE_TIME
from usarsim_report.gate import admit
from usarsim_report.page_files import page_file, page_headers
from usarsim_report.serving import PAGE, foreign
from usarsim_server.base.private import same_user

MOST_PAGES = 64
"""Pages at a time that have said who they are."""
KEPT_PAGES = 8
"""Places of them that are kept for operators and instructors."""
MOST_UNSENT = 2048
"""Bytes for a page that the kernel holds beside those under way."""
HELLO_TIME = 5.0
"""s that a page has to say who it is."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def _hold_little(request: web.Request) -> None:
    """Let what a slow page has not taken wait in its slots, where the newest wins, and not in the
    kernel's buffer: that would hold seconds of it."""
    if (transport := request.transport) is not None:
        transport.set_write_buffer_limits(0)
        if (sock := transport.get_extra_info("socket")) is not None:
            with contextlib.suppress(OSError):  # not every system has it
                sock.setsockopt(IPPROTO_TCP, TCP_NOTSENT_LOWAT, MOST_UNSENT)


def _compress_only_what_says_so(socket: web.WebSocketResponse) -> None:
    """Compress for slow pages only: others would pay for it with time of the processor."""
    if (writer := getattr(socket, "_writer", None)) is not None:
        writer.compress = 0


class Web:
    """Serves pages of one station.

    Attributes:
        tokens: a secret for each role. hosts: values of `Host` that are served.
        refused: requests that were shut out.
    """

    def __init__(
        self,
        station: Station,
        files: Path = PAGE,
        tokens: Tokens | None = None,
        framed_by: frozenset[str] = frozenset(),
    ) -> None:
        """framed_by: values of `Host` whose pages may show ours inside them."""
        self._headers = page_headers(framed_by)
        self.tokens = tokens or Tokens()
        self.hosts: frozenset[str] = frozenset()
        self.refused = 0
        self._station, self._files = station, files.resolve()
        self._once: dict[str, str] = {}
        """Tokens by the codes that a browser may have them for."""
        self._desk = Desk(station)
        self._places: PagePlaces[Page] = PagePlaces(MOST_PAGES, KEPT_PAGES)

    def app(self) -> web.Application:
        """The application for aiohttp."""
        app = web.Application(middlewares=[self._guard], client_max_size=LONGEST)
        app.router.add_get("/socket", self._socket)
        app.router.add_get("/health", self._health)
        app.router.add_get("/scene/{generation}", self._scene)
        app.router.add_get("/open/{code}", self._open)
        app.router.add_get("/{path:.*}", self._file)
        return app

    # `web.middleware` marks functions only.
    async def _guard_request(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        why = foreign(request.headers, self.hosts, origin=request.path == "/socket")
        if why:
            self.refused += 1
            return web.Response(status=403, text=why, headers=self._headers)
        response = await handler(request)
        if not response.prepared:
            for name, value in self._headers.items():
                response.headers.setdefault(name, value)
        return response

    @property
    def _guard(self) -> Middleware:
        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._guard_request(request, handler)

        return guard

    # -- a browser of our own -----------------------------------------------------------------

    def path_once(self, role: Role) -> str:
        """A path that leads a browser of this user to the page of a role, once: all users of the
        machine see the arguments of a browser that is started."""
        code = secrets.token_urlsafe(18)
        self._once[code] = self.tokens[role]
        return f"open/{code}"

    async def _open(self, request: web.Request) -> web.Response:
        code, transport = request.match_info["code"], request.transport
        client = transport.get_extra_info("peername") if transport is not None else None
        server = transport.get_extra_info("sockname") if transport is not None else None
        if code not in self._once or not (client and server and same_user(client[1], server[1])):
            self.refused += 1
            text = "this address was for one use: open one of those that the console printed"
            return web.Response(status=403, text=text)
        place = f"/#{self._once.pop(code)}"
        return web.Response(status=302, headers={"Location": place, "Cache-Control": "no-store"})

    # -- files --------------------------------------------------------------------------------

    async def _health(self, _: web.Request) -> web.Response:
        return web.Response(text="ok")

    async def _scene(self, request: web.Request) -> web.Response:
        role = self.tokens.of_header(request.headers.get("Authorization"))
        if role is None or not role.sees_truth:
            self.refused += 1
            return web.Response(status=403, text="this token does not show the scene")
        scene = self._station.scene
        found = None if scene is None else scene.scene(request.query.get("since", ""))
        if found is None or request.match_info["generation"] != str(found[0]):
            return web.Response(status=204)  # poses that are under way name the next one
        headers = {"Content-Encoding": "gzip"}
        return web.Response(body=found[1], content_type="application/json", headers=headers)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        accepted = request.headers.get("Accept-Encoding", "")
        path = request.match_info["path"]
        return page_file(self._files, path, self._headers, accepted=accepted)

    # -- sockets ------------------------------------------------------------------------------

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        socket = web.WebSocketResponse(
            max_msg_size=LONGEST, compress=True, timeout=2.0, writer_limit=0
        )
        await socket.prepare(request)
        _compress_only_what_says_so(socket)
        _hold_little(request)
        page = await self._hello(socket)
        if page is not None:
            admit(request)
            try:
                await self._serve(socket, page)
            finally:
                self._places.leave(page)
        return socket

    async def _hello(self, socket: web.WebSocketResponse) -> Page | None:
        """The page, once it has said who it is; None for one that does not."""
        station = self._station
        code, why = WSCloseCode.POLICY_VIOLATION, "say hello first, within 5 s"
        with contextlib.suppress(TimeoutError):
            first = await socket.receive(HELLO_TIME)
            if first.type is WSMsgType.TEXT:
                try:
                    request = messages.read(first.data)
                    found = self.tokens.seat(request.fields.get("token"))
                    if request.type == "hello" and found is not None:
                        role, seat = found
                        plan = station.settings.impairment
                        name = request.fields.get("name") or self._name(role, seat)
                        link = None
                        if plan is not None:
                            link = ImpairedLink(socket, plan.of(name), name)
                        way = socket if link is None else link
                        delay = station.settings.delay
                        page = Page(station.new_id(), name, role, way, station.now, delay, seat)
                        page.link, page.draws = link, request.fields.get("webgl", True)
                        page.deflate = int(socket.compress)
                        page.uptake.tells = request.fields.get("shown", False)
                        page.ready = not request.fields.get("ready", False)
                        self._give_place(page)
                        try:
                            await socket.send_json(self._welcome(page))
                        except BaseException:
                            self._places.leave(page)
                            raise
                        return page
                    why = "the token is wrong" if request.type == "hello" else why
                except PageError as error:
                    why = str(error)
                except NoPlaceError as error:
                    code, why = WSCloseCode.TRY_AGAIN_LATER, str(error)
        self.refused += 1
        await socket.close(code=code, message=why.encode()[:120])
        return None

    def _give_place(self, page: Page) -> None:
        """Give a page a place; the one that has been silent longest may lose its own.

        Raises:
            NoPlaceError: there is none for it.
        """
        lost = self._places.enter(page, leads=page.role is not Role.VIEWER)
        if lost is not None:
            lost.displaced = True
            lost.end()

    def _name(self, role: Role, seat: int) -> str:
        """Of a page that says none: its role, and the least free number from its seat on."""
        taken = {page.name for page in (*self._places, *self._station.pages.values())}
        names = (f"{role.value} {number}" for number in itertools.count(max(1, seat)))
        return next(name for name in names if name not in taken)

    def _welcome(self, page: Page) -> dict[str, object]:
        station = self._station
        features = dict(station.scene.features) if station.scene else {}
        names = ("scene", "takeover", "pace", "lines")
        allowed = {name: bool(features.get(name)) for name in names}
        allowed["scene"] = allowed["scene"] and page.role.sees_truth
        for name in ("pace", "lines"):
            allowed[name] = allowed[name] and page.role is Role.INSTRUCTOR
        greeting = station.server.greeting
        return {
            "type": "welcome",
            "page": page.id,
            "name": page.name,
            "role": page.role.value,
            "seat": page.seat,
            "device": station.settings.allowance.device if page.seat else "any",
            "server": {
                "address": str(station.server.address),
                "level": "" if greeting is None else greeting.level,
                "software": "" if greeting is None else greeting.game_type,
            },
            "features": allowed,
            "watchdog_s": DRIVE_TIME,
            "numbered": page.link is not None,
            "delay_s": station.settings.delay if page.role is Role.VIEWER else 0.0,
            "gateway_clock": station.wall,
        }

    async def _serve(self, socket: web.WebSocketResponse, page: Page) -> None:
        """Hear a page and talk to it until either ends."""
        station = self._station
        station.join(page)
        tasks: list[asyncio.Task[object]] = [
            asyncio.create_task(self._listen(socket, page)),
            asyncio.create_task(page.send_all()),
            asyncio.create_task(page.ended.wait()),
        ]
        if page.link is not None:
            tasks.append(asyncio.create_task(page.link.run()))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            station.leave(page)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            with contextlib.suppress(OSError, TimeoutError, RuntimeError):
                async with asyncio.timeout(3.0):
                    if page.displaced:
                        code, why = WSCloseCode.TRY_AGAIN_LATER, b"another page took this place"
                        await socket.close(code=code, message=why)
                    elif page.limits.exhausted or page.overrun:
                        await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b"too much")
                    else:
                        await socket.close()

    async def _listen(self, socket: web.WebSocketResponse, page: Page) -> None:
        async for message in socket:
            self._places.heard(page)
            if message.type is WSMsgType.TEXT:
                if not self._desk.admits(page, message.data):
                    pass
                elif page.link is None:
                    self._desk.take(page, message.data)
                else:
                    page.link.hear(message.data, lambda text: self._late(page, text))
            else:
                page.limits.hears(self._station.wall)
                page.limits.refuse()
                page.answer(-1, False, "pages send texts only")
            if page.limits.exhausted:
                return

    def _late(self, page: Page, text: str) -> None:
        """Take what a page said a while ago, if it is still there."""
        if page.id in self._station.pages:
            self._desk.take(page, text)
