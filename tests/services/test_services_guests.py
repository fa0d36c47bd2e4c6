"""Connections that want nothing: who is closed, who makes room, who may stay."""

from __future__ import annotations

import asyncio
import contextlib
import socket

import pytest
from test_services_dialogue import Running, ground
from wireless_harness import Line
from wireless_harness import Running as Radio

from usarsim_server.services import port as guests
from usarsim_server.services.dialogue import DialogueLimits
from usarsim_server.services.port import GRACE, Guest, Guests
from usarsim_server.services.wireless import WirelessLimits
from usarsim_server.testing import eventually


class Party:
    """Guests with names, in a time that a test sets."""

    def __init__(self, idle: float = 300.0) -> None:
        self.now = 0.0
        self.left: list[str] = []
        self.guests = Guests("test", idle, lambda: self.now)

    def come(self, name: str) -> Guest:
        """Somebody comes."""
        guest = Guest(name, self.now, lambda: self.left.append(name))
        self.guests.add(guest)
        return guest


def party(idle: float = 300.0) -> Party:
    """A party on a loop, which only sweeping needs."""
    return Party(idle)


def test_who_asks_for_nothing_is_closed_and_who_asks_stays() -> None:
    """After the idle time, once; those with standing or patience stay."""

    async def play() -> list[str]:
        one = party()
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
        return one.left

    assert asyncio.run(play()) == ["silent"]


def test_room_is_made_by_the_one_who_was_silent_longest() -> None:
    """Not by those who work, nor by those with standing; patience does not help."""

    async def play() -> list[str]:
        one = party()
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
        return one.left

    assert asyncio.run(play()) == ["first", "second", "button"]


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever is silent makes room at once."""
    monkeypatch.setattr(guests, "GRACE", 0.0)


def test_idle_connections_hold_no_port(impatient: None) -> None:
    """Sixteen that say nothing fill a port of sixteen; the next one is served all the same."""
    running = Running(ground(limits=DialogueLimits(max_connections=16)))
    try:
        idle = [running.connect() for _ in range(16)]
        assert eventually(lambda: running.service.connections == 16)
        for _ in range(20):
            newcomer = running.connect()
            newcomer.send(b"GET it\n")
            assert newcomer.line() == b"GOT GET it\r\n"
        assert idle[0].ended()
        assert eventually(lambda: running.service.connections <= 16)
    finally:
        running.stop()


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
        robot.control.socket.settimeout(5.0)
        assert robot.control.ask("GETSS {Robot A}").endswith("{Error SS.To.Self}")


def test_an_idle_connection_of_a_port_is_closed() -> None:
    """The sweeper of a running service finds it, and junk is no request."""
    running = Running(ground(limits=DialogueLimits(idle=0.4)))
    try:
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
    finally:
        running.stop()


def test_twenty_half_requests_are_closed_too(impatient: None) -> None:
    """Bytes that never make a request do not keep a place."""
    running = Running(ground(limits=DialogueLimits(max_connections=4)))
    try:
        for _ in range(20):
            half = socket.create_connection((running.endpoint.host, running.endpoint.port))
            half.sendall(b"GETPOS")
        newcomer = running.connect()
        newcomer.send(b"GET it\n")
        assert newcomer.line() == b"GOT GET it\r\n"
    finally:
        running.stop()
