"""Programs whose clock of the day jumps by years go on as if nothing had happened."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from usarsim_server.testing import PATIENCE, ServerProcess

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        sys.platform != "linux" or shutil.which("cc") is None, reason="no C compiler for Linux"
    ),
]
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What makes the clock of a program jump when it is loaded."""
    built = tmp_path_factory.mktemp("clock") / "clock_jumps.so"
    command = ["cc", "-O1", "-shared", "-fPIC", "-o", built, HERE / "clock_jumps.c"]
    subprocess.run(command, check=True, timeout=PATIENCE)
    return built


def test_the_library_makes_the_clock_jump(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LD_PRELOAD", str(library))
    program = "import time; a = [time.time() for _ in range(200)]; print(max(a) - min(a) > 3e7)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "True\n", done.stderr


def test_a_server_loses_no_report_and_keeps_its_pace(
    library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LD_PRELOAD", str(library))
    with ServerProcess("--world=empty", "--speed=8", "--wireless-port=0") as server:
        client = server.client()
        client.send("INIT {ClassName USARBot.P3AT} {Location 0,0,-0.3}")
        begun, told = time.monotonic(), list[float]()
        while not told or told[-1] - told[0] < 40.0:
            line = client.wait_for("STA {")
            told.append(float(line.partition("{Time ")[2].partition("}")[0]))
            assert time.monotonic() < begun + PATIENCE
        steps = [later - earlier for earlier, later in pairwise(told)]
        assert min(steps) > 0.0
        assert max(steps) < 1.5 * min(steps), "a report is missing"
        assert server.end() == 0
        assert "Traceback" not in server.errors


def test_runs_of_an_exploration_are_the_same(
    library: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Nothing that is judged depends on the time of day."""
    scenario = tmp_path / "run.toml"
    scenario.write_text(
        'seed = 3\n[environment]\ngenerator = "maze"\ncolumns = 120\nrows = 100\n'
        "[team]\nrobots = 3\n"
    )

    def run(name: str) -> dict[str, bytes]:
        words = ["explore", "run", str(scenario), "--out", str(tmp_path / name)]
        command = [sys.executable, "-m", "usarsim_server", *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
        assert done.returncode == 0, done.stderr
        files = {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
        del files["timing.json"]  # says how long it took
        return files

    plain = run("plain")
    monkeypatch.setenv("LD_PRELOAD", str(library))
    assert run("jumping") == plain
