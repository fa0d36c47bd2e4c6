"""Sessions with a whole server are recorded and played again; a wrong server is noticed."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from usarsim_record.proxy import Proxy
from usarsim_record.recording import Link, Writer, read
from usarsim_server.cli import main
from usarsim_server.testing import PATIENCE, ScriptedClient, running_server

Dialogue = Callable[[dict[str, int]], None]


def player_like(ports: dict[str, int]) -> None:
    """The ut2004 dialogue of protocol reference 5.5."""
    with ScriptedClient(ports["control"]) as client:
        client.wait_for("NFO")
        client.send("INIT {ClassName USARBot.P2AT} {Name R1} {Location 1.0 -2.0 -0.3}")
        client.send("GETGEO {Type RangeScanner}")
        client.send("GETCONF {Type RangeScanner}")
        client.wait_for("CONF {Type RangeScanner}")
        client.wait_for("STA")
        client.send("DRIVE {Left 1.538462} {Right 1.538462}")
        client.read_for(0.9)


def ros_like(ports: dict[str, int]) -> None:
    """The udk dialogue of protocol reference 5.5."""
    with ScriptedClient(ports["control"]) as client:
        client.wait_for("NFO")
        client.send("GETSTARTPOSES")
        client.wait_for("NFO {StartPoses")
        client.send_bytes(
            b"INIT {Classname USARBot.P3AT} {Name rover} {Start RobotStart1}\r\n"
            b"GETCONF {Type RFID}\r\nGETGEO {Type RFID}\r\n"
        )
        client.wait_for("STA")
        client.send("GETCONF {Type Robot} {Name rover}")
        client.wait_for("CONF {Name P3AT}")
        client.send("Drive {Left 0.800000} {Right 0.800000}")
        client.read_for(0.7)


def side_channels(ports: dict[str, int]) -> None:
    """A robot, and a wireless model that asks for it on a port of its own (side channels 3)."""
    with ScriptedClient(ports["control"]) as client:
        client.wait_for("NFO")
        client.send("INIT {ClassName USARBot.P3AT} {Name rover} {Location 3,2,-0.3}")
        client.wait_for("STA")
        client.read_for(0.4)
        with ScriptedClient(ports["groundtruth"]) as model:
            model.send("GETPOS")
            model.read_line()
            model.send("GETOBS {From rover} {To nobody}")
            model.read_line()
            model.send("GETOBS {From rover}")
            assert model.read_line() == ""


def driving(ports: dict[str, int]) -> None:
    """A robot that drives straight on for two seconds of simulated time."""
    with ScriptedClient(ports["control"]) as client:
        client.wait_for("NFO")
        client.send("INIT {ClassName USARBot.P2AT} {Name R2} {Location 1.0 -2.0 -0.3}")
        client.wait_for("STA")
        client.send("DRIVE {Left 2.500000} {Right 2.500000}")
        for _ in range(11):
            client.wait_for("STA")


DIALOGUES = (player_like, ros_like, side_channels, driving)


@pytest.fixture(scope="module")
def ports() -> Iterator[dict[str, int]]:
    """A server with the empty world."""
    with running_server(world="empty", groundtruth_port=0, max_robots=4) as (_, found):
        yield {name: one.port for name, one in found.items() if name in ("control", "groundtruth")}


def recorded(file: Path, ports: dict[str, int], dialogue: Dialogue) -> None:
    """Hold a dialogue through a proxy that records it."""
    links = [Link(0, "127.0.0.1", port) for port in ports.values()]
    ready = threading.Event()
    found: dict[str, int] = {}
    stops: list[Callable[[], object]] = []

    async def record() -> None:
        with file.open("wb", buffering=0) as stream:
            proxy = Proxy(links, Writer(stream, links))
            found.update(zip(ports, await proxy.start(), strict=True))
            stop, loop = asyncio.Event(), asyncio.get_running_loop()
            stops.append(lambda: loop.call_soon_threadsafe(stop.set))
            ready.set()
            await stop.wait()
            await proxy.stop()

    thread = threading.Thread(target=asyncio.run, args=(record(),))
    thread.start()
    try:
        assert ready.wait(PATIENCE)
        dialogue(found)
        time.sleep(0.1)
    finally:
        for stop in stops:
            stop()
        thread.join(PATIENCE)


@pytest.fixture(scope="module", params=DIALOGUES)
def session(
    request: pytest.FixtureRequest,
    ports: dict[str, int],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """A recording of each dialogue."""
    file: Path = tmp_path_factory.mktemp("recorded") / "session.jsonl"
    emptied(ports)
    recorded(file, ports, request.param)
    return file


def emptied(ports: dict[str, int]) -> None:
    """Wait until no robot is left, so that the next one finds its place free."""
    with ScriptedClient(ports["groundtruth"]) as watch:
        line = ""
        while line != "POSITIONS {Robots 0}":
            watch.send("GETPOS")
            line = watch.read_line()


def test_the_same_server_says_the_same(
    session: Path, ports: dict[str, int], capsys: pytest.CaptureFixture[str]
) -> None:
    """Played again, a session passes in every row, and every kind of line is compared."""
    emptied(ports)
    code = main(["replay", str(session)])
    told = capsys.readouterr().out
    assert code == 0, told
    assert "all " in told
    assert "STA" in told
    assert "NFO" in told


def test_a_wrong_server_is_noticed(
    ports: dict[str, int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recording that says otherwise than the server does fails, and the table says where."""
    file = tmp_path / "session.jsonl"
    emptied(ports)
    recorded(file, ports, side_channels)
    text = file.read_text()
    right = "{ObstCount -1.0000}"
    assert right in text
    file.write_text(text.replace(right, "{ObstCount -1.00}"))
    emptied(ports)
    assert main(["replay", str(file)]) == 1
    rows = [line for line in capsys.readouterr().out.splitlines() if "DIFFERS" in line]
    assert [row.split()[2] for row in rows] == ["NUMOBS"], rows
    assert "float2" in rows[0]
    assert "float4" in rows[0]


