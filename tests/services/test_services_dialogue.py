"""Services that answer: order, framing, slow readers, floods, the end of everything."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from services_harness import Client, OnLoop, eventually

from usarsim_server.base.errors import ServiceError, UsarsimError
from usarsim_server.protocol.grammar import LineFramer
from usarsim_server.services.dialogue import (
    Desk,
    DialogueLimits,
    DialogueService,
    Instant,
    ground_truth_service,
    responder,
    truth_service,
)
from usarsim_server.services.replies import ReplyBuffer
from usarsim_server.testing import PATIENCE


class Running(OnLoop):
    """A service that answers."""

    def __init__(self, service: DialogueService) -> None:
        super().__init__(service)
        self.service = service
        [self.endpoint] = self.begin()

    def connect(self, **sizes: int) -> Client:
        """A client."""
        return Client((self.endpoint.host, self.endpoint.port), **sizes)


Start = Callable[[DialogueService], Running]


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts services; they end with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda service: stack.enter_context(Running(service))


def echo(lines: object) -> list[str | None]:
    """Answers every line that begins with `GET` by itself."""
    assert isinstance(lines, list)
    return [f"GOT {line}" if line.startswith("GET") else None for line in lines]


def ground(answers: Callable[..., list[str | None]] = echo, **options: object) -> DialogueService:
    """A ground truth service on any free port."""
    return ground_truth_service("127.0.0.1", 0, responder(answers), **options)  # type: ignore[arg-type]


def test_nothing_is_said_on_connecting(start: Start) -> None:
    """Side channels 47: the client speaks first."""
    assert start(ground()).connect().silent_for(0.3)


def test_requests_are_answered_in_order_however_they_arrive(start: Start) -> None:
    """Side channels 54, 55, 61: several in one segment, one in several, unknown ones not at all, CR
    LF behind."""
    client = start(ground()).connect()
    client.send(b"GET1\r\nGET2\n\nHELLO\rGET3\r\n")
    assert [client.line() for _ in range(3)] == [b"GOT GET1\r\n", b"GOT GET2\r\n", b"GOT GET3\r\n"]
    for piece in (b"GE", b"T", b"4\r", b"\nGET5\n"):
        client.send(piece)
        time.sleep(0.01)
    assert [client.line() for _ in range(2)] == [b"GOT GET4\r\n", b"GOT GET5\r\n"]
    assert client.silent_for(0.1)


def test_an_empty_reply_is_an_empty_line(start: Start) -> None:
    """Side channels 60: an incomplete request is answered by CR LF alone."""
    client = start(ground(lambda lines: [""])).connect()
    client.send(b"GETOBS {From a}\r\n")
    assert client.line() == b"\r\n"


def test_answers_are_worked_out_beside_the_event_loop(start: Start) -> None:
    """An answer that waits for the physics holds up neither the loop nor another client."""
    gate, threads = threading.Event(), []

    def slow(lines: list[str]) -> list[str | None]:
        threads.append(threading.current_thread())
        if lines == ["GET slow"]:
            gate.wait(PATIENCE)
        return echo(lines)

    running = start(ground(slow))
    patient, quick = running.connect(), running.connect()
    patient.send(b"GET slow\n")
    assert eventually(lambda: bool(threads))
    quick.send(b"GET quick\n")
    assert quick.line() == b"GOT GET quick\r\n"
    gate.set()
    assert patient.line() == b"GOT GET slow\r\n"
    assert running.thread not in threads


def test_who_does_not_read_is_not_asked_further(start: Start) -> None:
    """Slow readers: the server stops working for them, remembers nothing and serves the others."""
    served = []

    def large(lines: list[str]) -> list[str | None]:
        served.append(len(lines))
        return ["x" * 5000 for _ in lines]

    running = start(ground(large, limits=DialogueLimits(receive_buffer=8192, send_buffer=8192)))
    lazy = running.connect(receive_buffer=4096)
    lazy.socket.settimeout(0.5)
    with contextlib.suppress(TimeoutError):
        while True:
            lazy.send(b"GETPOS\r\n" * 1000)
    before = 0

    def at_rest() -> bool:
        nonlocal before
        time.sleep(0.2)
        last, before = before, sum(served)
        return 0 < before == last

    assert eventually(at_rest)
    assert before < 3000
    other = running.connect()
    other.send(b"GETPOS\r\n")
    assert len(other.line()) == 5002
    lazy.socket.settimeout(PATIENCE)
    for _ in range(before):
        assert lazy.line() == b"x" * 5000 + b"\r\n"


def test_who_hangs_up_in_the_middle_disturbs_nobody(start: Start) -> None:
    """Side channels 97: a query and an immediate end, a reset, half a request: the others do not
    notice."""
    running = start(ground())
    stay = running.connect()
    for farewell in (b"GET1\r\n" * 50, b"GET", b""):
        for reset in (False, True):
            leaving = running.connect()
            leaving.send(farewell)
            if reset:
                leaving.socket.setsockopt(
                    socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0"
                )
            leaving.socket.close()
    assert eventually(lambda: running.service.connections == 1)
    stay.send(b"GET2\n")
    assert stay.line() == b"GOT GET2\r\n"


def test_long_lines_do_no_harm(start: Start) -> None:
    """A line without end is thrown away; the next request is answered."""
    client = start(ground()).connect()
    client.send(b"GET" + b"x" * 200_000 + b"\r\nGET2\r\n")
    assert client.line() == b"GOT GET2\r\n"


def test_bytes_of_any_kind_come_back_unharmed(start: Start) -> None:
    """Names are bytes of the client's own code page; the server passes them on."""
    client = start(ground()).connect()
    client.send(b"GET {From \xe4\xff\x00\x07}\r\n")
    assert client.line() == b"GOT GET {From \xe4\xff\x00\x07}\r\n"


