"""A port's share of the processor: who waits, for how long, and what all get together; and its
guests that want nothing: who is closed, who makes room, who may stay.
"""

from __future__ import annotations

import asyncio
import contextlib
import heapq
import socket
import time
from collections.abc import Callable, Coroutine

import pytest
from services_harness import LoopClock, words
from test_services_dialogue import Running, ground
from wireless_harness import Line
from wireless_harness import Running as Radio

from usarsim_server.services import port as guests_module
from usarsim_server.services.budget import (
    BURST,
    LEAST,
    ON_PACE,
    TURN_COST,
    WINDOW,
    Account,
    Pace,
    WorkBudget,
)
from usarsim_server.services.control import ControlLimits
from usarsim_server.services.dialogue import DialogueLimits
from usarsim_server.services.port import GRACE, Guest, Guests
from usarsim_server.services.wireless import WirelessLimits
from usarsim_server.testing import PATIENCE, eventually

SHARE = 0.05


class Clock:
    """Time that passes when a test says so; work takes as long as the test charges."""

    def __init__(self) -> None:
        self.now = 0.0
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._number = 0
        self._tasks: list[asyncio.Task[None]] = []

    def start(self, work: Coroutine[None, None, None]) -> None:
        """Have something done until the end of the test."""
        self._tasks.append(asyncio.create_task(work))

    def __call__(self) -> float:
        return self.now

    def call_later(self, seconds: float, act: Callable[[], None]) -> None:
        """Remember what is to be done."""
        self._number += 1
        heapq.heappush(self._timers, (self.now + seconds, self._number, act))

    async def run_until(self, moment: float) -> None:
        """Let time pass, and everybody do what is due."""
        while self._timers and self._timers[0][0] <= moment:
            self.now, _, act = heapq.heappop(self._timers)
            act()
            for _ in range(5):
                await asyncio.sleep(0)
        self.now = moment

    def budget(self, share: float = SHARE) -> WorkBudget:
        """A budget in this time."""
        return WorkBudget(share, clock=self, work_clock=self, call_later=self.call_later)


async def insist(budget: WorkBudget, cost: float, turns: list[float], clock: Clock) -> None:
    """Work without pause."""
    account = budget.newcomer()
    while True:
        await budget.turn(account)
        budget.charge(account, cost)
        turns.append(clock.now)


def crowd(budget: WorkBudget, clock: Clock) -> list[float]:
    """Thirty who insist until the end of the test; when they had their turns."""
    turns = list[float]()
    for _ in range(30):
        clock.start(insist(budget, 0.001, turns, clock))
    return turns


@pytest.mark.slow
async def test_thirty_who_insist_get_the_share_and_no_more() -> None:
    """In ten seconds all together use what is theirs, what was saved up, and one turn."""
    clock = Clock()
    budget = clock.budget()
    turns = crowd(budget, clock)
    await asyncio.sleep(0)
    await clock.run_until(10.0)
    used = len(turns) * (0.001 + TURN_COST)
    assert 0.9 * 10 * SHARE < used <= 10 * SHARE + BURST + 0.002


@pytest.mark.slow
async def test_who_asks_little_waits_for_one_turn_of_the_others_and_not_for_all() -> None:
    """Ten requests a second beside thirty clients that insist: each is served within the time that
    pays for two turns, where a queue would take that of thirty."""
    clock = Clock()
    budget = clock.budget()
    crowd(budget, clock)
    modest, waits = budget.newcomer(), list[float]()

    async def ask() -> None:
        asked = clock.now
        await budget.turn(modest)
        budget.charge(modest, 0.0001)
        waits.append(clock.now - asked)

    for number in range(100):
        await clock.run_until(2.0 + 0.1 * number)
        clock.start(ask())
        await asyncio.sleep(0)
    await clock.run_until(13.0)
    assert len(waits) == 100
    assert max(waits) <= 2.5 * (0.001 + TURN_COST) / SHARE


async def test_nobody_waits_while_there_is_time() -> None:
    """What was saved up is there at once, and silence saves no more than that."""
    clock = Clock()
    budget, turns = clock.budget(), list[float]()
    await clock.run_until(1000.0)
    clock.start(insist(budget, 0.001 - TURN_COST, turns, clock))
    await asyncio.sleep(0)
    assert len(turns) == pytest.approx(BURST / 0.001, abs=1.5)


async def test_who_has_gone_keeps_nobody_waiting() -> None:
    """A client that leaves the queue takes no turn."""
    clock = Clock()
    budget = clock.budget()
    budget.charge(budget.newcomer(), 1.0)
    waiting = [asyncio.create_task(budget.turn(Account())) for _ in range(3)]
    await asyncio.sleep(0)
    assert budget.waiting == 3
    for one in waiting[:2]:
        one.cancel()
    await asyncio.sleep(0)
    assert budget.waiting == 1
    await clock.run_until(100.0)
    assert sum(one.done() and not one.cancelled() for one in waiting) == 1


