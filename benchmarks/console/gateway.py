"""A gateway with stopwatches, and the process that it runs in.

`python -m benchmarks.console.gateway FILE console ...` is `usarsim console ...` that notes in a
file when it reads a text of a page that drives or stops, when it hands a DRIVE to a socket, when it
has a picture, and once a second what waits for each page; a line each, flushed at once.
"""

from __future__ import annotations

import asyncio
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO
from unittest import mock
from weakref import WeakKeyDictionary

from benchmarks.console.arithmetic import Notes, is_zero, read_notes
from benchmarks.server import Measured, Server
from usarsim_client.connection import Connection
from usarsim_server.base.launch import LaunchError, python
from usarsim_server.cli import main as usarsim

TILES, TILE_SIZE = "4x4", "320x240"
_TOKEN = "bench"
_NAME = re.compile(rb"\{Name ([^{}]*)\}")
_NOTED = ('{"type":"drive"', '{"type":"estop"')


def main(arguments: list[str]) -> int:
    """Run `usarsim` with all words but the first, the file to write; returns its exit code."""
    file, *rest = arguments
    with Path(file).open("w", buffering=1) as notes, instrumented(notes):
        return usarsim(rest)


@contextmanager
def instrumented(notes: TextIO) -> Iterator[None]:
    """While inside, a gateway in this process writes down what passes it."""
    # Not at the top: a bench without the extra `console` must be able to import this module.
    from usarsim_operator.requests import Desk
    from usarsim_operator.shows import Shows

    asked: WeakKeyDictionary[asyncio.Task[Any], float] = WeakKeyDictionary()

    def note(kind: str, *what: object) -> None:
        notes.write("\t".join((kind, repr(time.perf_counter()), *map(str, what))) + "\n")

    patch = mock.patch.object
    with (
        patch(Connection, "send", _on_send(Connection.send, note, asked)),
        patch(Desk, "hear", _on_hear(Desk.hear, note)),
        patch(Shows, "picture", _on_picture(Shows.picture, note, asked)),
    ):
        yield


Note = Callable[..., None]


def _on_send(original: Any, note: Note, asked: WeakKeyDictionary[asyncio.Task[Any], float]) -> Any:
    names: WeakKeyDictionary[Connection, str] = WeakKeyDictionary()

    async def send(connection: Connection, data: bytes) -> None:
        if data.startswith(b"INIT") and (name := _NAME.search(data)):
            names[connection] = name[1].decode("latin-1")
        if (task := asyncio.current_task()) is not None and connection not in names:
            asked[task] = time.perf_counter()
        await original(connection, data)
        if data.startswith(b"DRIVE"):
            note("wired", names.get(connection, ""), int(not is_zero(data.decode("latin-1"))))

    return send


def _on_hear(original: Any, note: Note) -> Any:
    def hear(desk: Any, page: Any, text: str) -> None:
        if text.startswith(_NOTED):
            note("heard", page.id, text.replace("\t", " ").replace("\n", " "))
        elif text.startswith('{"type":"ping"'):
            note("waiting", page.id, page.waiting)
        original(desk, page, text)

    return hear


def _on_picture(
    original: Any, note: Note, asked: WeakKeyDictionary[asyncio.Task[Any], float]
) -> Any:
    def picture(shows: Any, driven: Any, jpeg: bytes, count: int) -> None:
        task = asyncio.current_task()
        moment = None if task is None else asked.get(task)
        if moment is not None:
            note("shown", driven.index, count, repr(moment))
        original(shows, driven, jpeg, count)

    return picture


class Rig(Measured):
    """A server and a gateway with robots of its own, each in a process of its own.

    Attributes:
        server: the one. robots: names of the robots. port: of the pages.
        tokens: of the pages, by role. `usage` is of the gateway.
    """

    def __init__(self, world: str, robots: int) -> None:
        """Start both, and wait until all robots are in the world.

        Raises:
            LaunchError: if one of them does not start; with what it said.
        """
        options = (
            *("--scene-port", "0", "--scene-token", _TOKEN),
            *("--tiles", TILES, "--tile-size", TILE_SIZE),
        )
        self.robots = [f"R{number + 1}" for number in range(robots)]
        self._folder = tempfile.TemporaryDirectory(prefix="usarsim-bench-")
        self._notes = Path(self._folder.name, "notes")
        self.server = Server(world, robots, *options)
        ports = self.server.ports
        words = [
            *("--connect", f"127.0.0.1:{self.server.port}", "--no-browser", "--console-port", "0"),
            *("--image-port", str(ports["images"]), "--scene-port", str(ports["scene"])),
            *("--scene-token", _TOKEN, "--viewer-delay", "0"),
            *("--latch", str(Path(self._folder.name, "latch.json"))),
            *(word for name in self.robots for word in ("--robot", f"P3AT={name}")),
        ]
        module = "benchmarks.console.gateway"
        command = python("-m", module, str(self._notes), "console", *words, tied=True)
        super().__init__("the gateway", command)
        try:
            found = self.announced(r"CONSOLE http://[^/]*:(\d+)/#(\S+) (\w+)", 3)
        except LaunchError:
            self.server.close()
            raise
        self.port = int(found[0][1])
        self.tokens = {role: token for _, token, role in map(re.Match.groups, found)}

    @property
    def url(self) -> str:
        """Where the pages are."""
        return f"http://127.0.0.1:{self.port}"

    def notes(self, since: float = 0.0) -> Notes:
        """What it has noted from a moment on."""
        with self._notes.open() as file:
            lines = (one for one in file if not one.endswith("\n") or _moment(one) >= since)
            return read_notes(lines)

    def close(self) -> None:
        """End both; a second call does nothing.

        Raises:
            BenchError: if one of them ended with an error.
        """
        try:
            super().close()
        finally:
            self._folder.cleanup()
            self.server.close()


def _moment(line: str) -> float:
    return float(line.split("\t", 2)[1])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
