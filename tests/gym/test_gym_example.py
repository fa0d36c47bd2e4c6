"""The example that learns: it runs, repeats itself, and what its features say helps."""

import functools
import importlib.util
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

PATH = Path(__file__).parents[2] / "examples" / "learn_exploration.py"


@pytest.fixture(scope="module")
def example() -> Any:
    """The program as a module."""
    spec = importlib.util.spec_from_file_location("learn_exploration", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_same_seed_learns_the_same(example: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two generations of few, in this process."""
    for name, value in (("POPULATION", 2), ("ELITE", 1), ("EPISODES", 1), ("STEPS", 8)):
        monkeypatch.setattr(example, name, value)
    monkeypatch.setattr(example, "environment", functools.cache(example.environment.__wrapped__))
    pool = SimpleNamespace(map=map)
    one, other = (example.learn(pool, 1, 2, 1) for _ in range(2))
    assert np.array_equal(one[0], other[0])
    assert one[1] == other[1]
    assert len(one[1]) == 2


def test_short_ways_are_better_than_chance(example: Any) -> None:
    """Weights that like short ways and frontiers ahead find more in less time."""
    weights = np.array([-2.0, 0.0, 0.2, 0.5, 0.0, 1.0])
    learned = [example.test("learned", weights, number) for number in range(2)]
    chance = [example.test("chance", weights, number) for number in range(2)]
    assert np.mean(learned) > np.mean(chance) + 20.0
