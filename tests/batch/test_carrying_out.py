"""A batch goes on: after a kill, on a full disk, with many results."""

from __future__ import annotations

import argparse
import errno
import json
import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from batch_tasks import Told, play

from usarsim_batch import folder as folders
from usarsim_batch.carry_out import add_options, carry_out
from usarsim_batch.engines import Engine, Here, Local
from usarsim_batch.errors import BatchError
from usarsim_batch.folder import Folder
from usarsim_batch.worker import Limits
from usarsim_server.base.files import held

COORDINATOR = """\
import sys
from pathlib import Path
from test_carrying_out import TASKS, played_batch
from usarsim_batch.engines import Local
from usarsim_batch.worker import Limits
played_batch(Path(sys.argv[1]), TASKS, Local(2, Limits()))
"""
TASKS = [Told(f"run {number}", seconds=0.02) for number in range(50)]


def played_batch(out: Path, tasks: list[Told], engine: Engine) -> int:
    """Play what is left; exit code."""
    parser = argparse.ArgumentParser()
    add_options(parser)
    folder = Folder(out, "test/1", {"tasks": len(tasks)})
    outcome = carry_out(play, tasks, folder, engine, parser.parse_args([]), [])
    folder.finish(one.row for one in outcome)
    return outcome.code


def killed_and_repeated(out: Path, chance: random.Random) -> tuple[int, int]:
    """Kill the coordinator somewhere, then the same again; how many runs had been kept, and how
    many workers of the killed one were left half a second later."""
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    command = [sys.executable, "-c", COORDINATOR, str(out)]
    program = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path})
    wanted = chance.randrange(1, 45)
    while len(list((out / "runs").glob("*.json"))) < wanted and program.poll() is None:
        time.sleep(0.005)
    listed = ["ps", "--ppid", str(program.pid), "-o", "pid="]
    below = subprocess.run(listed, capture_output=True, text=True).stdout.split()
    program.send_signal(signal.SIGKILL)
    program.wait()
    time.sleep(0.5)
    left = sum(_lives(pid) for pid in below)
    before = {one: one.stat().st_mtime_ns for one in (out / "runs").glob("*.json")}
    assert played_batch(out, TASKS, Here()) == 0
    assert all(one.stat().st_mtime_ns == then for one, then in before.items())
    rows = json.loads((out / "result.json").read_text())["runs"]
    assert [row["name"] for row in rows] == [task.key for task in TASKS]
    return len(before), left


def _lives(pid: str) -> bool:
    """Whether a process is there, and not only waits for its parent to notice its end."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def test_the_coordinator_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """BAT-03: the same command finishes; no run is played twice or missing, no worker is left.

    The module itself, run as a program, does that a hundred times.
    """
    monkeypatch.setattr(time, "sleep", _brief)
    kept, left = killed_and_repeated(tmp_path, random.Random(1))
    assert 1 <= kept < 50
    assert left == 0


_SLEEP = time.sleep


def _brief(seconds: float) -> None:
    _SLEEP(0 if seconds == 0.02 else seconds)


def test_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """BAT-03: runs that find no room have failed, with one line; the same command plays them."""
    whole = folders.write

    def full(path: Path, texts: object) -> None:
        if path.stem in ("b", "c"):
            error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            with monkeypatch.context() as patch:
                patch.setattr(folders, "replacing", lambda path: (_ for _ in ()).throw(error))
                whole(path, ["x"])
        whole(path, texts)  # type: ignore[arg-type]

    tasks = [Told(key) for key in "abcd"]
    monkeypatch.setattr(folders, "write", full)
    assert played_batch(tmp_path, tasks, Here()) == 1
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert "b: " in told[0]
    assert "cannot be written: No space left on device (make room" in told[0]
    rows = json.loads((tmp_path / "result.json").read_text())["runs"]
    assert ["error" in row for row in rows] == [False, True, True, False]
    monkeypatch.setattr(folders, "write", whole)
    assert played_batch(tmp_path, tasks, Here()) == 0
    assert "2 of 4 runs are there" in capsys.readouterr().err
    rows = json.loads((tmp_path / "result.json").read_text())["runs"]
    assert not any("error" in row for row in rows)


def test_another_one_plays_them(tmp_path: Path) -> None:
    """Two commands at once would write into the same files; the second one says so, and finds what
    there is when the first has ended."""
    Folder(tmp_path, "test/1", {"tasks": 1})
    with (
        held(tmp_path),
        pytest.raises(BatchError, match=r"another command plays these runs \(wait"),
    ):
        played_batch(tmp_path, [Told("a")], Here())
    assert played_batch(tmp_path, [Told("a")], Here()) == 0


def test_a_damaged_run_is_played_again(tmp_path: Path) -> None:
    """Whatever stands in its file."""
    assert played_batch(tmp_path, [Told("a")], Here()) == 0
    (kept,) = (tmp_path / "runs").glob("*.json")
    whole = kept.read_text()
    for text in ("[" * 100_000, '{"row": 1, "timing": {}}', "null", whole[:9], ""):
        kept.write_text(text)
        assert played_batch(tmp_path, [Told("a")], Here()) == 0
        assert json.loads(kept.read_text())["row"] == json.loads(whole)["row"]


def main() -> None:
    """BAT-03 in full, and BAT-05; prints figures."""
    import tempfile

    import psutil

    chance, found = random.Random(1), []
    for number in range(int(sys.argv[1])):
        with tempfile.TemporaryDirectory() as out:
            found.append(killed_and_repeated(Path(out), chance))
        print(f"\r{number + 1}", end="", file=sys.stderr)
    kept = [one for one, _ in found]
    print(f"\n{len(found)} coordinators killed after {min(kept)} to {max(kept)} of 50 runs, "
          f"workers left: {sum(left for _, left in found)}")  # fmt: skip
    for count, seconds in ((10_000, 0.0), (60, 1.0)):
        with tempfile.TemporaryDirectory() as out:
            before, begun = time.process_time(), time.monotonic()
            tasks = [Told(f"run {one}", seconds=seconds) for one in range(count)]
            played_batch(Path(out), tasks, Local(2, Limits()))
            cpu, wall = time.process_time() - before, time.monotonic() - begun
            memory, part = psutil.Process().memory_info().rss >> 20, 100 * cpu / wall
            print(f"{count} runs of {seconds} s: {wall:.0f} s, coordinator {part:.1f} % of a core, "
                  f"{1e3 * cpu / count:.2f} ms a run, {memory} MiB")  # fmt: skip


if __name__ == "__main__":
    main()
