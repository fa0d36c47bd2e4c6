"""How much is known, when, and to whom."""

from __future__ import annotations

from functools import partial
from typing import Literal

import numpy as np

from usarsim_exploration.history import Counts, History
from usarsim_exploration.measures.base import LITTLE, MRESIM, OURS, ROBOTS, YAN, declare, time_to

SHARES = (50, 90, 95, 99)
"""Percent of the reachable free cells whose times are told."""
Who = Literal["team", "base"]
_KNOWING = {"team": "somebody has known", "base": "the base knows"}


def _cells(history: History, who: Who) -> Counts:
    """Those that count for shares of the reachable ones."""
    return history.known_team if who == "team" else history.known_base


def _percent_reachable(history: History, who: Who) -> float:
    return 100 * int(_cells(history, who)[-1]) / int(history.reachable[-1])


def _percent_all(history: History, who: Who) -> float:
    cells = history.free_team if who == "team" else history.free_base
    return 100 * int(cells[-1]) / int(history.free[-1])


def _time(history: History, who: Who, share: int) -> int | None:
    return time_to(_cells(history, who), share / 100 * history.reachable)


def _area(history: History, who: Who) -> float:
    return float((_cells(history, who) / history.reachable).mean())


def _declare(who: Who) -> None:
    """All that is told of team and base alike."""
    knows = _KNOWING[who]
    for kind, function, title, which in (
        ("reachable", _percent_reachable, "reachable cells known", "the reachable free cells"),
        ("all", _percent_all, "free cells known", "all free cells"),
    ):
        text = f"How many of {which} {knows} at the end."
        title = f"{who.capitalize()}: {title}"
        declare(f"{who}_percent_{kind}", title, "%", text, MRESIM, "more")(
            partial(function, who=who)
        )
    for share in SHARES:
        text = f"First step at which {knows} {share} % of the reachable free cells."
        declare(f"{who}_t{share}", f"{who.capitalize()}: {share} %", "steps", text, OURS, "less")(
            partial(_time, who=who, share=share)
        )
    text = f"Mean over the steps of the run of the part of the reachable free cells that {knows}."
    declare(f"{who}_area", f"{who.capitalize()}: area under the curve", "1", text, OURS, "more")(
        partial(_area, who=who)
    )


for _who in ("team", "base"):
    _declare(_who)


@declare(
    "base_share", "Base's share of the team's cells", "%",
    "Mean over steps of what the base knows of what the team has known.", MRESIM, "more",
)  # fmt: skip
def _base_share(history: History) -> float:
    return float(np.mean(100 * history.free_base / np.maximum(history.free_team, 1)))


@declare(
    "robot_share", "Robots' share of the team's cells", "%",
    "Mean over steps and robots of what a robot knows of what the team has known.", MRESIM, "more",
)  # fmt: skip
def _robot_share(history: History) -> float:
    team = np.maximum(history.free_team, 1)[:, None]
    return float(np.mean(100 * history.area[:, ROBOTS] / team))


@declare(
    "mean_wait", "Wait of a cell for the base", "steps",
    "How long a cell that the team found waited on average until the base knew it, or the run "
    "ended: the sum over steps of cells that the base lacks, by the cells of the team.",
    LITTLE, "less",
)  # fmt: skip
def _mean_wait(history: History) -> float:
    lacking = history.free_team - history.free_base
    return float(lacking.sum() / max(int(history.free_team[-1]), 1))


@declare(
    "base_map_iou", "Overlap of the base's map with the world", "1",
    "Cells that the base rightly takes for free, by cells that are free or that it takes for free.",
    YAN, "more",
)  # fmt: skip
def _base_map_iou(history: History) -> float:
    right, believed = int(history.free_base[-1]), int(history.believed[-1, 0])
    return right / (int(history.free[-1]) + believed - right)
