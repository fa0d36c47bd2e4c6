"""Runs on MRESim's own maps, against what MRESim did there (exploration reference 17).

The maps are not ours to ship: set USARSIM_MAPS to a folder that holds a checkout of MRESim. Its
finish rule was "95 % of all free cells at the base"; its program does not repeat, so bands of
several runs are what can be compared.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from usarsim_exploration.history import History
from usarsim_exploration.mresim.settings import Settings
from usarsim_exploration.mresim.team import read_team
from usarsim_exploration.running import run
from usarsim_exploration.scenario import read

MAPS = Path(os.environ.get("USARSIM_MAPS", "/nowhere"))
PLACES = {
    "A": ("RAS2014/1.png", "RAS2014/M1_L1_R4"),
    "B": ("RAS2014/4.png", "RAS2014/M4_L1_R4"),
    "C": ("SSRR2014/1.png", "SSRR2014/M1_L1_R2"),
}
FRONTIER = Settings(strategy="FrontierExploration", keep_assigning=True)
RATIO = Settings(strategy="FrontierExploration", policy="UtilReturn", keep_assigning=True)
MULTI = Settings(multi_point=True, improved_rendezvous=True, timestamps=True)
NAMES = {FRONTIER: "frontier", RATIO: "ratio", MULTI: "multi-point"}
BANDS = [
    ("A", FRONTIER, (111, 191), (241, 321), (297, 463)),
    ("A", RATIO, (131, 181), (371, 411), (418, 464)),
    ("A", MULTI, (161, 261), (431, 571), (486, 587)),
    ("B", FRONTIER, (171, 191), (311, 321), (487, 530)),
    ("B", RATIO, (271, 291), (531, 701), (556, 779)),
    ("B", MULTI, (251, 301), (483, 561), (483, 652)),
    ("C", FRONTIER, (181, 231), (381, 431), (587, 605)),
    ("C", RATIO, (411, 451), (931, 1231), (1159, 1374)),
    ("C", MULTI, (371, 381), (751, 821), (805, 1029)),
]
"""Map, settings, and (smallest, largest) steps of exploration 17.3: 50 % team, 90 % team, 90 %
base."""
CURVE = {50: 11, 100: 25, 150: 50, 200: 67, 250: 82, 300: 94, 400: 98}
"""Per cent of all free cells that the team knows, map A, frontier, mean of five runs
(exploration 17.4)."""
WIDER = 0.1
SEEDS = 20


def find(name: str) -> Path:
    """A file below USARSIM_MAPS, by how its path ends; skips where there is none."""
    for one in sorted(MAPS.rglob(Path(name).name)):
        if one.as_posix().endswith(f"/{name}"):
            return one
    pytest.skip(f"USARSIM_MAPS has no {name} of MRESim")


@cache
def histories(place: str, settings: Settings) -> tuple[History, ...]:
    """One run for each seed; robots in pairs where roles are played."""
    name, team = PLACES[place]
    team += "_RB" if settings.strategy == "RoleBasedExploration" else ""
    content = {
        "environment": {"name": str(find(name)), "compat": True},
        **settings.content,
        **read_team(find(team)),
    }
    return tuple(run(read({"seed": seed} | content)).history for seed in range(1, SEEDS + 1))


def reached(history: History, cells: np.ndarray, share: float) -> float:
    """First step at which so much of all free cells was known."""
    there = np.flatnonzero(cells >= share * history.free)
    return float(there[0]) if len(there) else np.inf


@pytest.mark.parametrize("band", BANDS, ids=lambda one: f"{one[0]}-{NAMES[one[1]]}")
def test_steps_are_within_the_band(
    band: tuple[str, Settings, *tuple[tuple[int, int], ...]],
) -> None:
    """E-57: the mean over seeds within what MRESim's runs spanned, a tenth wider."""
    place, settings, *spans = band
    runs = histories(place, settings)
    found = [
        np.mean([reached(one, one.free_team, 0.5) for one in runs]),
        np.mean([reached(one, one.free_team, 0.9) for one in runs]),
        np.mean([reached(one, one.free_base, 0.9) for one in runs]),
    ]
    for step, (low, high) in zip(found, spans, strict=True):
        assert (1 - WIDER) * low <= step <= (1 + WIDER) * high, found


def test_coverage_follows_the_curve() -> None:
    """EXP-23: map A, frontier: the team's mean within five points at each 50 steps."""
    runs = histories("A", FRONTIER)
    for step, percent in CURVE.items():
        ours = [100 * one.free_team[min(step, one.steps)] / one.free[0] for one in runs]
        assert abs(np.mean(ours) - percent) <= 5, (step, np.mean(ours))


def test_order_of_strategies() -> None:
    """EXP-13: cautious strategies map later, and their bases know more of what is known."""
    runs = [histories("A", one) for one in (FRONTIER, RATIO, MULTI)]
    late = [np.mean([reached(one, one.free_team, 0.9) for one in group]) for group in runs]
    share = [np.mean([one.free_base.sum() / one.free_team.sum() for one in g]) for g in runs]
    assert late == sorted(late)
    assert share[0] < min(share[1:])
