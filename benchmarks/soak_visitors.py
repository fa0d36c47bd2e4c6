"""Everybody who comes and goes during a soak: robots of all classes, and clients of all ports."""

from __future__ import annotations

import contextlib
import itertools
import random
import socket
import threading
from collections.abc import Iterator, Mapping, Sequence

from hostile.links import Damage, Link, Site, work

from benchmarks.relay import Radio
from usarsim_bench.figures import BenchError
from usarsim_client import Closing
from usarsim_server.base.errors import UsarsimError

GUESTS = 10
"""Robots at the same time that come and go."""
STAY = 20.0
"""s that a visitor stays, about."""
DRIVE_EVERY = 0.5
RADIO_EVERY = 20.0
"""s between two links by radio."""
RADIO_BYTES = 1 << 18
_BLOCK = 1 << 16
_PATIENCE = 10.0

DRIVE = b"DRIVE {Left 1.5} {Right -0.5}\r\n"
OBJECTS = (b"Box", b"WCCrate", b"Ball", b"Barrel", b"Gear", b"Table", b"Pipe", b"TrafficCone")
PEOPLE = (b"NewMale", b"NewFemale", b"Worker", b"Rescuer")


class _Guest(Link):
    """A robot of another class each time."""

    def __init__(self, port: int, number: int, classes: Iterator[str], tags: Sequence[str]) -> None:
        self.spoke: set[str] = set()
        self.visits = 0
        self._class = ""
        self._number, self._classes, self._tags = number, classes, tags
        # Different times, so that they do not all come at once.
        lives = STAY * (0.6 + 0.8 * number / GUESTS)
        super().__init__(port, self._arrive, DRIVE, every=DRIVE_EVERY, reads=True, lives=lives)

    def _arrive(self, count: int) -> bytes:
        self._class, self.visits = next(self._classes), count + 1
        tag = self._tags[(self._number + count) % len(self._tags)]
        name = f"Guest{self._number}_{count}"
        return f"INIT {{ClassName {self._class}}} {{Name {name}}} {{Start {tag}}}\r\n".encode()

    def _drain(self, damage: Damage) -> None:
        assert self._client is not None
        data = self._client.recv(_BLOCK)
        if not data:
            raise ConnectionResetError
        damage.received += len(data)
        if b"STA " in data:
            self.spoke.add(self._class)


class Visitors(Closing):
    """All of them, on threads of their own, while it is open as a context manager.

    Attributes:
        damage: what passed over their connections.
        failures: radio links that could not be used.
        links: radio links that carried all that was sent.
    """

    def __init__(
        self, ports: Mapping[str, int], classes: Sequence[str], tags: Sequence[str], seed: int
    ) -> None:
        """Let them come to the ports of a server, by the names of its READY line, on start poses.

        All classes come in turn; the seed is that of their order.
        """
        self.damage, self.failures, self.links = Damage(), 0, 0
        self._ports = ports
        turns = _in_turn(classes, seed)
        self._guests = [_Guest(ports["control"], n, turns, tags) for n in range(GUESTS)]
        others = [_others(ports, name) for name in ports if name != "control"]
        everybody = [*self._guests, _builder(ports["control"]), _walker(ports["control"])]
        everybody += itertools.chain.from_iterable(others)
        self._ended = threading.Event()
        self._threads = [
            threading.Thread(target=work, args=(everybody, self._ended, self.damage), daemon=True),
            threading.Thread(target=self._talk, daemon=True),
        ]
        self._everybody = everybody
        for thread in self._threads:
            thread.start()

    @property
    def visits(self) -> int:
        """Robots that came."""
        return sum(guest.visits for guest in self._guests)

    @property
    def seen(self) -> set[str]:
        """Classes of which a robot was in the world and said so."""
        return set().union(*(guest.spoke for guest in self._guests))

    def close(self) -> None:
        """Let all of them leave; a second call does nothing."""
        self._ended.set()
        for thread in self._threads:
            thread.join(2.0 * _PATIENCE)
        for link in self._everybody:
            link.close()

    def _talk(self) -> None:
        """Links by radio between two of those who stay, in both wireless simulations."""
        while not self._ended.wait(RADIO_EVERY):
            for talk in (self._relay, self._older):
                try:
                    talk()
                    self.links += 1
                except (OSError, UsarsimError, KeyError):
                    self.failures += 1

    def _relay(self) -> None:
        with contextlib.ExitStack() as stack:
            one, other = (
                stack.enter_context(contextlib.closing(Radio(self._ports["wireless"], name)))
                for name in ("R1", "R2")
            )
            ends = one.call(other)
            _carry(*(stack.enter_context(end) for end in ends))

    def _older(self) -> None:
        site = Site(self._ports)
        with contextlib.ExitStack() as stack:
            stack.callback(_hang_up, site)
            client = site.dial(self._ports["comserver"])
            (one, here), (other, there) = site.listen(), site.listen()
            for name in (b"R1", b"R2"):
                site.ask(client, b"REGISTER %s 127.0.0.1;" % name, b";")
            site.ask(client, b"LISTEN R2 %d;" % there, b";")
            site.ask(client, b"OPEN R1 %d R2 %d;" % (here, there), b";")
            for listening in (one, other):
                listening.settimeout(_PATIENCE)
                end = stack.enter_context(listening.accept()[0])
                end.sendall(b"SEND 5 hello")


