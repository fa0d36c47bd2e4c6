"""What it took: ways, double work, and how evenly robots share it."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.history import RETURNING, Counts, History
from usarsim_exploration.idleness import WAITING
from usarsim_exploration.measures.base import JAIN, MRESIM, ROBOTS, YAN, declare, jain, lasting


def _driven(history: History) -> NDArray[np.float64]:
    return history.distance[-1, ROBOTS]


def _firsts(history: History) -> Counts:
    """Cells that each robot was the first to find."""
    found: Counts = history.first[:, ROBOTS].sum(axis=0)
    return found


@declare("distance", "Distance", "cells", "That all robots drove together.", MRESIM, "less")
def _distance(history: History) -> float:
    return float(_driven(history).sum())


@declare(
    "longest_distance", "Longest distance", "cells", "Of the robot that drove most.", better="less"
)
def _longest_distance(history: History) -> float:
    return float(_driven(history).max())


@declare(
    "efficiency", "Cells found per cell driven", "1",
    "Free cells that the team has known, by the distance of all robots; none if nobody drove.",
    YAN, "more",
)  # fmt: skip
def _efficiency(history: History) -> float | None:
    driven = _distance(history)
    assert driven is not None
    return int(history.free_team[-1]) / driven if driven else None


@declare(
    "overlap", "Found again", "%",
    "Of the cells that scans added to a robot's own map, how many another one had found before.",
    better="less",
)  # fmt: skip
def _overlap(history: History) -> float | None:
    found = int(history.found[:, ROBOTS].sum())
    return 100 * (1 - int(_firsts(history).sum()) / found) if found else None


@declare(
    "coverage_deviation", "Spread of what robots found", "%",
    "Standard deviation over robots of their parts of the cells that were found for the first "
    "time.", better="less",
)  # fmt: skip
def _coverage_deviation(history: History) -> float | None:
    firsts = _firsts(history)
    return float(100 * np.std(firsts / firsts.sum())) if firsts.any() else None


@declare(
    "jain_found", "Fairness of what robots found", "1",
    "Jain's index of the cells that each robot was the first to find: 1 if equal, 1 by the number "
    "of robots if one found all.", JAIN, "more",
)  # fmt: skip
def _jain_found(history: History) -> float | None:
    return jain(_firsts(history))


@declare(
    "jain_distance", "Fairness of distances", "1", "Jain's index of the distances of robots.",
    JAIN, "more",
)  # fmt: skip
def _jain_distance(history: History) -> float | None:
    return jain(_driven(history))


def _robot_steps(history: History, what: str) -> int:
    return int(np.count_nonzero(getattr(history, what)[:, ROBOTS]))


for _what, _text in (
    ("sensing", "Steps in which a robot found what nobody knew, of all robots together."),
    (
        "double_sensing",
        "Steps in which not all that was new to a robot was new to the team, of all robots.",
    ),
    ("returning", "Steps in which a robot carried what it found, or waited to hand it over."),
    ("not_sensing", "Steps in which a working robot found nothing that was new to it."),
):
    declare(_what, _what.replace("_", " ").capitalize(), "robot steps", _text, MRESIM)(
        partial(_robot_steps, what=_what)
    )


@declare(
    "longest_stand", "Longest stand", "steps",
    "Longest time that a working robot stayed in its cell, before the team found its last one.",
    better="less",
)  # fmt: skip
def _longest_stand(history: History) -> int:
    until = int(np.argmax(history.free_team)) + 1
    cells, works = history.cell[:until, ROBOTS], history.works[:until, ROBOTS]
    stood = (cells[1:] == cells[:-1]).all(axis=-1) & works[1:]
    return int(lasting(stood).max(initial=0))


@declare(
    "longest_idle", "Longest idle stand", "steps",
    "Longest time that a working robot stood though its map had a frontier that it could drive to, "
    "with free cells behind it; looked at every 10 steps of a stand. Robots that wait for others "
    "do not count: those whose role is relay, parked relays, and whoever is at a meeting.",
    better="less",
)  # fmt: skip
def _longest_idle(history: History) -> int:
    return int(history.idle[:, ROBOTS].max(initial=0))


def longest_without_news(history: History) -> int:
    """In steps; see there."""
    state = history.state[:, ROBOTS]
    other = [np.char.startswith(state, word) for word in {*RETURNING, *WAITING}]
    searches = history.works[:, ROBOTS] & (history.role[:, ROBOTS] == "explorer")
    searches &= ~np.logical_or.reduce(other)
    vain = searches[1:].any(axis=1) & (np.diff(history.free_team) <= 0)
    return int(lasting(vain[:, None]).max(initial=0))


declare(
    "longest_without_news", "Longest search without news", "steps",
    "Longest time in which the team found no free cell that nobody had known, though a working "
    "robot searched: it was none that returned, relayed or waited for others.",
    better="less", since=2,
)(longest_without_news)  # fmt: skip


@declare(
    "collisions", "Collisions", "1", "Moves that met a wall nobody had told of.", better="less"
)
def _collisions(history: History) -> int:
    return int(np.char.count(history.moves, "x").sum())


@declare("role_swaps", "Role swaps", "1", "Pairs of robots that swapped their roles.", MRESIM)
def _role_swaps(history: History) -> int:
    return int(history.role_swaps[-1])