async def test_work_is_charged_by_its_processor_time() -> None:
    """What happens inside, as the clock of the thread says."""
    clock = Clock()
    budget = clock.budget()
    account = budget.newcomer()
    before = account.used
    with budget.work(account):
        clock.now += 0.25
    assert account.used - before == pytest.approx(0.25)


def test_a_world_that_falls_behind_comes_first() -> None:
    """On pace the whole share, at any speed; 0.05 below it half; far behind the least; and back."""
    clock, simulated = Clock(), 0.0

    def play(factor: float) -> float:
        nonlocal simulated
        clock.now += WINDOW
        simulated += 2.0 * factor * WINDOW
        return pace()

    pace = Pace(lambda: simulated, lambda: 2.0, clock)
    assert pace() == 1.0
    assert play(1.0) == play(ON_PACE + 0.001) == 1.0
    assert play(ON_PACE - 0.05) == pytest.approx(0.5)
    assert play(0.5) == play(0.0) == LEAST
    assert play(1.0) == 1.0


async def test_a_port_waits_while_the_world_is_behind() -> None:
    """What thirty who insist get is the part of the share that the pace allows."""
    clock = Clock()
    budget = WorkBudget(
        SHARE, clock=clock, work_clock=clock, call_later=clock.call_later, pace=lambda: LEAST
    )
    turns = crowd(budget, clock)
    await asyncio.sleep(0)
    await clock.run_until(10.0)
    assert len(turns) * (0.001 + TURN_COST) <= 10 * SHARE * LEAST + BURST + 0.002


@pytest.mark.slow
async def test_a_newcomer_does_not_wait_for_a_crowd() -> None:
    """Who comes while thirty insist has his first answer after one turn of theirs or two."""
    clock = Clock()
    budget, begun = clock.budget(), 5.0
    crowd(budget, clock)
    await asyncio.sleep(0)
    await clock.run_until(begun)
    clock.start(insist(budget, 0.0001, came := list[float](), clock))
    await asyncio.sleep(0)
    await clock.run_until(10.0)
    assert came[0] - begun <= 2.5 * (0.001 + TURN_COST) / SHARE


class Party:
    """Guests with names, in a time that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0
        self.left: list[str] = []
        self.guests = Guests("test", 300.0, lambda: self.now)

    def come(self, name: str) -> Guest:
        """Somebody comes."""
        guest = Guest(name, self.now, lambda: self.left.append(name))
        self.guests.add(guest)
        return guest


async def test_who_asks_for_nothing_is_closed_and_who_asks_stays() -> None:
    """After the idle time, once; those with standing or patience stay."""
    one = Party()
    one.come("silent")
    busy, listener, button = (one.come(name) for name in ("busy", "listener", "button"))
    listener.standing = lambda: True
    button.patient = True
    one.now = 299.0
    one.guests.heard(busy)
    one.guests.sweep()
    assert one.left == []
    one.now = 301.0
    one.guests.sweep()
    one.guests.sweep()
    assert len(one.guests) == 3
    assert one.left == ["silent"]


async def test_room_is_made_by_the_one_who_was_silent_longest() -> None:
    """Not by those who work, nor by those with standing; patience does not help."""
    one = Party()
    robot = one.come("robot")
    robot.standing = lambda: True
    for name in ("first", "second", "button"):
        one.now += 1.0
        one.come(name).patient = name == "button"
    assert not one.guests.make_room()
    one.now = GRACE + 10.0
    one.come("new")
    for _ in range(3):
        assert one.guests.make_room()
    assert not one.guests.make_room()
    assert one.left == ["first", "second", "button"]


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever is silent makes room at once."""
    monkeypatch.setattr(guests_module, "GRACE", 0.0)


def test_idle_connections_hold_no_port(impatient: None) -> None:
    """Sixteen that say nothing fill a port of sixteen; the next one is served all the same."""
    with Running(ground(limits=DialogueLimits(max_connections=16))) as running:
        idle = [running.connect() for _ in range(16)]
        assert eventually(lambda: running.service.connections == 16)
        for _ in range(20):
            newcomer = running.connect()
            newcomer.send(b"GET it\n")
            assert newcomer.line() == b"GOT GET it\r\n"
        assert idle[0].ended()
        assert eventually(lambda: running.service.connections <= 16)