def _hang_up(site: Site) -> None:
    for client in site.kept:
        client.close()


def _carry(mine: socket.socket, theirs: socket.socket) -> None:
    """Send a block over a link and wait until all of it is there."""
    theirs.settimeout(_PATIENCE)
    left = RADIO_BYTES
    sender = threading.Thread(target=mine.sendall, args=(bytes(left),), daemon=True)
    sender.start()
    while left > 0:
        data = theirs.recv(_BLOCK)
        if not data:
            raise BenchError("a link by radio ended early")
        left -= len(data)
    sender.join(_PATIENCE)


def _in_turn(classes: Sequence[str], seed: int) -> Iterator[str]:
    """All classes in an order, then in another one, for ever."""
    dice = random.Random(seed)
    while True:
        yield from dice.sample(classes, len(classes))


def _builder(port: int) -> Link:
    """A world controller whose objects are others each time."""

    def first(count: int) -> bytes:
        kinds = [OBJECTS[(count + number) % len(OBJECTS)] for number in range(4)]
        return b"INIT {ClassName USARBot.WorldController} {Name WC}\r\n" + b"".join(
            b"CONTROL {Type Create} {ClassName %s} {Name Thing%d} {Location %d,3,-2} {Physics %s}"
            b"\r\n" % (kind, number, 2 * number, (b"RigidBody", b"None")[number % 2])
            for number, kind in enumerate(kinds)
        )

    return Link(port, first, b"CONTROL {Type GetSTA}\r\n", every=1.0, reads=True, lives=STAY)


def _walker(port: int) -> Link:
    """A person who walks to and fro."""

    def first(count: int) -> bytes:
        kind = PEOPLE[count % len(PEOPLE)]
        return (
            b"INIT {ClassName USARAvatar.USARAvatar%s} {Name Walker} {Location 0,4,-1}\r\n"
            b"MOVE {Type Walk_Forward} {Action New} {Location 4,4}\r\n" % kind
        )

    again = b"MOVE {Type Walk_Forward} {Action Append} {Location 0,4}\r\n"
    return Link(port, first, again, every=5.0, reads=True, lives=STAY)


def _others(ports: Mapping[str, int], name: str) -> Sequence[Link]:
    """Clients of a side channel: one that stays, one that comes and goes."""
    questions = {
        "images": b"OK",
        "groundtruth": b"GETPOS\r\nGETOBS {From R1} {To R2}\r\n",
        "truth": b"{Actors}\r\n",
        "wireless": b"GETPOS\r\nGETSS {Robot R1}\r\n",
    }
    question = questions.get(name)
    if question is None:
        return ()
    return [
        Link(ports[name], again=question, every=1.0, reads=True, lives=lives)
        for lives in (None, STAY)
    ]
