"""Trials in another process: whatever happens to it, each trial gets an outcome."""

from __future__ import annotations

from pathlib import Path

import pytest

from usarsim_server.doctor import worker as trials
from usarsim_server.doctor.isolation import Outcome, attempt
from usarsim_server.doctor.worker import try_out
from usarsim_server.errors import UsarsimError
from usarsim_server.settings import Settings

WORKER = """
import json, os, pickle, signal, sys, time
names, settings = pickle.loads(sys.stdin.buffer.read())
for name in names:
    if name == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "hangs":
        time.sleep(600)
    if name == "exits":
        sys.exit("last words")
    print("a library talks: {not JSON}")
    print(json.dumps({"trial": name, "values": {"world": settings.world}}), flush=True)
"""


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A worker whose trials come to grief by name."""
    (tmp_path / "grieving_worker.py").write_text(WORKER)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "grieving_worker"


def test_trials_after_one_that_dies_are_made_by_another_process(worker: str) -> None:
    """Every other trial succeeds; those that ended their process say how."""
    names = ["one", "dies", "two", "exits", "three"]
    found = attempt(names, Settings(world="office"), 60.0, worker)
    good = Outcome({"world": "office"})
    assert found == {
        "one": good,
        "dies": Outcome(failure="the process was ended by SIGKILL"),
        "two": good,
        "exits": Outcome(failure="last words"),
        "three": good,
    }


def test_a_trial_that_hangs_is_given_up(worker: str) -> None:
    """What was done before counts, and the trial says that it did not end."""
    found = attempt(["one", "hangs"], Settings(), 2.0, worker)
    assert found["hangs"] == Outcome(failure="did not end within 2 s")


def test_the_real_worker_answers() -> None:
    """Importing a library in another process tells its version, a missing one its name."""
    found = attempt(["package:hypothesis", "package:no_such_library"], Settings(), 60.0)
    assert found["package:hypothesis"].values["version"].count(".") >= 1
    assert found["package:no_such_library"].missing == "no_such_library"


def test_errors_become_outcomes(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error for users keeps its advice apart; a defect says of what kind it is."""

    def fail(settings: Settings, argument: str) -> dict[str, object]:
        raise error

    monkeypatch.setattr(trials, "server", fail)
    error: Exception = UsarsimError("world: no floor (add one)")
    told = {"failure": "world: no floor", "told": True, "advice": "add one"}
    assert try_out("server:", Settings()) == told
    error = ValueError("bad\nnews")
    assert try_out("server", Settings()) == {"failure": "ValueError: bad news"}