@pytest.mark.parametrize(
    ("spoken", "spoiled"),
    [
        ("{Left 2.500000}", "{Left 0.500000}"),
        ("{Left 2.500000} {Right 2.500000}", "{Left 0.0} {Right 0.0}"),
    ],
)
def test_a_robot_that_drives_otherwise_is_noticed(
    spoken: str,
    spoiled: str,
    ports: dict[str, int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A robot that turns, or stands still, where it drove straight on differs."""
    file = tmp_path / "session.jsonl"
    emptied(ports)
    recorded(file, ports, driving)
    text = file.read_text()
    assert spoken in text
    file.write_text(text.replace(spoken, spoiled))
    emptied(ports)
    assert main(["replay", str(file)]) == 1
    rows = [line for line in capsys.readouterr().out.splitlines() if "DIFFERS" in line]
    assert any("GroundTruth" in row for row in rows), rows


def test_the_file_is_lines_of_json(session: Path) -> None:
    """A header with format and links, then events in the order of their times."""
    header, *events = [json.loads(line) for line in session.read_text().splitlines()]
    assert header["usarsim_recording"] == 1
    assert len(header["links"]) == 2
    times = [event["t"] for event in events]
    assert times == sorted(times)
    assert events[0]["event"] == "open"
    assert any("INIT" in event.get("text", "") for event in events if event.get("from") == "client")
    assert read(session).connections[1] == 0


def test_the_command_records_until_it_is_interrupted(ports: dict[str, int], tmp_path: Path) -> None:
    """`usarsim record` says where it listens, passes lines on, and ends with Ctrl-C and code 0."""
    file = tmp_path / "session.jsonl"
    command = [sys.executable, "-m", "usarsim_server", "record", "--listen", "0"]
    process = subprocess.Popen(
        [*command, "--to", f"127.0.0.1:{ports['control']}", str(file)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert process.stdout is not None
    try:
        words = process.stdout.readline().split()
        assert words[0] == "RECORDING"
        with ScriptedClient(int(words[1].partition("->")[0].rpartition(":")[2])) as client:
            greeting = client.read_line()
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
        process.stdout.close()
    data = b"".join(event.data for event in read(file).events if event.side == "server")
    assert data.decode() == f"{greeting}\r\n"
