"""Ground truth is measured by somebody who checks the answers."""

from __future__ import annotations

import json
import math
import socket
import threading
from pathlib import Path

import pytest

from usarsim_bench import groundtruth
from usarsim_bench.groundtruth import Asker
from usarsim_bench.server import BenchError
from usarsim_server.cli import main


def oracle(count: str = "1.0000") -> int:
    """A port that answers like ground truth about any robots; for one client."""
    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        client, _ = listening.accept()
        with listening, client, client.makefile("rb") as lines:
            for line in lines:
                words = line.decode().strip()
                if words == "GETPOS":
                    reply = "POSITIONS {Robots 2} {Name A ...}"
                else:
                    reply = f"NUMOBS {words.removeprefix('GETOBS ')} {{ObstCount {count}}}"
                client.sendall(f"{reply}\r\n".encode())

    threading.Thread(target=serve, daemon=True).start()
    port: int = listening.getsockname()[1]
    return port


def test_asker_asks_for_positions_and_all_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """One round is a question for everybody and one for each ordered pair."""
    monkeypatch.setattr(groundtruth, "TURN", 0.02)
    with Asker(oracle(), ["A", "B", "C"]) as asker:
        while len(asker.positions) < 3:
            threading.Event().wait(0.005)
    assert 12 <= len(asker.obstacles) <= 6 * len(asker.positions)
    assert all(taken > 0.0 for taken in (*asker.positions, *asker.obstacles))


def test_an_unknown_robot_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fast wrong answers do not count: the measurement fails."""
    monkeypatch.setattr(groundtruth, "TURN", 0.02)
    asker = Asker(oracle("-1.0000"), ["A", "B"])
    asker._thread.join(60.0)
    with pytest.raises(BenchError, match=r"GETOBS .* was answered"):
        asker.finish()


def test_nobody_listens() -> None:
    """A port that is closed is said so."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(BenchError, match="cannot be reached"):
        Asker(port, ["A"])


def test_the_measurement_runs_through(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two robots of a real server: answers are there and have aims; none is judged here."""
    monkeypatch.setattr(groundtruth, "SETTLE", 0.3)
    file = tmp_path / "report.json"
    words = ["--robots", "2", "--seconds", "1.5", "--world", "empty", "--json", str(file)]
    assert main(["bench", "groundtruth", *words]) == 0
    (section,) = json.loads(file.read_text())["sections"]
    figures = {figure["name"]: figure for figure in section["figures"]}
    assert all(math.isfinite(figure["value"]) for figure in figures.values())
    assert figures["GETPOS to its answer, median"]["aim"] == "< 10"
    assert figures["GETOBS to its answer, median"]["value"] > 0.0
    assert figures["GETOBS answered"]["value"] > 0.5
    assert figures["Cost of all answers"]["aim"] == "< 0.2"
