"""Servers that only pretend, for tests of the clients."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable

from usarsim_client import Closing
from usarsim_server.testing import eventually

STATUS = b"STA {Type GroundVehicle} {Time %.4f} {Battery 1}\r\n"
SCAN = b"SEN {Time %.4f} {Type RangeScanner} {Name lms200} {Range 1.0}\r\n"
POSES = b"NFO {StartPoses 2} {Here 0,0,0 0,0,0 There 1,1,1 0,0,0}\r\n"


class FakeServer(Closing):
    """Greets, answers GETSTARTPOSES, and after INIT sends STA and SEN at 20 Hz.

    Attributes:
        port: where it listens.
        received: every line that came, of all clients.
        mute: clients that get neither STA nor SEN, by robot name.
        poses: its answer to GETSTARTPOSES.
        pace: simulated seconds per wall second, as its STA lines tell.
    """

    def __init__(self, poses: bytes = POSES, pace: float = 1.0) -> None:
        self.pace = pace
        self.received: list[str] = []
        self.mute: set[str] = set()
        self.poses = poses
        self._clients: list[socket.socket] = []
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._stop = threading.Event()
        self._start(self._accept)

    def hang_up(self) -> None:
        """Close all connections."""
        for client in self._clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    def silence(self) -> None:
        """Send nothing more, to anybody."""
        self._stop.set()

    def commands(self, word: str, count: int = 0) -> list[str]:
        """The lines received that begin with a word; waits until there are at least `count`."""

        def found() -> list[str]:
            return [line for line in self.received if line.startswith(word)]

        assert eventually(lambda: len(found()) >= count)
        return found()

    def _start(self, work: Callable[..., None], *arguments: object) -> None:
        threading.Thread(target=work, args=arguments, daemon=True).start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                self._clients.append(client)
                self._start(self._serve, client)

    def _serve(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError), client, client.makefile("rb") as incoming:
            client.sendall(b"NFO {Gametype Fake} {Level Nowhere} {TimeLimit 0}\r\n")
            for raw in incoming:
                line = raw.decode("latin-1").removesuffix("\r\n")
                self.received.append(line)
                if line == "GETSTARTPOSES":
                    client.sendall(self.poses)
                if line.startswith("INIT") and not any(name in line for name in self.mute):
                    self._start(self._stream, client)

    def _stream(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while not self._stop.wait(0.05):
                now = self.pace * time.perf_counter()
                client.sendall(STATUS % now)
                client.sendall(SCAN % now)

    def close(self) -> None:
        """End all connections and hear nobody any more."""
        self._stop.set()
        # A listening socket that is only closed would leave `accept` waiting.
        with contextlib.suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self.hang_up()
