"""Results of a batch as `usarsim explore bench` writes them, with curves out of a formula."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

STRATEGIES = {"frontier": (60, 70), "ratio": (75, 25), "role-based": (95, 10), "$_<&": (500, 5)}
"""Steps to 63 % of the team, and how long news of it take to the base."""
LIMIT = 500


def run(
    strategy: str, seed: int, environment: str = "office", robots: int = 4, radio: str = "circle"
) -> dict[str, Any]:
    """One run of a batch."""
    scale, late = STRATEGIES[strategy]
    random = np.random.default_rng([seed, len(strategy), len(environment), robots])
    scale *= random.normal(1, 0.12) * (1.5 if environment == "maze" else 1)
    steps = np.arange(LIMIT + 1)
    team = 1 - np.exp(-steps / scale)
    base = np.interp(steps // late * late - 2, steps, team, left=0.01)
    there = np.flatnonzero(base >= 0.95)
    last = int(there[0]) if len(there) else LIMIT
    found = {"team": team[: last + 1], "base": base[: last + 1]}
    measures: dict[str, Any] = {"steps": last}
    for who, curve in found.items():
        for share in (50, 90, 95, 99):
            reached = np.flatnonzero(curve >= share / 100)
            measures[f"{who}_t{share}"] = int(reached[0]) if len(reached) else None
        measures[f"{who}_area"] = float(curve.mean())
    measures["base_share"] = float(100 * (base / np.maximum(team, 0.01))[: last + 1].mean())
    measures |= {"distance": 10.0 * last * robots, "mean_wait": float(late), "lost": []}
    measures |= {"disconnected": late / 2 + seed, "overlap": None, "bytes_sent": 1000 * last}
    steps = np.arange(0, last + 5, 5)
    told = np.minimum(steps, last)
    return {
        "environment": environment, "robots": robots, "strategy": strategy, "radio": radio,
        "seed": seed, "ended": {"reason": "base knows" if len(there) else "steps", "step": last},
        "measures": measures,
        "curves": {"steps": steps.tolist()} | {
            who: curve[told].round(6).tolist() for who, curve in found.items()
        },
        "digest": "",
    }  # fmt: skip


def failed(strategy: str, seed: int) -> dict[str, Any]:
    """One that has no results."""
    place = {"environment": "office", "robots": 4, "strategy": strategy, "radio": "circle"}
    return place | {"seed": seed, "error": "ValueError: <b>broken</b>\nin line 3"}


def batch(*runs: dict[str, Any]) -> dict[str, Any]:
    """All of a file."""
    return {
        "format": "usarsim-explore-batch/1",
        "version": "0.1.0",
        "batch": {"end": {"steps": LIMIT}},
        "runs": list(runs),
    }


def example() -> dict[str, Any]:
    """Four strategies in three settings, ten seeds, one run that failed, one of lost robots."""
    places = ("office", 4), ("office", 2), ("maze", 4)
    runs = [
        run(strategy, seed, environment, robots)
        for environment, robots in places
        for strategy in STRATEGIES
        for seed in range(10)
    ]
    runs[3] = failed("frontier", 3)
    lost = runs[4]
    lost["ended"] = {"reason": "all lost", "step": 40}
    lost["measures"] |= {name: None for name in lost["measures"] if name[-3:-2] == "t"}
    return batch(*runs)


def write(folder: Path, content: object) -> Path:
    """A folder with such a file."""
    folder.mkdir(exist_ok=True)
    (folder / "result.json").write_text(json.dumps(content))
    return folder
