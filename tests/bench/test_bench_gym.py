"""`usarsim bench gym`: what is measured, and what it says without the extra."""

import sys

import pytest

from usarsim_bench import gym
from usarsim_bench.figures import Plan
from usarsim_bench.gym import CASES, Cost, measure, measure_gym
from usarsim_bench.server import BenchError


def test_an_environment_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """DOOR-11, DOOR-12: the level below takes part of a step, and there is a bare loop."""
    monkeypatch.setattr(gym, "BARE_STEPS", 100)
    cost = measure("ExplorePhysics", 210, 0)
    assert 0.0 < cost.below < cost.step
    assert 0.0 < cost.bare < cost.step
    assert 0.0 < cost.reset < cost.first
    assert cost.growth < 20.0


def test_all_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures of each, with the aims of DOOR-11 and DOOR-12."""
    cost = Cost(0.001, 0.0005, 0.0003, 0.4, 0.006, 1.0)
    monkeypatch.setattr("usarsim_bench.gym.run_apart", lambda *_: cost)
    section = measure_gym(Plan(seconds=0.2))
    assert {one.name.partition(":")[0] for one in section.figures} == set(CASES)
    assert all(one.met is not False for one in section.figures)
    assert sum(one.met is True for one in section.figures) == 10


def test_without_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """DOOR-13: one sentence with the pip command; the command ends with status 2."""
    for name in [one for one in sys.modules if one.startswith("usarsim_gym")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(BenchError, match=r"\(pip install \"usarsim-server\[gym\]\"\)$"):
        measure_gym(Plan())
