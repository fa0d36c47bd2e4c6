"""What a crowd of newcomers costs a server: descriptors, memory and lines of the log, by port.

The figures are those of docs/limits.md.
"""

from __future__ import annotations

import contextlib
import re
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from hostile.newcomers import QUESTIONS
from lanes import slow_but

from usarsim_server.testing import PATIENCE, ServerProcess

LIMITS = Path(__file__).parents[2] / "docs" / "limits.md"
PORTS = {
    "control": "3000",
    "images": "5003",
    "wireless": "50000",
    "comserver": "5874",
    "groundtruth": "7435",
    "truth": "3989",
    "scene": "scene",
}
"""What ports are called in docs/limits.md, by their names on the READY line."""
HALF = {"images": b"U" + bytes(8), "scene": b"\x00\x00\x01\x00J{", "comserver": b"GETSS a"}
"""Half a request, where it is none of a line."""
CROWD = 300
BURST = 100
TURN = 8
"""Connections that are accepted in one turn of the loop, before those that give way are closed."""
OF_ONE = 64
"""KiB of memory for a connection with half a request, which is much less than it may hold."""


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    """A server with every port open, and a scene that needs no token."""
    side = ("image", "groundtruth", "truth", "comserver", "wireless", "scene")
    options = ("--scene-token", "secret", *(f"--{name}-port=0" for name in side))
    with ServerProcess("--world", "empty", *options) as process:
        assert set(process.ports) == set(PORTS)
        yield process
        assert "Traceback" not in process.errors


def places(port: str) -> int:
    """Connections that a port has at a time."""
    row = re.search(rf"^\| {port} \| (\d+) \| \d+ \| \d+ \|", LIMITS.read_text(), re.MULTILINE)
    assert row is not None
    return int(row[1])


def answered(port: int, name: str) -> bool:
    """Whether one more newcomer is answered."""
    question, sign = QUESTIONS[name]
    assert isinstance(question, bytes)
    heard = b""
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 5.0) as client:
        client.sendall(question)
        while sign not in heard or len(heard) < 5:
            if not (piece := client.recv(65536)):
                return False
            heard += piece
        return True
    return False


def until(check: Callable[[], object]) -> None:
    """Wait until something is so."""
    end = time.monotonic() + PATIENCE
    while not check():
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.mark.parametrize("name", slow_but("control".__eq__, PORTS))
def test_a_crowd_costs_so_much(server: ServerProcess, name: str) -> None:
    """300 connections with half a request at one port: they have the places that it has, little
    memory, so many lines; one more newcomer finds a place all the same, and all is given back."""
    process, most = psutil.Process(server.process.pid), places(PORTS[name])
    port = server.ports[name]
    until(lambda: answered(port, name))
    files, said = process.num_fds(), len(server.errors.splitlines())
    crowded(process, port, name)  # what is made once for all is there then
    memory = process.memory_info().rss
    peak = crowded(process, port, name)
    assert peak - files <= most + TURN
    assert process.memory_info().rss - memory <= 1024 * OF_ONE * most
    until(lambda: process.num_fds() <= files + 2)
    # Three kinds of lines: who is refused, who has to wait, and who gives way.
    assert len(server.errors.splitlines()) - said < 3 * BURST + CROWD // 4


def crowded(process: psutil.Process, port: int, name: str) -> int:
    """Most descriptors of the server while a crowd is there, beside which somebody is answered."""
    peak, crowd = 0, []
    for _ in range(CROWD):
        client = socket.create_connection(("127.0.0.1", port), PATIENCE)
        crowd.append(client)
        with contextlib.suppress(OSError):
            client.sendall(HALF.get(name, b"GETP"))
        peak = max(peak, int(process.num_fds()))
    until(lambda: answered(port, name))
    for client in crowd:
        client.close()
    return peak
