"""Programs that commands start beside themselves take no module from the folder one works in."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from lanes import SLOW

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
    "tools/usarsim_doctor/isolation.py": "names the interpreter in advice",
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