def test_a_world_that_has_ended_ends_the_conversation_only(start: Start) -> None:
    """Once the physics is gone a question closes its connection and nothing else."""

    def ended(lines: list[str]) -> list[str | None]:
        raise UsarsimError("the simulation has ended")

    running = start(ground(ended))
    client, other = running.connect(), running.connect()
    client.send(b"GETPOS\n")
    assert client.line() == b""
    assert other.silent_for(0.1)


def test_a_defect_closes_one_connection_only(start: Start) -> None:
    """An answer that fails ends that conversation; the service goes on."""

    def broken(lines: list[str]) -> list[str | None]:
        if lines == ["GET bug"]:
            raise RuntimeError("a defect")
        return echo(lines)

    running = start(ground(broken))
    client, other = running.connect(), running.connect()
    client.send(b"GET bug\n")
    assert client.line() == b""
    other.send(b"GET2\n")
    assert other.line() == b"GOT GET2\r\n"


def test_a_busy_port_names_its_own_option(start: Start) -> None:
    """The error says which port is taken and how to choose another, for either service."""
    running = start(ground())
    port = running.endpoint.port
    for service in (
        ground_truth_service("127.0.0.1", port, responder(echo), required=True),
        truth_service("127.0.0.1", port, str),
    ):
        option = f"--{service.name}-port"
        with pytest.raises(ServiceError, match=rf"port {port} is already in use .*{option} N"):
            running.call(service.start())
    assert ground_truth_service("127.0.0.1", port, responder(echo), required=True).required
    assert not truth_service("127.0.0.1", port, str).required


# -- the truth service ---------------------------------------------------------------------------


def listing(line: str) -> str:
    """A listing of one actor called like the query."""
    return f"{{Name {line}}}\r\n{{End}}\r\n"


def truth(answer: Callable[[str], str] = listing) -> DialogueService:
    """A truth service on any free port."""
    return truth_service("127.0.0.1", 0, answer)


def test_every_line_is_a_query_even_an_empty_one(start: Start) -> None:
    """Side channels 88, 89: CR LF alone is answered, a split CR LF once."""
    client = start(truth()).connect()
    assert client.silent_for(0.2)
    client.send(b"\r\n")
    assert [client.line(), client.line()] == [b"{Name }\r\n", b"{End}\r\n"]
    client.send(b"{Actors}\r")
    time.sleep(0.05)
    client.send(b"\n")
    assert [client.line(), client.line()] == [b"{Name {Actors}}\r\n", b"{End}\r\n"]
    assert client.silent_for(0.2)


def test_a_listing_arrives_in_one_piece(start: Start) -> None:
    """Side channels 95: 64 actors in the first read after data is there."""
    whole = "".join(f"{{Name P3AT_{n}}} {'x' * 100}\r\n" for n in range(64)) + "{End}\r\n"
    client = start(truth(lambda line: whole)).connect()
    for _ in range(5):
        client.send(b"\r\n")
        assert client.socket.recv(1 << 20) == whole.encode()


