"""A server of few words: what it says is a table from words of commands to lines."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Self

GREETING = "NFO {Gametype BotDeathMatch} {Level Fake} {TimeLimit 0}"


async def until(condition: Callable[[], bool]) -> None:
    """Wait until a condition comes true."""
    while not condition():  # noqa: ASYNC110
        await asyncio.sleep(0.001)


class FakeServer:
    """Greets, notes what it is told, and answers by a function.

    Attributes:
        port: where it listens.
        heard: all lines of all connections.
        connections: how many came.
    """

    def __init__(
        self, answer: Callable[[str], list[str]], greeting: str = GREETING, end: str = "\r\n"
    ) -> None:
        self.answer = answer
        self.greeting = greeting
        self.heard: list[str] = []
        self.connections = 0
        self.port = 0
        self._end = end
        self._writers: list[asyncio.StreamWriter] = []

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()
        self.hang_up()

    def say(self, *lines: str) -> None:
        """Tell everybody."""
        for writer in self._writers:
            writer.write("".join(line + self._end for line in lines).encode("latin-1"))

    def hang_up(self) -> None:
        """On everybody."""
        for writer in self._writers:
            writer.close()
        self._writers.clear()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        self._writers.append(writer)
        self.say_to(writer, [self.greeting] if self.greeting else [])
        while line := await reader.readline():
            text = line.decode("latin-1").strip()
            self.heard.append(text)
            self.say_to(writer, self.answer(text))
        if writer in self._writers:
            self._writers.remove(writer)
        writer.close()

    def say_to(self, writer: asyncio.StreamWriter, lines: list[str]) -> None:
        """Tell one connection."""
        writer.write("".join(line + self._end for line in lines).encode("latin-1"))
