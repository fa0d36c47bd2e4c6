"""`python -m usarsim_bench.threads`: what each thread of a server used."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import pytest

from usarsim_bench import threads
from usarsim_server.testing import PATIENCE, eventually


def test_a_thread_is_known_by_its_name() -> None:
    """What a thread called physics does counts as physics, and as nothing else."""
    begin, stop = threads.look(), threading.Event()

    def work() -> None:
        until = time.thread_time() + 0.2
        while time.thread_time() < until:
            pass
        stop.wait(PATIENCE)

    worker = threading.Thread(target=work, name="physics", daemon=True)
    worker.start()
    assert eventually(lambda: threads.look().spent["physics"] >= begin.spent["physics"] + 0.19)
    seen = threads.look()
    stop.set()
    worker.join(PATIENCE)
    assert seen.spent["drawing"] == begin.spent["drawing"]
    assert seen.moment > begin.moment


def test_a_run_leaves_its_looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The subcommand gets its own words, its exit code is kept, and the file holds the looks."""
    seen: list[list[str]] = []

    def serve(words: list[str]) -> int:
        seen.append(words)
        assert eventually(lambda: len(taken) >= 2)
        return 3

    taken: list[threads.Look] = []
    look = threads.look

    def note() -> threads.Look:
        taken.append(look())
        return taken[-1]

    monkeypatch.setattr(threads, "PERIOD", 0.01)
    monkeypatch.setattr(threads, "look", note)
    monkeypatch.setattr(threads, "usarsim", serve)
    file = tmp_path / "looks.json"
    assert threads.main([str(file), "serve", "--port", "0"]) == 3
    assert seen == [["serve", "--port", "0"]]
    looks = json.loads(file.read_text())
    assert len(looks) >= 2
    assert [one["moment"] for one in looks] == sorted(one["moment"] for one in looks)
    assert {"physics", "reports", "sockets", "drawing", "encoding", "others"} == set(
        looks[0]["spent"]
    )
