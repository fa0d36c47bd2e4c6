"""What newcomers may cost a web server: connections, time, descriptors, processor and log lines."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import itertools
import resource
import socket
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

pytest.importorskip("aiohttp")


import aiohttp
from aiohttp import web

from usarsim_operator.places import NoPlaceError, PagePlaces
from usarsim_report import gate as gates
from usarsim_report.gate import Gate, GateLimits, admit, gated
from usarsim_server.testing import PATIENCE

BODY = b"x" * 8_000_000
HALF = b"GET / HTTP/1.1\r\nHost: x\r\nX-Half: "
WHOLE = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
GREETED = "hello"


class Site:
    """A gated application on this machine. answered: requests that its handlers have seen."""

    def __init__(self) -> None:
        self.port, self.answered = 0, 0
        self.app = web.Application()
        for path in ("/", "/large", "/slow", "/fails", "/socket"):
            self.app.router.add_get(path, getattr(self, f"_{path[1:] or 'first'}"))

    async def _first(self, _: web.Request) -> web.Response:
        self.answered += 1
        return web.Response(text="here")

    async def _large(self, _: web.Request) -> web.Response:
        return web.Response(body=BODY)

    async def _slow(self, _: web.Request) -> web.Response:
        self.answered += 1
        end = time.thread_time() + 0.02
        while time.thread_time() < end:
            pass
        return web.Response(text="at last")

    async def _fails(self, _: web.Request) -> web.Response:
        raise RuntimeError("a defect")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        found = web.WebSocketResponse()
        await found.prepare(request)
        if (await found.receive()).data == GREETED:
            admit(request)
            await found.send_str("welcome")
            await found.receive()
        return found

    @property
    def gate(self) -> Gate:
        return self.app[gates._GATE]

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def dial(self, first: bytes = b"", source: str = "127.0.0.1") -> socket.socket:
        """A connection that has sent something."""
        client = socket.socket()
        client.bind((source, 0))
        client.connect(("127.0.0.1", self.port))
        client.setblocking(False)
        client.send(first)
        return client


@contextlib.asynccontextmanager
async def site(**limits: float) -> AsyncIterator[Site]:
    """Serve it."""
    found = Site()
    async with gated(found.app, "127.0.0.1", 0, limits=GateLimits(**limits)) as found.port:  # type: ignore[arg-type]
        yield found


def ended(client: socket.socket) -> bool:
    """Whether the server has hung up."""
    try:
        return client.recv(65536) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


async def until(check: Callable[[], object]) -> None:
    """Wait until something is so."""
    async with asyncio.timeout(PATIENCE):
        while not check():  # noqa: ASYNC110 (what is looked at is a socket)
            await asyncio.sleep(0.01)


async def gone(client: socket.socket) -> None:
    """Wait until the server has hung up."""
    await until(lambda: ended(client))


async def fetched(url: str, path: str = "/") -> str:
    """What a newcomer is answered."""
    async with (
        asyncio.timeout(PATIENCE),
        aiohttp.ClientSession() as http,
        http.get(url + path) as answer,
    ):
        return await answer.text()


async def test_half_requests_keep_nobody_out(caplog: pytest.LogCaptureFixture) -> None:
    """1,100 half-sent requests hold the places that newcomers have and no more; others are
    answered meanwhile, and it is told once a second at most."""
    async with site() as one, contextlib.AsyncExitStack() as stack:
        for number in range(1100):
            stack.callback(one.dial(HALF).close)
            if number % 100 == 99:
                assert await fetched(one.url) == "here"
        limits = GateLimits()
        assert len(one.gate._newcomers) <= limits.newcomers
        assert len(one.gate._guests) <= limits.newcomers + 100  # of which some end just now
    told = [record.created for record in caplog.records]
    assert told
    assert all(later - before > 0.9 for before, later in itertools.pairwise(told))


async def test_who_says_nothing_whole_is_closed() -> None:
    """Neither single bytes nor an answer from before are a sign of life."""
    async with site(head=0.5) as one:
        silent, half, after = one.dial(), one.dial(HALF), one.dial(WHOLE)
        drip = one.dial(HALF)

        def dripped() -> bool:
            with contextlib.suppress(OSError):
                drip.send(b"x")
            return ended(drip)

        for client in (silent, half, after):
            await gone(client)
            client.close()
        await until(dripped)
        drip.close()
        async with aiohttp.ClientSession() as http, http.ws_connect(f"{one.url}/socket") as mute:
            assert (await mute.receive(PATIENCE)).type in (
                aiohttp.WSMsgType.CLOSED,
                aiohttp.WSMsgType.CLOSE,
                aiohttp.WSMsgType.ERROR,
            )


async def test_who_takes_no_answer_is_closed() -> None:
    """It is cut off, so that what waits for it is free again."""
    async with site(answer=0.5) as one:
        client = one.dial(WHOLE.replace(b"/ ", b"/large ", 1))
        await until(lambda: one.gate._guests)
        await until(lambda: not one.gate._guests)
        client.close()


async def test_pages_are_no_newcomers() -> None:
    """Who has said who it is keeps its connection, silent or not, among any number of others."""
    async with (
        site(head=0.3, newcomers=8) as one,
        aiohttp.ClientSession() as http,
        http.ws_connect(f"{one.url}/socket") as page,
    ):
        await page.send_str(GREETED)
        assert (await page.receive(PATIENCE)).data == "welcome"
        crowd = [one.dial(HALF) for _ in range(30)]
        await until(lambda: all(ended(client) for client in crowd))
        for client in crowd:
            client.close()
        assert not page.closed
        assert len(one.gate._guests) == 1
        assert not one.gate._newcomers


async def test_one_address_keeps_no_other_out() -> None:
    """The newcomer that gives way is of the address that holds most."""
    async with site(newcomers=8, per_address=6) as one, contextlib.AsyncExitStack() as stack:
        quiet = one.dial(b"", "127.0.0.2")
        stack.callback(quiet.close)
        await until(lambda: one.gate._by_address["127.0.0.2"])
        for _ in range(50):
            stack.callback(one.dial(HALF).close)
            stack.callback(one.dial(HALF, "127.0.0.3").close)
        await until(lambda: one.gate._by_address["127.0.0.3"])
        assert await fetched(one.url) == "here"
        assert one.gate._by_address["127.0.0.2"] == 1
        assert not ended(quiet)
        assert max(one.gate._by_address.values()) <= 6


def test_who_counts_as_one() -> None:
    """A machine has a /64 of IPv6 as a whole."""
    same = gates._shared
    assert same("2001:db8::1") == same("2001:db8::ffff:2") != same("2001:db8:0:1::1")
    assert same("::ffff:10.0.0.1") == same("10.0.0.1") != same("10.0.0.2")
    assert same("fe80::1%eth0") == same("fe80::2%eth0")


async def test_no_descriptors(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Where none is left a newcomer gives way, the log has a line, and nothing spins."""
    async with site() as one:
        held = one.dial(HALF)
        await until(lambda: one.gate._newcomers)
        loop, tried = asyncio.get_running_loop(), 0

        async def scarce(_: socket.socket) -> object:
            nonlocal tried
            tried += 1
            raise OSError(errno.EMFILE, "Too many open files")

        with monkeypatch.context() as patched:
            patched.setattr(loop, "sock_accept", scarce)
            one.dial(HALF).close()
            await until(lambda: tried)
            tried, begun = 0, loop.time()
            await asyncio.sleep(1.0)
            seconds = loop.time() - begun
        assert tried <= 2 + 10.0 * seconds
        await until(lambda: ended(held))
        held.close()
        assert await fetched(one.url) == "here"
    assert 1 <= len(caplog.records) <= 3
    assert "descriptors are used up" in caplog.text


