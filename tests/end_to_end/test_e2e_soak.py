"""Robots come and go, many times; the server stays the same."""

from __future__ import annotations

import random
from pathlib import Path

import psutil

from usarsim_server.testing import ScriptedClient, ServerProcess, eventually

CLASSES = ("P2AT", "P3AT", "P2DX", "P3DX")


def _visit(server: ServerProcess, chance: random.Random) -> ScriptedClient:
    client = server.client()
    place = f"{chance.uniform(-30, 30):.2f},{chance.uniform(-30, 30):.2f},-0.3"
    client.send(f"INIT {{ClassName {chance.choice(CLASSES)}}} {{Location {place}}}")
    client.send(f"DRIVE {{Left {chance.uniform(-2, 2):.2f}}} {{Right {chance.uniform(-2, 2):.2f}}}")
    client.fence()  # or a slow machine would have more and more of them come at once
    return client


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
        assert server.stop() == 0
        assert "Traceback" not in server.errors
