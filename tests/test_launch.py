"""Programs that commands start beside themselves take no module from the folder one works in."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from lanes import SLOW

from usarsim_server.base import launch
from usarsim_server.base.launch import LaunchError, OwnServer, Program, python
from usarsim_server.testing import PATIENCE, SIDE_PORTS, eventually

ROOT = Path(__file__).parents[1]
PLANTED = ("mujoco.py", "pickle.py", "multiprocessing.py", "numpy.py", "usarsim_server/__init__.py")
BATCH = """
environments = ["lab"]
teams = [2]
seeds = 1
[end]
steps = 20
"""
SWEEP = """
seeds = 1
[serve]
world = "empty"
lockstep = true
[[controller]]
command = ["{python}", "-c", "print(1)"]
"""
USE_PYTHON = {
    "usarsim_server/base/launch.py": "the place itself",
    "tools/usarsim_doctor/mending.py": "names the interpreter in advice",
    "tools/usarsim_doctor/checks/installation.py": "names the interpreter in a finding",
    "tools/usarsim_batch/sweep/playing.py": "`{python}` of the user's own command lines",
}
"""Files that know the interpreter's path, and why."""


def test_programs_are_started_in_one_place() -> None:
    """No other file makes a command line of the interpreter."""
    files = [*ROOT.glob("usarsim_*/**/*.py"), *ROOT.glob("tools/**/*.py")]
    found = {
        str(file.relative_to(ROOT))
        for file in files
        if "sys.executable" in file.read_text() and "peers" not in file.parts
    }
    assert found == set(USE_PYTHON)


@pytest.mark.parametrize(
    "words",
    [
        ("snapshot", "picture.png", "--world", "empty"),
        ("sweep", "sweep.toml", "--out", "swept"),
        pytest.param(
            ("explore", "bench", "batch.toml", "--out", "batch", "--jobs=1", "--strategy=greedy"),
            marks=SLOW,
        ),
        pytest.param(
            ("explore", "run", "run.toml", "--backend", "server", "--steps=3", "--out", "run"),
            marks=SLOW,
        ),
        pytest.param(("conformance", "--self", "--only", "control.init.case"), marks=SLOW),
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_no_module_of_the_folder_is_run(words: tuple[str, ...], tmp_path: Path) -> None:
    """What lies there by the name of a library stays unread."""
    for name in PLANTED:
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"open({str(tmp_path / 'RAN')!r}, 'a').write(__name__)\n")
    (tmp_path / "batch.toml").write_text(BATCH)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    (tmp_path / "run.toml").write_text('[environment]\nname = "lab"\n[team]\nrobots = 2\n')
    command = [sys.executable, "-P", "-m", "usarsim_server", *words]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert not (tmp_path / "RAN").exists(), (tmp_path / "RAN").read_text()
    assert done.returncode in (0, 1), done.stdout + done.stderr


PARENT = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print("READY", child.pid, flush=True)
print("a complaint", file=sys.stderr, flush=True)
time.sleep(600)
"""


def test_what_a_program_has_started_ends_with_it() -> None:
    """Both are ended by one signal; what was said is kept."""
    with Program("the parent", python("-c", PARENT)) as program:
        [ready] = program.announced(r"READY (\d+)")
        assert eventually(lambda: "a complaint" in program.said)
        assert not program.died
        assert program.end() == -signal.SIGTERM
    assert program.died
    assert eventually(lambda: gone(int(ready[1])))


def test_what_a_program_has_started_ends_when_it_ends_by_itself() -> None:
    """Nobody has to ask for it."""
    with Program("the parent", python("-c", PARENT.replace("time.sleep(600)", ""))) as program:
        [ready] = program.announced(r"READY (\d+)")
        assert program.ended.result(PATIENCE) == 0
        assert eventually(lambda: gone(int(ready[1])))


def gone(pid: int) -> bool:
    """Whether a process has ended; one whose parent does not ask for it stays as a zombie."""
    return not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


def test_a_program_that_ignores_its_end_is_killed() -> None:
    """After its grace."""
    code = "import signal, time; signal.signal(15, signal.SIG_IGN); print('on', flush=True)"
    with Program("the deaf one", python("-c", f"{code}; time.sleep(600)")) as program:
        program.grace = 0.1
        program.announced("on")
        assert program.end() == -signal.SIGKILL


def test_how_a_start_fails() -> None:
    """A program says what is wrong, says nothing in time, or cannot be run at all."""
    wrong = "import sys; sys.exit('no such thing')"
    with pytest.raises(LaunchError, match="the thing did not start: no such thing"):
        Program("the thing", python("-c", wrong)).announced("READY")
    slow = Program("the thing", python("-c", "import time; time.sleep(600)"))
    with pytest.raises(LaunchError, match=r"the thing said nothing within 0\.1 s"):
        slow.announced("READY", patience=0.1)
    assert slow.died
    with pytest.raises(LaunchError, match="/no/such/file: cannot be started: No such file"):
        Program("it", ["/no/such/file"])
    with pytest.raises(LaunchError, match=r"the server did not start: error: .*atlantis"):
        OwnServer("--world=atlantis")


def test_a_loud_program_is_not_held_up() -> None:
    """All that it writes is taken; of much, the last lines are kept."""
    code = "import sys\nfor n in range(100_000): print(n, file=(sys.stdout, sys.stderr)[n % 2])"
    program = Program("the loud one", python("-c", code))
    assert program.ended.result(PATIENCE) == 0
    assert "99999\n" in program.errors
    assert program.errors.count("\n") == 2000


def test_no_port_is_open_but_those_asked_for() -> None:
    """Every option for a port of the server is known to who starts one."""
    assert {f"{name}_port" for name in launch._SIDE} == set(SIDE_PORTS)