def test_few_descriptors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newcomers get a quarter of what the process may have."""
    monkeypatch.setattr(resource, "getrlimit", lambda _: (100, 100))
    assert GateLimits().places == 25
    monkeypatch.setattr(resource, "getrlimit", lambda _: (20_000, 20_000))
    assert GateLimits().places == 128


async def test_requests_get_a_share_of_the_processor() -> None:
    """What many ask at full speed takes so much of one processor, and one who comes is answered."""
    async with site(share=0.2) as one, contextlib.AsyncExitStack() as stack:
        begun, used = time.monotonic(), time.thread_time()
        asked = WHOLE.replace(b"/ ", b"/slow ", 1) * 50
        for _ in range(8):
            stack.callback(one.dial(asked).close)
        await asyncio.sleep(2.0)
        assert await fetched(one.url) == "here"
        seconds, spent = time.monotonic() - begun, time.thread_time() - used
        assert 0.02 * one.answered <= 0.2 * (seconds + 1.0) + 0.1
        assert spent < 0.2 * (seconds + 1.0) + 1.0
        assert one.answered > 5


async def test_arrivals_are_paced() -> None:
    """So many connections a second are accepted; the kernel keeps the others."""
    async with site(arrivals=100.0) as one, contextlib.AsyncExitStack() as stack:
        begun = time.monotonic()
        for _ in range(200):
            stack.callback(one.dial().close)
        taken = 0

        def counted() -> bool:
            nonlocal taken
            taken = len(one.gate._guests) + len(one.gate._making)
            return taken >= 90

        await until(counted)
        assert time.monotonic() - begun > 0.5


async def test_junk_writes_no_log(caplog: pytest.LogCaptureFixture) -> None:
    """What is no HTTP is closed without a word; defects are told once a second, counted."""
    async with site(head=0.5) as one:
        junk = (
            *(b"\x16\x03\x01\x02\x00" + b"\0" * 500, b"GET\r\n\r\n", b"A" * 20_000 + b"\r\n"),
            b"GET / HTTP/1.1\r\nHost: x\r\nBad Header\r\n\r\n",
        )
        clients = [one.dial(first) for first in junk * 20]
        await until(lambda: all(map(ended, clients)))
        for client in clients:
            client.close()
        assert not caplog.records
        for _ in range(20):
            assert await fetched(one.url, "/fails") == "the request failed"
        assert await fetched(one.url, "/nowhere") == "Not Found"
    assert len(caplog.records) <= 3
    assert "a defect" in caplog.text


def test_no_file_is_larger_than_a_newcomer_may_hold(page_folder: Path) -> None:
    """Who takes nothing of an answer makes the server hold it once, and a head."""
    largest = max(one.stat().st_size for one in page_folder.iterdir())
    assert largest + gates.LONGEST_HEAD <= GateLimits().held_bytes


async def test_an_endless_head_is_cut_off() -> None:
    """What does not end within 16 KiB is none."""
    async with site() as one:
        client = one.dial(HALF + b"x" * gates.LONGEST_HEAD)
        await gone(client)
        client.close()


class TestPlaces:
    """Of three places one is kept for those who lead."""

    def places(self, *pages: str) -> PagePlaces[str]:
        """With pages; capitals lead."""
        places: PagePlaces[str] = PagePlaces(3, 1)
        for page in pages:
            assert places.enter(page, leads=page.isupper()) is None
        return places

    def test_a_full_house(self) -> None:
        """Who does not lead takes the place of the longest silent of its kind; who leads has one
        kept, then takes that of one who does not, then that of the longest silent of all."""
        places = self.places("a", "b")
        places.heard("a")
        assert places.enter("c", leads=False) == "b"
        assert places.enter("D", leads=True) is None
        assert places.enter("E", leads=True) == "a"
        assert places.enter("F", leads=True) == "c"
        places.heard("D")
        assert places.enter("G", leads=True) == "E"
        with pytest.raises(NoPlaceError):
            places.enter("h", leads=False)
        assert len(places) == 3
        assert "h" not in places

    def test_who_leaves(self) -> None:
        """A place that was left is free; one that was lost is left once more without harm."""
        places = self.places("a", "b")
        places.leave("a")
        assert places.enter("c", leads=False) is None
        assert places.enter("d", leads=False) == "b"
        places.heard("b")
        places.leave("b")
        assert len(places) == 2
