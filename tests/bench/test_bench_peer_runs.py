"""Environments are made or refused with a reason; programs in them end, one way or the other."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_bench.peers.simulators import Environments, NotInstalledError, Peer, find_python
from usarsim_bench.peers.work import Outcome, read_outcome, run_workload
from usarsim_bench.server import BenchError
from usarsim_server.testing import eventually

HERE = sys.version_info[1]
PEER = Peer(
    name="wheels",
    title="Wheels",
    home="https://wheels.example",
    packages=("wheels>=1,<2", "spokes"),
    python=(HERE, HERE),
    workload="none.py",
    against="rovers",
    same="",
    different="",
)
RESULT = '{"version": "1", "simulated": 4, "wall": 2, "cpu": 1, "counts": {"scans": 40}}'


class FakeRun:
    """Makes empty environments; pip answers as told."""

    def __init__(self, code: int = 0, said: str = "", error: Exception | None = None) -> None:
        self.commands: list[list[str]] = []
        self._code, self._said, self._error = code, said, error

    def __call__(self, command: Sequence[str], timeout: float) -> subprocess.CompletedProcess[str]:
        self.commands.append(list(command))
        if "venv" in command:
            python = Path(command[-1], "bin", "python")
            python.parent.mkdir(parents=True)
            python.touch()
            return subprocess.CompletedProcess(command, 0, "", "")
        if self._error is not None:
            raise self._error
        return subprocess.CompletedProcess(command, self._code, "", self._said)


class TestEnvironments:
    def test_packages_are_installed_by_its_own_pip(self, tmp_path: Path) -> None:
        """First the environment, then pip in it, with bounds, wheels only and no questions."""
        run = FakeRun()
        with Environments(tmp_path, run) as environments:
            python = environments.python(PEER)
        assert python == str(tmp_path / "wheels" / "bin" / "python")
        made, installed = run.commands
        assert made == [sys.executable, "-m", "venv", str(tmp_path / "wheels")]
        assert installed[:4] == [python, "-m", "pip", "install"]
        assert installed[-2:] == ["wheels>=1,<2", "spokes"]
        assert {"--no-input", "--only-binary"} <= set(installed)

    def test_a_kept_one_is_used_again(self, tmp_path: Path) -> None:
        """What is complete is not installed twice."""
        first, again = FakeRun(), FakeRun()
        with Environments(tmp_path, first) as environments:
            python = environments.python(PEER)
        with Environments(tmp_path, again) as environments:
            assert environments.python(PEER) == python
        assert again.commands == []

    @pytest.mark.parametrize(("code", "packages"), [(0, ("wheels>=2,<3",)), (1, PEER.packages)])
    def test_another_one_or_half_of_one_is_made_new(
        self, tmp_path: Path, code: int, packages: tuple[str, ...]
    ) -> None:
        """One of other versions is not the one asked for; where pip failed it is tried again."""
        with (
            Environments(tmp_path, FakeRun(code)) as environments,
            contextlib.suppress(NotInstalledError),
        ):
            environments.python(PEER)
        run = FakeRun()
        with Environments(tmp_path, run) as environments:
            environments.python(replace(PEER, packages=packages))
        assert len(run.commands) == 2

    @pytest.mark.parametrize(
        ("run", "reason"),
        [
            (
                FakeRun(1, "Looking\nERROR: No matching distribution found for wheels\n\n[notice]"),
                "installing wheels>=1,<2, spokes failed: ERROR: No matching distribution found",
            ),
            (FakeRun(1), "failed: it said nothing"),
            (FakeRun(error=subprocess.TimeoutExpired("pip", 600)), "took more than 600 s"),
            (FakeRun(error=FileNotFoundError(2, "No such file")), "failed: No such file"),
        ],
    )
    def test_reasons(self, tmp_path: Path, run: FakeRun, reason: str) -> None:
        """No wheel, no network, no time, no pip: the reason says which."""
        with Environments(tmp_path, run) as environments, pytest.raises(NotInstalledError) as error:
            environments.python(PEER)
        assert reason in str(error.value)

    def test_is_thrown_away(self) -> None:
        """Without a folder to keep them in nothing is left behind."""
        with Environments(None, FakeRun()) as environments:
            python = Path(environments.python(PEER))
            assert python.exists()
        assert not python.exists()
        assert not python.parents[2].exists()

    def test_a_folder_that_cannot_be_made(self, tmp_path: Path) -> None:
        """The error names it."""
        (tmp_path / "file").touch()
        with pytest.raises(BenchError, match="file/deep: no folder for environments"):
            Environments(tmp_path / "file" / "deep")


class TestPython:
    def test_this_one_if_it_will_do(self) -> None:
        """No other is looked for."""
        assert find_python((HERE - 1, HERE + 1), FakeRun()) == sys.executable

    def test_the_newest_that_really_runs(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A name on the path may stand for a Python that is not there."""
        monkeypatch.setattr(shutil, "which", lambda name: f"/path/{name}")

        def run(command: Sequence[str], timeout: float) -> subprocess.CompletedProcess[str]:
            found = command[0].rpartition("python")[2]
            if found == "3.5":
                return subprocess.CompletedProcess(command, 127, "", "pyenv: not installed")
            return subprocess.CompletedProcess(command, 0, found.replace(".", " ") + "\n", "")

        assert find_python((3, 5), run) == "/path/python3.4"

    def test_none_is_a_reason(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """It says which would have done."""
        monkeypatch.setattr(shutil, "which", lambda name: None)
        with pytest.raises(NotInstalledError, match=r"needs Python 3\.4 to 3\.5"):
            find_python((4, 5), FakeRun())


class TestOutcome:
    def test_is_read(self) -> None:
        """Times give speed and cost, counts rates."""
        outcome = read_outcome(RESULT)
        assert outcome == Outcome("1", 4.0, 2.0, 1.0, {"scans": 40.0})
        assert (outcome.factor, outcome.cost) == (2.0, 0.25)
        assert outcome.per_second("scans") == 10.0

    @pytest.mark.parametrize(
        "text",
        [
            "",
            "[]",
            "{}",
            RESULT.replace("4", '"many"'),
            RESULT.replace('{"scans": 40}', "3"),
            RESULT.replace('"wall": 2', '"wall": 0'),
            RESULT.replace('"simulated": 4', '"simulated": -1'),
            RESULT.replace('"cpu": 1', '"cpu": NaN'),
        ],
    )
    def test_nonsense_is_refused(self, text: str) -> None:
        """What is no result, or an impossible one, is an error of the run."""
        with pytest.raises(BenchError, match="its result"):
            read_outcome(text)

    @given(
        st.recursive(
            st.none() | st.booleans() | st.floats() | st.text(max_size=5),
            lambda inner: (
                st.lists(inner, max_size=3)
                | st.dictionaries(
                    st.sampled_from(["version", "simulated", "wall", "cpu", "counts"]), inner
                )
            ),
        )
    )
    def test_any_json_is_a_result_or_an_error(self, value: object) -> None:
        """Nothing that a program may write gets further than here."""
        try:
            outcome = read_outcome(json.dumps(value))
        except BenchError:
            return
        assert outcome.factor > 0.0


@pytest.fixture
def script(tmp_path: Path) -> Callable[[str], list[str]]:
    """Writes a program; returns the command that runs it."""

    def write(text: str) -> list[str]:
        file = tmp_path / "script.py"
        file.write_text(text)
        return [sys.executable, "-I", str(file)]

    return write


class TestRunning:
    def test_gets_work_and_gives_a_result(self, script: Callable[[str], list[str]]) -> None:
        """The two files are its arguments; what it prints does not matter."""
        command = script(
            "import json, sys\nwork = json.load(open(sys.argv[1]))\nprint('{}')\n"
            "result = {'version': 'x', 'simulated': work['s'], 'wall': 1, 'cpu': 1, 'counts': {}}\n"
            "open(sys.argv[2], 'w').write(json.dumps(result))\n"
        )
        assert run_workload(command, '{"s": 7}', 60.0).simulated == 7.0

    def test_our_paths_are_kept_from_it(
        self, script: Callable[[str], list[str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        """Neither PYTHONPATH nor the current folder leads to anything of ours."""
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        command = script(
            "import os, sys\nsys.exit(f\"path {os.environ.get('PYTHONPATH')} in {os.getcwd()}\")\n"
        )
        with pytest.raises(BenchError, match=r"path None in .*usarsim-peers-"):
            run_workload(command, "{}", 60.0)

    @pytest.mark.parametrize(
        ("text", "reason"),
        [
            ("import nowhere_at_all", "ended with code 1: ModuleNotFoundError: No module named"),
            ("pass", "it wrote no result: it said nothing"),
            ("import sys; open(sys.argv[2], 'w').write('?')", "its result is not to be"),
        ],
    )
    def test_failures(self, script: Callable[[str], list[str]], text: str, reason: str) -> None:
        """The reason is the last thing that it said."""
        with pytest.raises(BenchError, match=reason):
            run_workload(script(text), "{}", 60.0)

    def test_a_program_that_is_not_there(self, tmp_path: Path) -> None:
        """A Python that has vanished is a reason as well."""
        with pytest.raises(BenchError, match="cannot be started: No such file"):
            run_workload([str(tmp_path / "python")], "{}", 60.0)

    def test_what_takes_too_long_is_ended(self, script: Callable[[str], list[str]]) -> None:
        """The reason names the time that it had."""
        with pytest.raises(BenchError, match=r"took more than 0\.5 s"):
            run_workload(script("import time; time.sleep(600)"), "{}", 0.5)

    def test_children_are_ended_too(
        self, script: Callable[[str], list[str]], tmp_path: Path
    ) -> None:
        """A server that a program started does not live on after it."""
        note = tmp_path / "child"
        command = script(
            "import subprocess, sys\n"
            "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'],"
            " stderr=subprocess.DEVNULL)\n"
            f"open({str(note)!r}, 'w').write(str(child.pid))\n"
        )
        with pytest.raises(BenchError, match="wrote no result"):
            run_workload(command, "{}", 60.0)
        child = int(note.read_text())
        assert eventually(lambda: not _alive(child))


def _alive(pid: int) -> bool:
    """Whether a process runs; one that is only waited for does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