def test_who_asks_without_pause_is_answered_at_the_rate_of_frames(start: Start) -> None:
    """Side channels 7: a tool that asks in a tight loop gets sixty listings a second at most, each
    of them, and costs no core."""
    client = start(truth()).connect()
    begun = time.monotonic()
    client.send(b"\r\n" * 13)
    lines = [client.line() for _ in range(26)]
    assert lines == [b"{Name }\r\n", b"{End}\r\n"] * 13
    assert time.monotonic() - begun >= 12 / 60 - 0.02


def test_flood_of_requests_is_answered_at_the_rate(start: Start) -> None:
    """Who asks faster than the rate waits for its answers; nothing is lost, others do not wait."""
    service = DialogueService(
        "dialogue",
        "127.0.0.1",
        0,
        "--port",
        LineFramer,
        lambda lines: [line + b"\n" for line in lines],
        limits=DialogueLimits(rate=200.0),
    )
    running = start(service)
    client, other = running.connect(), running.connect()
    begun = time.monotonic()
    client.send(b"".join(b"%d\n" % number for number in range(600)))
    other.send(b"hello\n")
    assert other.line() == b"hello\n"
    assert [client.line() for _ in range(600)] == [b"%d\n" % number for number in range(600)]
    assert time.monotonic() - begun > 1.0


# -- answers of one instant ----------------------------------------------------------------------


class Town:
    """Counts what is asked; who is there, and what time it is, a test decides."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.people = ("A",)
        self.now = 0.0

    def answers(self, lines: object) -> list[str | None]:
        """Everybody's name."""
        assert isinstance(lines, list)
        self.asked += lines
        return [f"{line} {self.people} {self.now}" for line in lines]


def test_what_is_asked_again_within_an_instant_gets_the_same_text() -> None:
    """Whoever asks; an instant later, or when somebody has come, it is worked out anew."""
    town = Town()
    span = Instant(0.02, lambda: town.people)
    desk = Desk("test", responder(town.answers), DialogueLimits(), span, lambda: town.now)

    async def ask(lines: list[bytes]) -> bytes:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            await desk.answer(lines, ReplyBuffer(ours), desk.budget.newcomer())
            return theirs.recv(65536)

    async def play() -> None:
        positions, _ = (await ask([b"GETPOS", b"GETOBS"])).splitlines(keepends=True)
        town.now = 0.015
        assert await ask([b"GETPOS"] * 50) == positions * 50
        assert town.asked == ["GETPOS", "GETOBS"]
        town.now = 0.025
        assert b"0.025" in await ask([b"GETPOS"])
        town.people = ("A", "B")
        assert b"B" in await ask([b"GETPOS"])
        assert town.asked == ["GETPOS", "GETOBS", "GETPOS", "GETPOS"]

    try:
        asyncio.run(play())
    finally:
        desk.close()


def test_what_is_known_of_an_instant_is_told_at_once() -> None:
    """On the event loop, without a thread; in order among what has to be worked out, and a few
    lines at a time, so that others have a turn between them."""
    town, told, others = Town(), list[bytes](), list[int]()
    busy = asyncio.Event()

    def known(line: bytes) -> bytes | None:
        if not line.startswith(b"KNOWN"):
            return None
        told.append(line)
        return line + b"!\r\n"

    limits = DialogueLimits(share=math.inf)
    desk = Desk("test", responder(town.answers), limits, Instant(0.0, int, known))

    async def look_on() -> None:
        while not busy.is_set():
            others.append(len(told))
            await asyncio.sleep(0)

    async def play() -> None:
        watcher = asyncio.create_task(look_on())
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            lines = [b"KNOWN %d" % number for number in range(40)]
            replies = ReplyBuffer(ours)
            await desk.answer([*lines, b"ASK", b"KNOWN"], replies, desk.budget.newcomer())
            text = theirs.recv(65536).splitlines()
        busy.set()
        await watcher
        # What comes behind something that has to be worked out is worked out with it.
        assert text == [*(line + b"!" for line in lines), b"ASK ('A',) 0.0", b"KNOWN ('A',) 0.0"]

    try:
        asyncio.run(play())
    finally:
        desk.close()
    assert town.asked == ["ASK", "KNOWN"]
    assert max(b - a for a, b in itertools.pairwise(others)) <= 8


def test_a_reply_that_nobody_allowed_ends_the_conversation(start: Start) -> None:
    """The stated length is kept whatever a service makes; others do not notice."""
    running = start(ground(lambda lines: ["x" * 100_000 for _ in lines]))
    client, other = running.connect(), running.connect()
    client.send(b"GETPOS\n")
    assert client.ended()
    assert other.silent_for(0.1)
