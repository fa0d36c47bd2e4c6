"""Who plays runs: the same comes of them on this machine and on a cluster, whatever dies."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from batch_tasks import Told, play
from held_ports import held_port

from usarsim_batch.engines import Here, Local, find_engine
from usarsim_batch.errors import BatchError
from usarsim_batch.worker import Limits
from usarsim_server import cli

TASKS = [Told(f"run {number}", seconds=0.05) for number in range(24)]


def test_who_takes_too_much_is_ended() -> None:
    """BAT-04: what hangs, crashes or eats memory is ended, with its log; the others go on."""
    tasks = [Told("a", "crashes"), Told("c", "eats"), Told("d"), Told("e")]
    engines = (
        (Local(2, Limits(seconds=2)), [Told("b", "hangs")]),
        # On a busy machine a run may need long until it has eaten so much.
        (Local(2, Limits(seconds=200, memory=300 << 20)), tasks),
    )
    found = {
        task.key: played for engine, some in engines for task, played in engine.play(play, some)
    }
    assert found["a"].error == "its process ended with code -11"
    assert "last words" in str(found["a"].about["log"])
    assert found["b"].error == "took longer than 2 s (see --time-limit)"
    assert found["c"].error == "took more than 300 MiB (see --memory-limit)"
    assert found["d"].row == {"name": "d", "value": 1}
    assert not found["e"].error
    assert {"version", "commit", "libraries", "processor"} <= set(found["d"].about)


def test_nothing_is_left_behind() -> None:
    """Who stops in the middle leaves no process, not even one that hangs."""
    with closing(Local(2, Limits()).play(play, [Told("a"), Told("b", "hangs")])) as played:
        assert next(played)[0].key == "a"
        assert (below := _children())
    assert not below & _children()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a Dask scheduler, and its two workers."""
    pytest.importorskip("distributed")
    bound = ["--host", "127.0.0.1"]
    worker = [*bound, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    with ExitStack() as stack:
        port = stack.enter_context(held_port())
        place = f"127.0.0.1:{port}"
        commands = [
            ["scheduler", *bound, "--port", str(port), "--no-dashboard"],
            *[["worker", f"tcp://{place}", *worker]] * 2,
        ]
        programs = []
        for number, words in enumerate(commands):
            log = stack.enter_context((tmp_path / f"{number}.log").open("wb"))
            program = subprocess.Popen(
                [sys.executable, "-m", "dask", *words], stdout=log, stderr=log, cwd=tmp_path,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            )  # fmt: skip
            stack.callback(program.wait)
            stack.callback(program.kill)
            programs.append(program)
        yield place, programs[1:]


def test_a_cluster_with_a_worker_killed(
    cluster: tuple[str, list[subprocess.Popen[bytes]]],
) -> None:
    """BAT-02, BAT-03: the same rows, each once, though a worker is killed in the middle."""
    place, workers = cluster
    rows = {}
    for number, (task, played) in enumerate(
        find_engine(f"dask://{place}", None, Limits()).play(play, TASKS)
    ):
        assert task.key not in rows
        rows[task.key] = played.row
        if number == 4:
            workers[0].kill()
    assert [rows[task.key] for task in TASKS] == [one.row for _, one in Here().play(play, TASKS)]


def test_who_cannot_play(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line with the cure: no such engine, nobody there, no number of workers."""
    for cluster, jobs, told in (
        ("ray://here:1", None, "'ray://here:1' is no cluster known here (cure: write dask://"),
        (None, -1, "--jobs: -1 is no number of workers"),
    ):
        with pytest.raises(BatchError) as found:
            find_engine(cluster, jobs, Limits())
        assert told in str(found.value)
    pytest.importorskip("distributed")
    monkeypatch.setattr("usarsim_batch.dask_engine._PATIENCE", 0.3)
    with pytest.raises(BatchError, match=r"dask://127.0.0.1:1: cannot be reached: .*cure: start"):
        find_engine("dask://127.0.0.1:1", None, Limits())


def test_no_cluster_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A cluster that is none is told before anything is written."""
    out = tmp_path / "out"
    command = ["explore", "bench", "quick", "--out", str(out), "--cluster", "ray://here"]
    assert cli.main(command) == 2
    assert capsys.readouterr().err.startswith("error: --cluster: 'ray://here' is no cluster")
    assert not out.exists()


def _children() -> set[str]:
    listed = subprocess.run(["ps", "--ppid", str(os.getpid()), "-o", "pid=,args="],
                            capture_output=True, text=True).stdout  # fmt: skip
    return {line for line in listed.splitlines() if "usarsim_batch.worker" in line}
