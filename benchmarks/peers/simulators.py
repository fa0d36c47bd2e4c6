"""The other simulators that we are compared with, and the environments they are installed into.

One entry of `PEERS` says what pip is to install, which program of `workloads/` does the work, what
is the same on both sides and what is not. Environments are made for the comparison and thrown away
after it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from usarsim_bench.figures import BenchError
from usarsim_client import Closing

WORKLOADS = Path(__file__).with_name("workloads")


@dataclass(frozen=True, slots=True)
class Peer:
    """Another simulator."""

    name: str  # on the command line, and of its environment; a file name
    title: str  # for people
    home: str  # its page
    packages: tuple[str, ...]
    """What pip is to install, with bounds of the versions that the workload was written for."""
    python: tuple[int, int]
    """Oldest and newest minor version of Python 3 that they can be installed for."""
    workload: str  # file in `peers/workloads/` that does the work
    against: Literal["rovers", "humanoids"]
    """What of ours it is compared with: `rovers` are wheeled robots with a laser inside one
    process, `humanoids` robots of many joints over sockets."""
    same: str  # what is the same on both sides, one or two sentences
    different: str  # what is not, and what is not compared at all
    most: int | None = None  # robots that it takes; None for any number
    most_because: str = ""  # the reason for `most`

    @property
    def script(self) -> Path:
        """The workload."""
        return WORKLOADS / self.workload


IRSIM = Peer(
    name="ir-sim",
    title="IR-SIM",
    home="https://ir-sim.readthedocs.io",
    packages=("ir-sim>=2.12,<3",),
    python=(10, 14),
    workload="irsim_rovers.py",
    against="rovers",
    same="The same hall seen from above, the same starts, the same wheel speeds commanded; a scan "
    "of 181 rays of 20 m from every rover ten times a second; all inside one process, without a "
    "window.",
    different="IR-SIM is a simulator of the plane: rovers are rectangles with the kinematics of a "
    "differential drive that step ten times a second, pushed apart where they overlap "
    "(collision_mode contact); there are no wheels, no heights, no dynamics. Compared are laser "
    "rays and robots moved per second, not physics. Our side also goes through the text protocol.",
)

PYBULLET = Peer(
    name="pybullet",
    title="pybullet",
    home="https://pybullet.org",
    # Its wheels are built with NumPy but do not ask for it.
    packages=("pybullet>=3.2.5,<4", "numpy>=1.26"),
    # There are wheels of 3.2.7 for 3.10 and 3.11, none for 3.12 to 3.14.
    python=(10, 11),
    workload="pybullet_rovers.py",
    against="rovers",
    same="Rigid bodies in contact on both sides: rovers of four wheels, skid steered, with equal "
    "masses and wheels, in the same hall of boxes, with the same wheel speeds commanded; a scan "
    "of 181 rays (rayTestBatch, one thread) of 20 m from every rover ten times a second; all "
    "inside one process.",
    different="pybullet steps 240 times a second (its default), we step 250 times. Our side does "
    "more: commands and scans go through the text protocol, every robot has a battery, "
    "a status line, servos with limited acceleration and contact compensation. Not compared: how "
    "truly either of them moves, rendering, sockets.",
)

RCSSSMJ = Peer(
    name="rcsssmj",
    title="RCSSServerMJ",
    home="https://gitlab.com/robocup-sim/rcssservermj",
    packages=("rcsssmj>=0.2.1,<0.3",),
    python=(10, 14),
    workload="rcsssmj_players.py",
    against="humanoids",
    same="A server with MuJoCo inside, a TCP connection for every robot, clients in another "
    "process, not in real time but as fast as it goes. Humanoids that stand and swing their arms: "
    "K1 of 22 joints there, Nao of 22 joints here; every joint is commanded 50 times a simulated "
    "second. Processor time is that of the server alone.",
    different="They wait in every cycle for all players (50 perceptions a second, objects seen in "
    "every other one); we go on without waiting and send each client 100 lines a second of joint "
    "positions, and others of sensors. Physics steps: 200 a second there, 250 here, in other "
    "models, with MuJoCo 3.5 there. They have a ball, a field and a referee, we have a hall of 82 "
    "boxes. Not compared: lasers (they have none), wheeled robots, how well anybody walks.",
    most=22,
    most_because="two teams of 11 are the most that its largest rule book allows",
)

PEERS: Mapping[str, Peer] = {one.name: one for one in (IRSIM, PYBULLET, RCSSSMJ)}
"""All of them by name."""

INSTALL_TIMEOUT = 600.0
"""s after which pip is given up; the largest wheel has 100 MB."""
_MAKE_TIMEOUT = 120.0
_ASK_TIMEOUT = 20.0
_MARK = "installed.txt"
"""In an environment that is complete: what was installed."""
_ASK_VERSION = "import sys; print(*sys.version_info[:2])"

Run = Callable[[Sequence[str], float], "subprocess.CompletedProcess[str]"]
"""Runs a command for at most so many s; `OSError` or `subprocess.TimeoutExpired` if it cannot."""


class NotInstalledError(BenchError):
    """A simulator cannot be had here; says why."""


def run_quietly(command: Sequence[str], timeout: float) -> subprocess.CompletedProcess[str]:
    """Run a command, keep what it says."""
    return subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=timeout,
    )


def find_python(bounds: tuple[int, int], run: Run = run_quietly) -> str:
    """A Python 3 whose minor version lies within bounds: this one, else the newest on the path.

    Raises:
        NotInstalledError: if there is none.
    """
    low, high = bounds
    if sys.version_info[0] == 3 and low <= sys.version_info[1] <= high:
        return sys.executable
    for minor in range(high, low - 1, -1):
        found = shutil.which(f"python3.{minor}")
        # What is on the path may be a shim for a version that is not there.
        if found is not None and _version(found, run) == (3, minor):
            return found
    wanted = f"Python 3.{low}" + (f" to 3.{high}" if high > low else "")
    raise NotInstalledError(f"it needs {wanted}, and there is none on the path")


def _version(python: str, run: Run) -> tuple[int, ...] | None:
    try:
        answer = run([python, "-c", _ASK_VERSION], _ASK_TIMEOUT)
        return tuple(map(int, answer.stdout.split()))
    except (OSError, subprocess.TimeoutExpired, ValueError):
        return None


class Environments(Closing):
    """The environments of one comparison."""

    def __init__(self, keep: Path | None = None, run: Run = run_quietly) -> None:
        """Make nothing yet.

        Args:
            keep: folder that they stay in, to be used again; None for one that is thrown away.
            run: runs commands.

        Raises:
            BenchError: if the folder cannot be made.
        """
        self._thrown = tempfile.TemporaryDirectory(prefix="usarsim-peers-")
        self._folder = keep or Path(self._thrown.name)
        self._run = run
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BenchError(
                f"{self._folder}: no folder for environments: {error.strerror} (name another one)"
            ) from None

    def python(self, peer: Peer) -> str:
        """The Python of a peer's environment, which is made if it is not there.

        Raises:
            NotInstalledError: if that cannot be done; says why.
        """
        folder = (self._folder / peer.name).absolute()
        python = folder / "bin" / "python"
        mark, wanted = folder / _MARK, "\n".join(peer.packages) + "\n"
        if mark.is_file() and mark.read_text(encoding="utf-8") == wanted and python.exists():
            return str(python)
        shutil.rmtree(folder, ignore_errors=True)
        maker = find_python(peer.python, self._run)
        self._do([maker, "-m", "venv", str(folder)], _MAKE_TIMEOUT, "making an environment")
        command = [str(python), "-m", "pip", "install", "--quiet", "--no-input"]
        command += ["--disable-pip-version-check", "--only-binary", ":all:"]
        command += peer.packages
        self._do(command, INSTALL_TIMEOUT, "installing " + ", ".join(peer.packages))
        mark.write_text(wanted, encoding="utf-8")
        return str(python)

    def close(self) -> None:
        """Throw away what is not to be kept."""
        self._thrown.cleanup()

    def _do(self, command: Sequence[str], timeout: float, what: str) -> None:
        try:
            done = self._run(command, timeout)
        except subprocess.TimeoutExpired:
            raise NotInstalledError(f"{what} took more than {timeout:g} s") from None
        except OSError as error:
            raise NotInstalledError(f"{what} failed: {error.strerror}") from None
        if done.returncode != 0:
            raise NotInstalledError(f"{what} failed: {_reason(done.stderr or done.stdout)}")


def _reason(said: str) -> str:
    """The line of pip's errors that says most: the last one that is marked as an error."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    marked = [line for line in lines if re.match(r"(?i)error:", line)]
    return (marked or lines or ["it said nothing"])[-1][:300]
