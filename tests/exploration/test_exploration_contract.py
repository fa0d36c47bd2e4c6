"""Strategies see their view and nothing else: planted cheats are found, ours are none."""

import gc
import inspect
import random
import sys
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from lanes import slow_but

from usarsim_exploration.contract import check
from usarsim_exploration.environment import Environment
from usarsim_exploration.strategies.nearest import Nearest
from usarsim_exploration.strategy import TYPES, Plan, Strategy, View
from usarsim_server.cli import main


@dataclass
class Mover(Strategy):
    """Drives to one side or the other as `right` says."""

    def decide(self, view: View) -> Plan | None:
        """One cell."""
        column, row = view.cell
        step = 1 if self.right(view) else -1
        return Plan([(column + step, row)]) if 5 < column + step < 58 else None

    def right(self, view: View) -> bool:
        """Honest: by what the robot knows."""
        return view.known.free % 2 == 0


class Truth(Mover):
    """Finds the true world in memory."""

    def right(self, view: View) -> bool:
        """By what is far away, of the newest world there is."""
        worlds = [one for one in gc.get_objects() if isinstance(one, Environment)]
        return bool(worlds[-1].walls[2:-2, 33:].sum() % 2)


class Clock(Mover):
    """Decides by the time of day."""

    def right(self, view: View) -> bool:
        """By the clock."""
        return time.perf_counter_ns() % 2 == 0


class Chance(Mover):
    """Uses a generator that others use, too."""

    def right(self, view: View) -> bool:
        """By both of them."""
        return random.random() < 0.5 or np.random.random() < 0.5


class Talk(Mover):
    """Tells other robots without a radio."""

    told: ClassVar[dict[int, int]] = {}

    def right(self, view: View) -> bool:
        """By what all have found so far."""
        self.told[view.number] = view.known.free
        return sum(self.told.values()) % 2 == 0


PLACES: dict[int, tuple[int, int]] = {}
LAST: tuple[int, int] | None = None


class Apart(Mover):
    """Keeps away from where another robot is, which a variable of the module says."""

    def right(self, view: View) -> bool:
        """Away from the other."""
        PLACES[view.number] = view.cell
        return view.cell >= PLACES.get(3 - view.number, (0, 0))


class Rebound(Mover):
    """The same, by a variable that is always another object."""

    def right(self, view: View) -> bool:
        """Away from the one that was asked last."""
        global LAST
        other, LAST = LAST, view.cell
        return other is None or view.cell >= other


class Default(Mover):
    """The same, in the default of an argument."""

    def right(self, view: View, seen: set[tuple[int, int]] = set()) -> bool:  # noqa: B006
        """Where no robot was."""
        seen.add(view.cell)
        return (view.cell[0] + 1, view.cell[1]) not in seen


class Queue(Mover):
    """The same, in an object of a library."""

    queue: ClassVar[deque[tuple[int, int]]] = deque(maxlen=2)

    def right(self, view: View) -> bool:
        """Away from the one that was asked before."""
        self.queue.append(view.cell)
        return view.cell >= self.queue[0]


class Board:
    """Not a strategy."""

    first = second = third = (0, 0)


class Posted(Mover):
    """The same, in an object of a class of its own."""

    board: ClassVar[Board] = Board()

    def right(self, view: View) -> bool:
        """Away from the one that was asked before."""
        self.board.first = self.board.second = (0, 1)
        other, self.board.third = self.board.third, view.cell
        return view.cell >= other


class One(Mover):
    """All robots have the same object."""

    def __deepcopy__(self, memo: object) -> "One":
        return self


class Jump(Mover):
    """Is suddenly somewhere else."""

    def right(self, view: View) -> bool:
        """Moves itself."""
        view.cell = (view.cell[0], view.cell[1] + 1)
        return True


