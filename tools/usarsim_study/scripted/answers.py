"""What scripted operators answer: workload and preference follow from how they drove."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Any

from usarsim_study.scripted.skill import SPEED

_SPREAD = 0.12  # standard deviation of an answer, as a part of its scale
_SLOW = 0.6  # share of a scale by which a load rises for each unit of speed less
_ROBOT = 0.02  # the same for each robot to look after


@dataclass(slots=True)
class Feeling:
    """How somebody feels.

    Attributes:
        chance: of what is drawn.
        load: how hard the last trial was, 0 to 1.
        likes: answers that are chosen wherever they can be.
    """

    chance: random.Random
    load: float = 0.5
    likes: frozenset[str] = frozenset()


def load_of(speed: float, robots: int) -> float:
    """How hard a trial is: driving slowly is work, and so is looking after many robots."""
    return min(max(0.4 - _SLOW * (speed - SPEED) + _ROBOT * (robots - 4), 0.05), 0.95)


def answer(item: dict[str, Any], feeling: Feeling) -> Any:
    """An answer to an item, as `Form.description` tells of it; None: none is given."""
    chance = feeling.chance
    match item["kind"]:
        case "scale":
            low, high, step = item["low"], item["high"], item["step"]
            share = min(max(chance.gauss(feeling.load, _SPREAD), 0.0), 1.0)
            return low + step * round(share * (high - low) / step)
        case "choice":
            names = [one["name"] for one in item["choices"]]
            liked = [name for name in names if name in feeling.likes]
            return chance.choice(liked or names)
        case "flag":
            return chance.random() < 0.5
        case _:
            return "Nothing to add." if item["required"] else None
