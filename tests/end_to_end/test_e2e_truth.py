"""The truth channel over sockets: complete at every pace, and the same in every run."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
import threading
from typing import BinaryIO, cast

import pytest
from lanes import slow_but

from usarsim_client.scene import TruthRow, connect_scene
from usarsim_server.testing import PATIENCE, ScriptedClient, ServerProcess

TICKS = 40


async def read(port: int, count: int, pause: float = 0.0) -> list[TruthRow]:
    """The first so many rows, read with a pause of wall time after each."""
    rows = []
    async with asyncio.timeout(PATIENCE):
        async with await connect_scene("127.0.0.1", port, channels=["truth"]) as live:
            for _ in range(count):
                rows.append(await live.truth())
                await asyncio.sleep(pause)
    return rows


def times(rows: list[TruthRow]) -> list[int]:
    """In tenths of a second, from the first."""
    return [round(10 * (row.time - rows[0].time)) for row in rows]


def drive(port: int) -> ScriptedClient:
    """A robot on a bend."""
    client = ScriptedClient(port)
    client.send("INIT {ClassName USARBot.P3AT} {Name R1} {Location 0,0,-0.3}")
    client.send("DRIVE {Left 3} {Right 2.5}")
    return client


@pytest.mark.parametrize("speed", slow_but({"max"}.__contains__, ["1", "8", "max"]))
def test_no_row_is_left_out_at_any_pace(speed: str) -> None:
    """Each 0.1 s of simulated time once, also for one who is slower than the world."""
    with ServerProcess("--world=empty", "--scene-port=0", f"--speed={speed}") as server:
        with drive(server.ports["control"]) as client:
            client.wait_for("STA")
            stop = threading.Event()
            threading.Thread(target=_swallow, args=(client, stop), daemon=True).start()
            rows = asyncio.run(read(server.ports["scene"], 60, 0.0 if speed == "1" else 0.02))
            stop.set()
        assert times(rows) == list(range(60))
        assert rows[0].time * 10 == pytest.approx(round(rows[0].time * 10), abs=1e-3)
        assert [one.name for one in rows[0].robots] == ["R1"]


def _swallow(client: ScriptedClient, stop: threading.Event) -> None:
    """Read what a robot is told: at `--speed max` the world waits for that, too."""
    try:
        while not stop.is_set():
            client.read_line()
    except (OSError, ValueError):
        pass


def lockstep(left: float) -> list[bytes]:
    """Rows of a run in lockstep in a process of its own, as bytes."""
    with ServerProcess("--world=empty", "--scene-port=0", "--lockstep", "--seed=3") as server:
        scene = socket.create_connection(("127.0.0.1", server.ports["scene"]), PATIENCE)
        hello = json.dumps({"hello": 1, "channels": ["truth"]}).encode()
        scene.sendall(struct.pack(">I", len(hello) + 1) + b"J" + hello)
        stream = cast(BinaryIO, scene.makefile("rb"))
        with scene, stream, server.client() as client:
            frames = [_frame(stream) for _ in range(2)]  # the welcome, the row of 0.0
            client.send("INIT {ClassName USARBot.P3AT} {Name R1} {Location 0,0,-0.3}")
            client.send(f"DRIVE {{Left {left}}} {{Right 2.5}}")
            client.send(f"SYNC {{Ticks {TICKS}}}")
            frames += [_frame(stream) for _ in range(TICKS)]
        return frames[1:]


def _frame(stream: BinaryIO) -> bytes:
    (length,) = struct.unpack(">I", stream.read(4))
    return bytes(stream.read(length))


def test_equal_runs_in_lockstep_give_equal_bytes() -> None:
    """O-55, HRI-09: rows of two processes are the same, another command changes them."""
    first = lockstep(1.0)
    assert len(first) == TICKS + 1
    assert json.loads(first[0][1:])["time"] == 0.0
    assert lockstep(1.0) == first
    assert lockstep(1.0001)[-1] != first[-1]
