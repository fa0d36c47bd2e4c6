"""Where memory would not do, a robot is refused; MuJoCo would end the process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from usarsim_server.simulation import growth as memory
from usarsim_server.simulation.growth import MIB, shortage
from usarsim_server.simulation.model import PhysicsOptions, compile_world

HOLD = 120.0
"""s of wall time after which a test gives up."""

SCRIPT = """
import resource
from usarsim_server.base.errors import SpawnError
from usarsim_server.testing import Rehearsal

with Rehearsal(world="empty", max_robots=64) as stage:
    with open("/proc/self/statm") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    most = used + {room} * 2**20
    resource.setrlimit(resource.{limit}, (most, most))
    robots, pose = stage.assembly.robots, stage.assembly.world.starts[0].pose
    here = 0
    try:
        while here < 60:
            for name in ("TeleMax", "Nao", "PR2"):
                robots.spawn(robots.describe(name), None, pose)
                here += 1
            stage.run(0.1)
    except SpawnError as error:
        print(here, error)
    stage.run(0.5)
    print("alive")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
@pytest.mark.parametrize(("limit", "room"), [("RLIMIT_AS", 40), ("RLIMIT_AS", 400)])
def test_robots_are_refused_under_a_limit(limit: str, room: int) -> None:
    """The world goes on, with as many robots as there is memory for."""
    script = SCRIPT.format(limit=limit, room=room)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=HOLD, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    refusal, alive = done.stdout.splitlines()[-2:]
    assert alive == "alive"
    assert "there is not enough memory for" in refusal
    assert "ulimit -v" in refusal
    assert (int(refusal.split()[0]) > 0) is (room > 100)


class TestShortage:
    """What is missing, and by which limit."""

    WORLD = compile_world(mujoco.MjSpec, [], PhysicsOptions(), 0)

    def test_without_limits(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Nothing is refused."""
        monkeypatch.setattr(memory.resource, "getrlimit", lambda _: (-1, -1))
        monkeypatch.setattr(memory, "_GROUPS", Path("/nowhere"))
        assert shortage(self.WORLD, 10_000) is None

    def test_control_groups(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """The narrowest one counts; files that were read do not."""
        inner = tmp_path / "outer" / "inner"
        inner.mkdir(parents=True)
        for folder, most in ((inner, "max"), (inner.parent, str(int(300 * MIB)))):
            (folder / "memory.max").write_text(most)
            (folder / "memory.current").write_text(str(int(250 * MIB)))
            (folder / "memory.stat").write_text(f"anon 1\ninactive_file {int(20 * MIB)}\n")
        own = tmp_path / "cgroup"
        own.write_text("1:name=systemd:/elsewhere\n0::/outer/inner\n")
        monkeypatch.setattr(memory.resource, "getrlimit", lambda _: (-1, -1))
        monkeypatch.setattr(memory, "_GROUPS", own)
        monkeypatch.setattr(memory, "_GROUP_ROOT", tmp_path)
        missing = shortage(self.WORLD, 6)
        assert missing is not None
        assert missing.endswith("70 MiB left by the control group")