def test_a_robot_that_listens_keeps_its_place(impatient: None) -> None:
    """On the wireless port a robot of the world stays however silent; strangers make room."""
    limits = WirelessLimits(max_connections=4, poll=0.02)
    with Radio(Line(A=0), limits=limits, owners={"a": "127.0.0.1"}) as running:
        robot = running.robot("A")
        for _ in range(12):
            running.talker().ask("GETSS {Robot A}")
        robot.control.socket.settimeout(0.3)
        with pytest.raises(TimeoutError):
            robot.control.socket.recv(1)
        robot.control.socket.settimeout(PATIENCE)
        assert robot.control.ask("GETSS {Robot A}").endswith("{Error SS.To.Self}")


def test_an_idle_connection_of_a_port_is_closed() -> None:
    """The sweeper of a running service finds it, and junk is no request."""
    with Running(ground(limits=DialogueLimits(idle=0.4))) as running:
        silent, noisy = running.connect(), running.connect()
        with contextlib.suppress(OSError, TimeoutError):
            for _ in range(100):
                noisy.socket.settimeout(0.05)
                noisy.send(b"JUNK\n")
                with contextlib.suppress(TimeoutError):
                    if noisy.socket.recv(1) == b"":
                        break
        assert silent.ended()
        assert eventually(lambda: running.service.connections == 0)


def test_twenty_half_requests_are_closed_too(impatient: None) -> None:
    """Bytes that never make a request do not keep a place."""
    with Running(ground(limits=DialogueLimits(max_connections=4))) as running:
        for _ in range(20):
            half = socket.create_connection((running.endpoint.host, running.endpoint.port))
            half.sendall(b"GETPOS")
        newcomer = running.connect()
        newcomer.send(b"GET it\n")
        assert newcomer.line() == b"GOT GET it\r\n"


def test_client_that_wants_nothing_is_closed(control, caplog) -> None:
    """Without a command and without an INIT the end comes, with one log line."""
    server = control(ControlLimits(idle=0.3))
    client, session = server.pair()
    assert client.line() == b""
    assert eventually(lambda: session.closes == 1)
    [record] = [one for one in caplog.records if "idle" in one.getMessage()]
    assert record.usarsim_facts["connection"] == session.peer


def test_bytes_that_make_no_line_do_not_count(control) -> None:
    """Who drips a byte now and then wants nothing, either."""
    server = control(ControlLimits(idle=0.5))
    client, session = server.pair()
    deadline = time.monotonic() + PATIENCE
    while session.closes == 0 and time.monotonic() < deadline:
        try:
            client.send(b"D")
        except OSError:
            break
        time.sleep(0.05)
    assert eventually(lambda: session.closes == 1)


def test_client_that_asked_for_a_robot_may_be_silent(control) -> None:
    """As long as it has one; who has not, for example because INIT failed, is closed."""
    server = control(ControlLimits(idle=100.0))
    clock = LoopClock(server.loop)
    client, session = server.pair()
    client.send(b"INIT {ClassName P2AT}\r\n")
    failed, other = server.pair()
    failed.send(b"INIT {ClassName Nobody} {Fail}\r\n")
    assert eventually(lambda: words(session) == words(other) == ["INIT"])
    clock.turn(110.0)
    assert failed.line() == b""
    assert eventually(lambda: other.closes == 1)
    assert session.closes == 0
    session.has_role = False
    clock.turn(110.0)
    assert client.line() == b""
    patient = control(ControlLimits(idle=0.0)).connect()
    assert patient.silent_for(0.5)


def test_who_only_sits_there_makes_room(control, monkeypatch, caplog) -> None:
    """When all places are taken the silent ones without a robot leave, the longest silent first."""
    monkeypatch.setattr(guests_module, "GRACE", 0.2)
    server = control(ControlLimits(max_connections=3))
    robot, session = server.pair()
    robot.send(b"INIT {ClassName P2AT}\r\n")
    assert eventually(lambda: session.has_role)
    first, one = server.pair()
    second, other = server.pair()
    time.sleep(0.3)
    second.send(b"GETCONF {Name x}\r\n")
    assert second.line() == b"CONF {Name x}\r\n"
    server.connect()
    assert first.line() == b""
    assert (session.closes, one.closes, other.closes) == (0, 1, 0)
    assert any("the port is full" in message for message in caplog.messages)


def test_client_that_asks_now_and_then_stays(control) -> None:
    """Every command begins the time anew."""
    server = control(ControlLimits(idle=100.0))
    clock = LoopClock(server.loop)
    client, session = server.pair()
    for _ in range(4):
        client.send(b"GETCONF {Name x}\r\n")
        assert client.line() == b"CONF {Name x}\r\n"
        clock.turn(60.0)
    assert session.closes == 0
    clock.turn(60.0)
    assert eventually(lambda: session.closes == 1)
