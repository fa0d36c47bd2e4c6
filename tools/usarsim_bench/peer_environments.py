"""Environments of other simulators: made for the comparison, thrown away after it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from usarsim_bench.errors import BenchError
from usarsim_bench.peer import Peer
from usarsim_client.closing import Closing

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

    def __init__(
        self, keep: Path | None = None, run: Run = run_quietly, timeout: float = INSTALL_TIMEOUT
    ) -> None:
        """Make nothing yet.

        Args:
            keep: folder that they stay in, to be used again; None for one that is thrown away.
            run: runs commands.
            timeout: s for pip.

        Raises:
            BenchError: if the folder cannot be made.
        """
        self._thrown = None if keep else tempfile.TemporaryDirectory(prefix="usarsim-peers-")
        self._folder = keep if keep else Path(self._thrown.name) if self._thrown else Path()
        self._run = run
        self._timeout = timeout
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
        command += ["--disable-pip-version-check", *_wheels_only(peer), *peer.packages]
        self._do(command, self._timeout, "installing " + ", ".join(peer.packages))
        mark.write_text(wanted, encoding="utf-8")
        return str(python)

    def close(self) -> None:
        """Throw away what is not to be kept."""
        if self._thrown is not None:
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


def _wheels_only(peer: Peer) -> list[str]:
    return ["--only-binary", ":all:"] if peer.binary else []


def _reason(said: str) -> str:
    """The line of pip's errors that says most: the last one that is marked as an error."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    marked = [line for line in lines if re.match(r"(?i)error:", line)]
    return (marked or lines or ["it said nothing"])[-1][:300]