@pytest.fixture(autouse=True)
def _alone_in_the_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide the other tests of this folder, which would count as files of the strategy."""
    here = Path(__file__).parent
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file is not None and Path(file).parent == here and name != __name__:
            monkeypatch.delitem(sys.modules, name)


CHEATS = [
    (Truth, "looks into the interpreter (gc.get_objects)"),
    (Clock, "reads a clock (time.perf_counter_ns)"),
    (Chance, "draws from a global generator of random numbers"),
    (Talk, "knows what only others have seen, though no radio works"),
    (Jump, "changes view.cell"),
    (Apart, f"keeps what other robots can read ({__name__}.PLACES)"),
    (Rebound, f"keeps what other robots can read ({__name__}.LAST)"),
    (Default, f"keeps what other robots can read ({__name__}.Default)"),
    (Queue, f"keeps what other robots can read ({__name__}.Queue)"),
    (Posted, f"keeps what other robots can read ({__name__}.Posted)"),
    (One, "is one object for all robots (__deepcopy__)"),
]


# The first walks over all objects of the process, which are many beside other tests.
@pytest.mark.parametrize(("cheat", "breach"), slow_but(lambda pair: pair[0] is not Truth, CHEATS))
def test_cheats_are_found(cheat: type[Strategy], breach: str) -> None:
    """EXP-02, E-83: each, and by what it does."""
    Talk.told.clear()
    assert breach in check(cheat(), 12)


def test_truth_shows_in_what_a_robot_does() -> None:
    """E-83: whichever way it came by it."""
    world: list[np.ndarray] = []

    class Hidden(Mover):
        def right(self, view: View) -> bool:
            return bool(world[0].sum() // (view.step + 1) % 2)

    import usarsim_exploration.contract as contract

    made = contract.set_up

    def leak(environment: Environment, *rest: Any) -> object:
        world[:] = [environment.walls]
        return made(environment, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(contract, "set_up", leak)
        found = check(Hidden(), 12)
    assert "knows what nobody has seen: it depends on the true world" in found
    assert not any("again" in one for one in found)


def test_the_command_names_breaches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """EXP-02: exit code 1, and a line for each."""
    text = inspect.getsource(sys.modules[__name__]).split("\nclass Truth")[0]
    (tmp_path / "mine.py").write_text(text + "\n\nclass Mine(Mover):\n    pass\n")
    assert main(["explore", "check", f"{tmp_path / 'mine.py'}:Mine"]) == 0
    assert capsys.readouterr().out.endswith("mine.py:Mine: keeps to its view\n")
    text += "\n\nclass Mine(Mover):\n    def right(self, view):\n        return time.time() > 0\n"
    (tmp_path / "mine.py").write_text(text)
    assert main(["explore", "check", f"{tmp_path / 'mine.py'}:Mine"]) == 1
    assert "mine.py:Mine: reads a clock (time.time)" in capsys.readouterr().out


def test_what_is_kept_in_another_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A module beside the strategy counts, also one that is imported late; to read it is fine."""
    (tmp_path / "usarsim_told.py").write_text("PLACES = {}\nTURNS = [1, -1]\n")
    text = inspect.getsource(sys.modules[__name__]).split("\nclass Truth")[0]
    text += (
        "\n\nclass Mine(Mover):\n    def right(self, view):\n        import usarsim_told as told\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        for line, breaches in (
            ("        return told.TURNS[view.step % 2] > 0\n", 0),
            ("        told.PLACES[view.number] = view.cell\n        return True\n", 1),
        ):
            (tmp_path / "mine.py").write_text(text + line)
            assert main(["explore", "check", f"{tmp_path / 'mine.py'}:Mine"]) == breaches
            told = capsys.readouterr().out
            assert ("can read (usarsim_told.PLACES)" in told) == breaches
        sys.modules.pop("usarsim_told")


def test_an_honest_one_passes() -> None:
    """The same moves without a cheat."""
    assert check(Mover(), 12) == []
    assert check(Nearest()) == []


@pytest.mark.parametrize(
    "name", slow_but({"frontier", "role-based", "market"}.__contains__, TYPES.names())
)
def test_ours_keep_the_contract(name: str) -> None:
    """EXP-02: every strategy that comes along."""
    assert check(TYPES.find(name, "here")(), 8) == []
