"""Limits of a settings file, as clients of a whole server meet them.

Robots come and go, many times; the server stays the same.

Two simulated minutes with eight robots are the same in two processes (robots 113, 115; V26).
"""

from __future__ import annotations

import random
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from usarsim_server.testing import (
    PATIENCE,
    Rehearsal,
    ScriptedClient,
    ServerProcess,
    eventually,
    running_server,
)

FILE = """
max_per_address = 3
line_bytes = 100000
command_rate = 200
spawn_rate = 0.1
reply_bytes = 65536
"""
NOBODY = "INIT {ClassName USARAvatar.Nobody}"
"""Takes a turn at the gate, and comes to nothing."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with narrow limits."""
    file = tmp_path_factory.mktemp("limits") / "lab.toml"
    file.write_text(FILE)
    with ServerProcess("--world", "empty", "--config", str(file)) as process:
        yield process


def visit(server: ServerProcess, address: str) -> ScriptedClient:
    """A client with another address of this machine."""
    client = ScriptedClient.__new__(ScriptedClient)
    client.socket = socket.create_connection(
        ("127.0.0.1", server.ports["control"]), PATIENCE, (address, 0)
    )
    client._timeout, client._buffer = PATIENCE, b""
    return client


def said(server: ServerProcess, text: str) -> bool:
    """Whether the log says something before long."""
    return eventually(lambda: text in server.errors)


def test_a_fourth_connection_of_an_address_is_closed(server: ServerProcess) -> None:
    """`max_per_address`: the fourth reads the end at once, a client from elsewhere is greeted."""
    clients = [visit(server, "127.0.0.3") for _ in range(3)]
    for client in clients:
        client.wait_for("NFO {Gametype")
    with visit(server, "127.0.0.3") as fourth, pytest.raises(ConnectionError):
        fourth.read_line()
    with visit(server, "127.0.0.4") as other:
        other.wait_for("NFO {Gametype")
    assert said(server, "too many clients of one address")
    for client in clients:
        client.close()


def test_too_many_robots_at_once_are_refused(server: ServerProcess) -> None:
    """`spawn_rate`: an INIT beyond 64 fails like any other; elsewhere robots still come."""
    with visit(server, "127.0.0.5") as greedy, visit(server, "127.0.0.6") as other:
        for _ in range(70):
            greedy.send(NOBODY)
        greedy.send("INIT {ClassName P3AT} {Location 0,0,-0.3}")
        greedy.send("GETSTARTPOSES")
        greedy.wait_for("NFO {StartPoses", PATIENCE)
        assert said(server, "too many robots at once from this address")
        other.send("INIT {ClassName P3AT} {Location 5,5,-0.3}")
        other.wait_for("STA", PATIENCE)
        greedy.send("GETCONF {Type Robot}")
        greedy.send("GETSTARTPOSES")
        lines: list[str] = []
        while not lines or not lines[-1].startswith("NFO {StartPoses"):
            lines.append(greedy.read_line(PATIENCE))
        assert [line for line in lines if not line.startswith("NFO")] == []


def test_a_client_that_never_wanted_anything_is_closed(caplog: pytest.LogCaptureFixture) -> None:
    """`idle_timeout`: so long after its last command, with a line in the log."""
    with (
        running_server(world="empty", idle_timeout=0.5) as (_, endpoints),
        ScriptedClient(endpoints["control"].port) as idle,
    ):
        idle.wait_for("NFO {Gametype")
        with pytest.raises(ConnectionError):
            idle.read_line(PATIENCE)
    assert any("closed by the server: idle" in message for message in caplog.messages)


def test_longer_lines_are_read_if_the_file_says_so(server: ServerProcess) -> None:
    """`line_bytes` (protocol 20): a line of 100,000 bytes is a command, one of 100,001 is not."""
    with visit(server, "127.0.0.8") as client:
        client.wait_for("NFO {Gametype")
        client.send("GETSTARTPOSES".ljust(100_001))
        client.send("GETSTARTPOSES".ljust(100_000))
        client.send("GETPATHNODES")
        heads = [client.read_line(PATIENCE).split("}")[0][:15] for _ in range(2)]
        assert sum("StartPoses" in head for head in heads) == 1


