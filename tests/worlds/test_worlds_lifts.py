"""Lifts: what they carry, when they go, what they do not crush."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from machine_stage import Stage

HOIST = (
    '[[lift]]\nname = "hoist"\nsize = [1.6, 1.6, 0.1]\nstops = [[0.0, 0.0, 0.1], [0.0, 0.0, 1.1]]\n'
)
CALLED = HOIST + 'runs = "load"\n'
CART = (
    '[[obstacle]]\nname = "cart"\nsize = [0.4, 0.4, 0.4]\nway = "once"\ndelay = 1.0\n'
    "points = [[-4.0, 0.0, 0.0], [-1.2, 0.0, 0.0]]\nspeed = 1.0\n"
)


class TestCarrying:
    """What stands on a platform goes where it goes."""

    def test_up_and_down_at_its_speed(self, tmp_path: Path) -> None:
        """A crate rises by 1 m at 0.3 m/s, neither pressed in nor thrown up, and comes down."""
        stage = Stage(tmp_path, HOIST, (0.3, 0.2, 0.25))
        stage.run(4.9)
        assert stage.place("crate0")[2] == pytest.approx(0.25, abs=2e-3)
        fastest = 0.0
        for _ in range(50):
            stage.run(0.1)
            fastest = max(fastest, float(stage.velocity("crate0")[2]))
            assert stage.place("crate0")[2] - stage.place("hoist")[2] == pytest.approx(
                0.15, abs=2e-3
            )
        assert fastest == pytest.approx(0.3, abs=0.01)
        assert stage.place("crate0")[2] == pytest.approx(1.25, abs=2e-3)
        stage.run(9.0)
        assert stage.place("crate0") == pytest.approx([0.3, 0.2, 0.25], abs=3e-3)

    def test_sideways_by_friction(self, tmp_path: Path) -> None:
        """A platform that shuttles takes a crate along without losing it."""
        sheet = HOIST.replace("[0.0, 0.0, 1.1]", "[3.0, 0.0, 0.1]") + "speed = 0.8\n"
        stage = Stage(tmp_path, sheet, (0.0, 0.0, 0.25))
        stage.run(5.0 + 3.0 / 0.8 + 0.8 / 0.5 + 0.3)
        assert stage.place("hoist")[0] == pytest.approx(3.0)
        assert stage.place("crate0")[:2] == pytest.approx([3.0, 0.0], abs=0.02)

    def test_all_stops_there_and_back(self, tmp_path: Path) -> None:
        """By the clock it calls at every stop, turns round at the last and comes back."""
        sheet = HOIST.replace("1.1]]", "1.1], [0.0, 0.0, 2.1]]") + "pause = 1.0\nspeed = 1.0\n"
        stage = Stage(tmp_path, sheet + "acceleration = 5.0\n")
        heights: list[float] = []
        for _ in range(130):
            stage.run(0.1)
            height = round(float(stage.place("hoist")[2]), 6)
            if math.isclose(height % 1.0, 0.1, abs_tol=1e-5) and height not in heights[-1:]:
                heights.append(height)
        assert heights[:6] == pytest.approx([0.1, 1.1, 2.1, 1.1, 0.1, 1.1])


class TestCalls:
    """Lifts that go when somebody wants to go."""

    def test_it_waits_for_nobody_in_particular(self, tmp_path: Path) -> None:
        """Without anybody near it stays."""
        stage = Stage(tmp_path, CALLED, (0.0, 4.0, 0.15))
        stage.run(6.0)
        assert stage.place("hoist")[2] == pytest.approx(0.1)

    def test_it_goes_with_its_load_once(self, tmp_path: Path) -> None:
        """2 s after something has come onto it, it goes, and stays there until that is off."""
        stage = Stage(tmp_path, CALLED, (0.0, 4.0, 0.15))
        stage.run(1.0)
        stage.put("crate0", (0.0, 0.0, 0.26))
        stage.run(1.9)
        assert stage.place("hoist")[2] == pytest.approx(0.1)
        stage.run(6.0)
        assert stage.place("hoist")[2] == pytest.approx(1.1)
        stage.run(4.0)
        assert stage.place("hoist")[2] == pytest.approx(1.1)
        stage.put("crate0", (0.0, 4.0, 0.15))
        stage.run(0.5)
        stage.put("crate0", (0.0, 0.0, 1.26))
        stage.run(7.0)
        assert stage.place("hoist")[2] == pytest.approx(0.1)
        assert stage.place("crate0")[2] == pytest.approx(0.25, abs=3e-3)

    def test_it_waits_for_who_stands_on_the_edge(self, tmp_path: Path) -> None:
        """With something half on it, it does not leave."""
        stage = Stage(tmp_path, CALLED, (0.75, 0.0, 0.26))
        stage.run(8.0)
        assert stage.place("hoist")[2] == pytest.approx(0.1)

    def test_it_comes_to_who_waits(self, tmp_path: Path) -> None:
        """Somebody who stops beside the lower stop has it come down."""
        sheet = CALLED.replace("[[0.0, 0.0, 0.1], [0.0, 0.0, 1.1]]", "[[0, 0, 1.1], [0, 0, 0.1]]")
        stage = Stage(tmp_path, sheet + CART)
        stage.run(1.5)
        assert stage.place("hoist")[2] == pytest.approx(1.1)
        stage.run(8.0)
        assert stage.place("hoist")[2] == pytest.approx(0.1)


class TestMercy:
    """Lifts crush nobody."""

    def test_it_stops_above_what_is_below(self, tmp_path: Path) -> None:
        """A crate under a platform that comes down is not touched; when it is gone it goes on."""
        sheet = HOIST.replace("[[0.0, 0.0, 0.1], [0.0, 0.0, 1.1]]", "[[0, 0, 1.1], [0, 0, 0.1]]")
        stage = Stage(tmp_path, sheet + "pause = 1.0\n", (0.3, 0.0, 0.15))
        stage.run(8.0)
        underside = float(stage.place("hoist")[2]) - 0.1
        assert 0.3 < underside < 0.5
        assert stage.place("crate0") == pytest.approx([0.3, 0.0, 0.15], abs=1e-3)
        stage.put("crate0", (3.0, 0.0, 0.15))
        stage.run(2.5)
        assert stage.place("hoist")[2] == pytest.approx(0.1)

    def test_what_rides_is_not_in_the_way(self, tmp_path: Path) -> None:
        """The load of a platform that rises does not stop it, whatever else moves."""
        stage = Stage(tmp_path, HOIST + CART, (0.0, 0.3, 0.25), (0.0, -0.3, 0.25))
        stage.run(10.0)
        assert stage.place("hoist")[2] == pytest.approx(1.1)


def test_runs_repeat_whatever_the_batches(tmp_path: Path) -> None:
    """Batches of 1 and of 9 steps give the same world, bit for bit."""
    one, other = (Stage(tmp_path, CALLED + CART, (0.2, 0.1, 0.26)) for _ in range(2))
    one.run(7.0, batch=1)
    other.run(7.0, batch=9)
    assert one.state() == other.state()
    assert np.isclose(one.place("hoist")[2], 1.1)
