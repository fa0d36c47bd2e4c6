"""Recordings as files, and the proxy between clients and servers that misbehave."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import socket
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_record.player import play
from usarsim_record.proxy import Proxy
from usarsim_record.recording import Event, Link, Recording, Writer, read
from usarsim_server.cli import main
from usarsim_server.testing import PATIENCE

Handler = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


@given(st.lists(st.binary(max_size=50), max_size=5))
def test_bytes_come_back(chunks: list[bytes]) -> None:
    """Whatever was sent is read again, text or not."""
    file = io.BytesIO()
    writer = Writer(file, [Link(3000, "somewhere", 3000)])
    writer.add(1, "open")
    for chunk in chunks:
        writer.add(1, "data", "server", chunk)
    found = read_text(file.getvalue().decode())
    assert [event.data for event in found.events[1:]] == chunks
    assert found.links == (Link(3000, "somewhere", 3000),)


def read_text(text: str) -> Recording:
    """Read a recording that is no file."""

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "recording")
        path.write_text(text, encoding="utf-8")
        return read(path)


HEADER = '{"usarsim_recording": 1, "taken": "2026", "links": [{"listen": 1, "to": "h:2"}]}\n'
DATA = '{{"t": 1, "connection": 1, "event": "data", "text": {}}}'
OPEN = '{"t": 0, "connection": 1, "event": "open", "link": 0}\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "line 1: is no recording"),
        ("hello\n", "line 1: is no recording"),
        (HEADER.replace("1,", "7,", 1), "format 7"),
        (HEADER + "hello\n", "line 2: is no event"),
        (HEADER + OPEN.replace('"link": 0', '"link": 3'), "line 2: is no event (there is no link"),
        (HEADER + OPEN.replace("open", "end"), "connection 1 was never opened"),
        (HEADER + OPEN + OPEN.replace("open", "data") + "\n", "line 3: is no event (no 'base64')"),
        (HEADER + OPEN + DATA.format(1) + "\n", "line 3: is no event (text is 1, no text)"),
        (HEADER + OPEN.replace('"link": 0', '"link": 1e999') + "\n", "line 2: is no event (cannot"),
        (HEADER.replace('"listen": 1', '"listen": 1e999'), "line 1: is no recording"),
    ],
)
def test_bad_files_are_one_error(
    text: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file that is no recording gives one line that names it, and exit code 2."""
    file = tmp_path / "session.jsonl"
    file.write_text(text)
    assert main(["replay", str(file)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {file}: ")
    assert told in error
    assert error.count("\n") == 1


def test_a_cut_off_line_is_passed_over(tmp_path: Path) -> None:
    """Who was killed while writing leaves a recording that can be read."""
    file = tmp_path / "session.jsonl"
    file.write_text(HEADER + OPEN + '{"t": 1, "connect')
    assert len(read(file).events) == 1


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--to", "nowhere"], "--to: 'nowhere' is not of the form HOST:PORT"),
        (["--to", "h:1", "--also", "h:1"], "--also: 'h:1' is not of the form PORT=HOST:PORT"),
        (["--to", "h:99999"], "HOST:PORT"),
    ],
)
def test_bad_options_are_one_error(
    arguments: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ports that are none are named, and no file is left behind."""
    file = tmp_path / "new.jsonl"
    assert main(["record", *arguments, str(file)]) == 2
    assert told in capsys.readouterr().err
    assert not file.exists()


def test_a_recording_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that exists is kept, and the error names the cure."""
    file = tmp_path / "old.jsonl"
    file.write_text("precious")
    assert main(["record", "--to", "h:1", str(file)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert file.read_text() == "precious"


def test_a_taken_port_is_one_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The port that cannot be had is named."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        file = tmp_path / "new.jsonl"
        assert main(["record", "--listen", str(port), "--to", "h:1", str(file)]) == 2
    assert f"cannot listen on 127.0.0.1:{port}" in capsys.readouterr().err


def through(handler: Handler, client: Handler) -> list[Event]:
    """What is recorded of one client and one server."""
    file = io.BytesIO()

    async def session() -> None:
        server = await asyncio.start_server(handler, "127.0.0.1", 0)
        link = Link(0, "127.0.0.1", server.sockets[0].getsockname()[1])
        proxy = Proxy([link], Writer(file, [link]))
        (port,) = await proxy.start()
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        try:
            async with asyncio.timeout(PATIENCE):
                await client(reader, writer)
        finally:
            writer.close()
            await asyncio.sleep(0.05)
            await proxy.stop()
            server.close()

    asyncio.run(session())
    return list(read_text(file.getvalue().decode()).events)


def test_half_close_is_passed_on() -> None:
    """A client ends its side; the server answers after that, and both are recorded."""

    async def server(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        data = await reader.read()
        writer.write(data.upper())
        writer.close()

    async def client(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"late\0")
        writer.write_eof()
        assert await reader.read() == b"LATE\0"

    events = through(server, client)
    assert [(event.kind, event.side) for event in events] == [
        ("open", "client"),
        ("data", "client"),
        ("end", "client"),
        ("data", "server"),
        ("end", "server"),
    ]


def test_a_server_that_dies_is_recorded() -> None:
    """When the server resets, the client's connection ends too, and the file says who did it."""

    async def server(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(10)
        writer.transport.abort()

    async def client(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"hello")
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""

    events = through(server, client)
    assert events[1].data == b"hello"
    assert any(event.side == "server" and event.kind in ("end", "reset") for event in events)


def test_an_absent_server_is_recorded() -> None:
    """Without a server the client is hung up on, and the recording says so."""
    file = io.BytesIO()

    async def session() -> None:
        with socket.create_server(("127.0.0.1", 0)) as gone:
            link = Link(0, "127.0.0.1", gone.getsockname()[1])
        proxy = Proxy([link], Writer(file, [link]))
        (port,) = await proxy.start()
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        assert await reader.read() == b""
        writer.close()
        await proxy.stop()

    asyncio.run(session())
    assert [event.kind for event in read_text(file.getvalue().decode()).events] == [
        "open",
        "refused",
    ]


def test_a_reader_that_sleeps_stops_the_sender_not_the_memory() -> None:
    """A server that pours out data is slowed down by a client that does not read; all of it
    arrives once the client reads, and the proxy held little of it."""
    amount = 20_000_000
    sent: list[int] = []

    async def server(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        for _ in range(amount // 100_000):
            writer.write(bytes(100_000))
            await writer.drain()
            sent.append(100_000)
        writer.close()

    async def client(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await asyncio.sleep(0.5)
        assert sum(sent) < amount
        received = 0
        while data := await reader.read(1 << 20):
            received += len(data)
        assert received == amount

    events = through(server, client)
    assert sum(len(event.data) for event in events) == amount


def test_the_player_waits_for_what_the_controller_waited_for() -> None:
    """A command that followed an answer goes out after the answer, however late that comes."""
    order: list[str] = []

    async def server(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := await reader.readline():
            order.append(line.decode().strip())
            await asyncio.sleep(0.3)
            order.append("answered")
            writer.write(b"RES {Status OK}\r\n")

    def event(time: float, kind: str, side: str = "client", data: bytes = b"") -> Event:
        return Event(time, 1, kind, side, data)

    async def session() -> bool:
        running = await asyncio.start_server(server, "127.0.0.1", 0)
        link = Link(0, "127.0.0.1", running.sockets[0].getsockname()[1])
        events = (
            event(0.0, "open"),
            event(0.0, "data", data=b"first\r\n"),
            event(0.01, "data", "server", b"RES {Status OK}\r\n"),
            event(0.02, "data", data=b"second\r\n"),
            event(0.03, "data", "server", b"RES {Status OK}\r\n"),
            event(0.04, "end"),
        )
        outcome = await play(Recording((link,), "", events))
        running.close()
        return outcome.passed and outcome.late > 0.4

    assert asyncio.run(session())
    assert order == ["first", "answered", "second", "answered"]


def test_every_line_stands_alone(tmp_path: Path) -> None:
    """Each line of a recording is JSON by itself, whatever bytes it holds."""
    file = io.BytesIO()
    writer = Writer(file, [Link(1, "h", 2)])
    writer.add(1, "open")
    writer.add(1, "data", "client", b"GETPOS\r\n")
    writer.add(1, "data", "server", b"\xff\x00\n")
    lines = [json.loads(line) for line in file.getvalue().splitlines()]
    assert lines[2]["text"] == "GETPOS\r\n"
    assert lines[3]["base64"] == "/wAK"