def test_who_asks_without_reading_is_closed_at_its_budget(server: ServerProcess) -> None:
    """`reply_bytes`: 64 KiB of answers that nobody reads are too many, with a line in the log."""
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.bind(("127.0.0.9", 0))
    client.settimeout(0.2)
    client.connect(("127.0.0.1", server.ports["control"]))
    deadline = time.monotonic() + PATIENCE
    with client:
        while "does not read" not in server.errors and time.monotonic() < deadline:
            try:
                client.sendall(b"GETSTARTPOSES\r\n" * 100)
            except TimeoutError:
                continue
            except OSError:
                break
    assert said(server, "the client does not read")


def test_in_lockstep_nobody_is_refused() -> None:
    """At `--speed max` the gate is open: wall time does not decide who comes."""
    with Rehearsal(world="empty", spawn_rate=0.1) as rehearsal:
        client = rehearsal.connect()
        for _ in range(100):
            client.send(NOBODY)
        client.send("INIT {ClassName P3AT} {Location 0,0,-0.3}")
        rehearsal.run(1.0)
        assert client.take("STA")


CLASSES = ("P2AT", "P3AT", "P2DX", "P3DX")


def _visit(server: ServerProcess, chance: random.Random) -> ScriptedClient:
    client = server.client()
    place = f"{chance.uniform(-30, 30):.2f},{chance.uniform(-30, 30):.2f},-0.3"
    client.send(f"INIT {{ClassName {chance.choice(CLASSES)}}} {{Location {place}}}")
    client.send(f"DRIVE {{Left {chance.uniform(-2, 2):.2f}}} {{Right {chance.uniform(-2, 2):.2f}}}")
    client.fence()  # or a slow machine would have more and more of them come at once
    return client


@pytest.mark.slow
def test_robots_come_and_go_for_a_while(tmp_path: Path) -> None:
    """200 visits by up to 12 robots leave no thread, descriptor, robot or lasting memory."""
    chance = random.Random(11)
    settings = tmp_path / "lab.toml"
    settings.write_text("spawn_rate = 1000\n", encoding="utf-8")
    with ServerProcess("--world", "empty", "--config", str(settings)) as server:
        process = psutil.Process(server.process.pid)
        witness = server.client()
        witness.send("INIT {ClassName P3AT} {Location 50,50,-0.3}")
        witness.wait_for("STA")
        guests: list[ScriptedClient] = []
        used: list[int] = []
        for visit in range(200):
            guests.append(_visit(server, chance))
            if len(guests) >= 12 or chance.random() < 0.4:
                guests.pop(chance.randrange(len(guests))).close()
            if visit % 20 == 19:
                used.append(process.memory_info().rss)
                assert witness.fence()
        for guest in guests:
            guest.close()
        assert eventually(lambda: process.num_threads() <= 8 and process.num_fds() < 24)
        assert used[-1] - used[4] < 24 << 20, "memory grew while robots came and went"
        last = server.client()
        last.send("INIT {ClassName P3AT} {Location 0,0,-0.3}")
        assert last.wait_for("STA")
        assert server.end() == 0
        assert "Traceback" not in server.errors


PROGRAM = Path(__file__).with_name("long_run.py")
SECONDS = 60.0
"""Simulated, as robots 115 asks for. Longer ones by hand: the program prints what is compared."""
LINES = round(8 * SECONDS * 15)
"""Lines of eight robots in that time, at the least."""


@pytest.mark.slow
def test_a_minute_is_the_same_to_the_letter_and_to_the_bit() -> None:
    """Text of all robots and state of the world agree between processes; another seed differs."""
    runs = [(5, SECONDS), (5, SECONDS), (6, 5.0)]
    processes = [
        subprocess.Popen(
            [sys.executable, str(PROGRAM), str(seed), str(seconds)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for seed, seconds in runs
    ]
    said = [process.communicate() for process in processes]
    for process, (_, errors) in zip(processes, said, strict=True):
        assert process.returncode == 0, errors
    (first, heard, time), second, third = (text.split() for text, _ in said)
    assert second == [first, heard, time]
    assert third[0] != first
    assert float(time) == pytest.approx(SECONDS, abs=0.01)
    assert int(heard) > LINES
