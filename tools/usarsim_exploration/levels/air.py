"""The radios of a team at the wireless server, port 50000: who hears whom, and what goes over it.

Time stands still meanwhile (the world is in lockstep), so what arrives does not depend on clocks.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_client import BlockingConnection, HangupError
from usarsim_client.commands import say
from usarsim_exploration.errors import ExplorationError

_PATIENCE = 20.0
"""s of wall time for an answer, or for a message to arrive."""
_LENGTH = struct.Struct("<I")
_CHUNK = 1 << 16
Road = tuple[int, int]
"""Numbers of giver and taker."""


class Air:
    """All radios of a team.

    Attributes:
        sent: bytes of each radio so far, lengths included. ports: that led from one to another.
    """

    def __init__(self, host: str, port: int, names: Sequence[str], cutoff: float) -> None:
        """Register everybody; they have to be in the world.

        Args:
            host, port: of the wireless server. names: on the wire. cutoff: weakest signal, dBm.

        Raises:
            ExplorationError: there is no wireless server, or it refuses.
        """
        self._host, self._names, self._cutoff = host, list(names), cutoff
        self._roads: dict[Road, tuple[socket.socket, socket.socket]] = {}
        self._talks: list[BlockingConnection] = []
        self._ears: list[socket.socket] = []
        self.ports: set[int] = set()
        self.sent: NDArray[np.int64] = np.zeros(len(names), np.int64)
        try:
            for name in names:
                ear = socket.create_server((host, 0))
                ear.settimeout(_PATIENCE)
                self._ears.append(ear)
                talk = BlockingConnection(port, host, _PATIENCE)
                self._talks.append(talk)
                answer = talk.ask(say("INIT", Robot=name, Port=ear.getsockname()[1]))
                if answer.head != "INITREPLY":
                    raise ExplorationError(f"{host}:{port}: {name} gets no radio: {answer}")
        except (OSError, HangupError) as error:
            self.close()
            cure = "the server needs its wireless port"
            raise ExplorationError(f"no radio at {host}:{port}: {error} ({cure})") from error
        except ExplorationError:
            self.close()
            raise

    def hears(self, on: Sequence[bool]) -> NDArray[np.bool_]:
        """(n, n) whose signals are strong enough. on: whose radios are."""
        count = len(self._names)
        found = np.zeros((count, count), np.bool_)
        for one in range(count):
            for other in range(one + 1, count):
                if on[one] and on[other]:
                    question = say("GETSS", Robot=self._names[other])
                    answer = self._talks[one].ask(question)
                    strong = answer.head == "SS" and answer.numbers("Strength")[0] >= self._cutoff
                    found[one, other] = found[other, one] = strong
        return found

    def carry(self, giver: int, taker: int, data: bytes) -> bytes:
        """Send a message over the wireless server, and take it at the other end.

        Raises:
            ExplorationError: the signal is strong enough, but no road leads there.
        """
        until = time.monotonic() + _PATIENCE
        frame = _LENGTH.pack(len(data)) + data
        self.sent[giver] += len(frame)
        while True:
            try:
                return self._pass(self._road(giver, taker), frame)
            except OSError as error:
                self._forget((giver, taker))
                if time.monotonic() > until:
                    names = f"{self._names[giver]} to {self._names[taker]}"
                    problem = f"no road from {names} though the signal is strong enough"
                    raise ExplorationError(f"wireless server: {problem}: {error}") from error
                time.sleep(0.02)  # until the wireless server looks at the world again

    def _road(self, giver: int, taker: int) -> tuple[socket.socket, socket.socket]:
        if (giver, taker) not in self._roads:
            answer = self._talks[giver].ask(say("DNS", Robot=self._names[taker]))
            port = answer.numbers("Port")[0]
            if not port > 0:
                raise OSError(str(answer))
            self.ports.add(int(port))
            out = socket.create_connection((self._host, int(port)), _PATIENCE)
            try:
                out.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                inward = self._accept(giver, taker, out)
            except BaseException:
                out.close()
                raise
            self._roads[giver, taker] = out, inward
        return self._roads[giver, taker]

    def _accept(self, giver: int, taker: int, out: socket.socket) -> socket.socket:
        """The other end; the server may have ended the connection instead."""
        ear = self._ears[taker]
        with selectors.DefaultSelector() as waiting:
            waiting.register(ear, selectors.EVENT_READ)
            waiting.register(out, selectors.EVENT_READ)
            ready = [key.fileobj for key, _ in waiting.select(_PATIENCE)]
        if ear not in ready:
            raise ConnectionError("the road is closed")
        inward, _ = ear.accept()
        inward.settimeout(_PATIENCE)
        return inward

    @staticmethod
    def _pass(road: tuple[socket.socket, socket.socket], frame: bytes) -> bytes:
        """Send at one end while the other one reads: a long message fills the server's buffers."""
        out, inward = road
        left, heard = memoryview(frame), bytearray()
        with selectors.DefaultSelector() as waiting:
            waiting.register(inward, selectors.EVENT_READ)
            waiting.register(out, selectors.EVENT_WRITE)
            while len(heard) < len(frame):
                ready = waiting.select(_PATIENCE)
                if not ready:
                    raise TimeoutError("a message does not arrive")
                for key, _ in ready:
                    if key.fileobj is out:
                        left = left[out.send(left[:_CHUNK]) :]
                        if not left:
                            waiting.unregister(out)
                    else:
                        data = inward.recv(_CHUNK)
                        if not data:
                            raise ConnectionError("the road is closed")
                        heard += data
        return bytes(heard[_LENGTH.size :])

    def _forget(self, road: Road) -> None:
        for end in self._roads.pop(road, ()):
            end.close()

    def close(self) -> None:
        """Leave the radio."""
        for road in list(self._roads):
            self._forget(road)
        for talk in self._talks:
            with contextlib.suppress(OSError):
                talk.close()
        for ear in self._ears:
            ear.close()
