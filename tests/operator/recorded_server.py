"""Plays the server's side of a recording to whoever connects, as often as it is asked."""

from __future__ import annotations

import contextlib
import re
import socket
import threading
import time
from collections.abc import Iterator

from usarsim_record.recording import CLIENT, DATA, Recording
from usarsim_server.testing import Closing

_TIME = re.compile(r"\{Time (\d+\.\d+)\}")
_STREAMS = ("SEN", "STA")


class RecordedServer(Closing):
    """Greets and answers as the recorded server did, and streams to robots what it streamed.

    What streams comes at its recorded pace, over and over, its times going on. A question that
    nobody asked then gets no answer.

    Attributes:
        port: where it listens. heard: all lines of all connections.
        silent: says nothing any more while true, and keeps its connections.
    """

    def __init__(self, recording: Recording) -> None:
        self.greeting: list[str] = []
        self.answers: dict[str, list[str]] = {}
        self.stream: list[tuple[float, str]] = []
        self.heard: list[str] = []
        self.silent = False
        asked: dict[int, str] = {}
        begun: dict[int, float] = {}
        for at, number, side, line in _lines(recording):
            if side == CLIENT:
                asked[number] = line
                if line.startswith("INIT"):
                    begun.setdefault(number, at)
            elif line.startswith(_STREAMS):
                self.stream.append((at - begun.get(number, at), line))
            elif number not in asked:
                self.greeting = [*self.greeting, line] if number == 1 else self.greeting
            elif line not in (known := self.answers.setdefault(asked[number], [])):
                known.append(line)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                self._sockets.append(client)
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            self._say(client, self.greeting)
            rest = b""
            while data := client.recv(65536):
                *lines, rest = (rest + data).split(b"\r\n")
                for text in (line.decode("latin-1") for line in lines):
                    self.heard.append(text)
                    if not self.silent:
                        self._say(client, self.answers.get(text, []))
                    if text.startswith("INIT"):
                        threading.Thread(target=self._play, args=(client,), daemon=True).start()

    def _play(self, client: socket.socket) -> None:
        times = [float(found[1]) for _, line in self.stream if (found := _TIME.search(line))]
        span = max(times) - min(times) + 0.1
        with contextlib.suppress(OSError):
            for turn in range(1000):
                begun = time.monotonic()
                for at, line in self.stream:
                    time.sleep(max(0.0, at - (time.monotonic() - begun)))
                    while self.silent:
                        time.sleep(0.02)

                    def later(found: re.Match[str], by: float = turn * span) -> str:
                        return f"{{Time {float(found[1]) + by:.4f}}}"

                    self._say(client, [_TIME.sub(later, line)])

    @staticmethod
    def _say(client: socket.socket, lines: list[str]) -> None:
        if lines:
            client.sendall("".join(f"{line}\r\n" for line in lines).encode("latin-1"))

    def close(self) -> None:
        for one in (self._listener, *self._sockets):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()


def _lines(recording: Recording) -> Iterator[tuple[float, int, str, str]]:
    """Time, connection, side and text of each whole line."""
    rests: dict[tuple[int, str], bytes] = {}
    for event in recording.events:
        if event.kind != DATA:
            continue
        key = event.connection, event.side
        *lines, rests[key] = (rests.get(key, b"") + event.data).split(b"\r\n")
        for line in lines:
            yield event.time, event.connection, event.side, line.decode("latin-1")
