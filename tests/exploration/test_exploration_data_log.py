"""E-73: the data log against a recount of what a run's robots know, have heard and did."""

import csv
import io
import itertools
from pathlib import Path
from typing import Any

import numpy as np
from small_world import ROOMS, small

from usarsim_exploration.history import RETURNING
from usarsim_exploration.known_map import FREE
from usarsim_exploration.log_files import (
    ROBOT_COLUMNS,
    SHARE_COLUMNS,
    TEAM_COLUMNS,
    steps_csv,
)
from usarsim_exploration.running import Run


def look(one: Run) -> list[dict[str, Any]]:
    """What is so of each body after a step, out of its map and its own counters."""
    truth = one.cycle.environment.walls == 0
    return [
        {
            "grid": (body.view.known.bits & FREE != 0) & truth,
            "believed": int(np.count_nonzero(body.view.known.bits & FREE)),
            "own": body.view.known.undelivered,
            "heard": body.base_step,
            "found": body.found if body.works else 0,
            "first": body.first if body.works else 0,
            "state": body.state,
            "role": body.view.role,
            "distance": body.distance,
            "works": body.works,
        }
        for body in one.cycle.bodies
    ]


def delays(heard: list[int]) -> list[int]:
    """How many steps each step of the base that was heard of took to be."""
    return [
        next(row for row, newest in enumerate(heard) if newest >= step) - step
        for step in range(heard[-1] + 1)
    ]


def recount(past: list[list[dict[str, Any]]], free: int) -> dict[str, float]:
    """A row of the data log, but for the traffic, by loops over all steps so far."""
    now, numbers = past[-1], range(1, len(past[0]))
    team = int(np.count_nonzero(np.logical_or.reduce([one["grid"] for row in past for one in row])))
    base = int(np.count_nonzero(now[0]["grid"]))
    found: dict[str, float] = {"step": len(past) - 1, "free_cells": free}
    found |= {"team_area": team, "base_area": base}
    found |= {"team_percent": 100 * team / free, "base_percent": 100 * base / free}
    found["base_share_percent"] = 100 * base / team
    swaps = 0
    for before, after in itertools.pairwise(past):
        swaps += sum(a["role"] != b["role"] for a, b in zip(before, after, strict=True))
    found["role_swaps"] = swaps // 2
    found["robot_steps"] = sum(row[n]["works"] for row in past for n in numbers)
    found["mean_distance"] = sum(now[n]["distance"] for n in numbers) / len(numbers)
    robots = []
    for number in numbers:
        mine = [row[number] for row in past]
        took = delays([one["heard"] for one in mine])
        robots.append(
            {
                "area": int(np.count_nonzero(mine[-1]["grid"])),
                "own": mine[-1]["own"],
                "believed": mine[-1]["believed"],
                "max_latency": max(took),
                "mean_latency": sum(took) / len(took),
                "sensing": sum(one["first"] > 0 for one in mine),
                "double_sensing": sum(one["found"] > one["first"] for one in mine),
                "returning": sum(
                    one["works"] and one["state"].startswith(RETURNING) for one in mine
                ),
                "not_sensing": sum(one["works"] and not one["found"] for one in mine),
            }
        )
    for name in ("sensing", "double_sensing", "returning", "not_sensing"):
        found[name] = sum(one[name] for one in robots)
    found["max_latency"] = max(one["max_latency"] for one in robots)
    found["mean_latency"] = sum(one["mean_latency"] for one in robots) / len(robots)
    share = sum(one["area"] for one in robots) / len(robots)
    found["mean_area_share_percent"] = 100 * share / team
    for number, one in zip(numbers, robots, strict=True):
        found |= {f"R{number}_{name}": value for name, value in one.items()}
    return found


def test_twenty_random_steps(tmp_path: Path) -> None:
    """E-73: columns have names, and values equal an independent recount at 20 random steps."""
    loss = {"step": 25, "kind": "loss", "robot": "R2"}
    options = "strategy.name=role-based", "team.radio=3.0", "end.home=false", "end.steps=60"
    one = Run(small(tmp_path, *options, "end.base=off", tables={"event": [loss]}))
    past, traffic = [look(one)], [(one.cycle.cells_sent, one.cycle.bytes_sent)]
    while one.step():
        past.append(look(one))
        traffic.append((one.cycle.cells_sent, one.cycle.bytes_sent))
    past.append(look(one))
    traffic.append((one.cycle.cells_sent, one.cycle.bytes_sent))
    history = one.result().history
    assert history.steps == 60 == len(past) - 1
    log = list(csv.DictReader(io.StringIO(steps_csv(history))))
    heads = [*TEAM_COLUMNS, *(f"R{n}_{name}" for n in (1, 2) for name in ROBOT_COLUMNS)]
    heads += SHARE_COLUMNS
    assert list(log[0]) == heads
    for step in np.random.default_rng(73).choice(61, 20, replace=False).tolist():
        told = {name: float(value) for name, value in log[step].items()}
        hand = recount(past[: step + 1], int(history.free[step]))
        hand |= {"cells_sent": traffic[step][0], "bytes_sent": traffic[step][1]}
        hand |= {"reachable_cells": ROOMS.count(".")}  # all are
        hand |= {f"{who}_reachable": hand[f"{who}_area"] for who in ("team", "base")}
        for number in (1, 2):
            name = f"R{number}_believed_at_base"
            hand[name] = hand[f"R{number}_believed"] - hand[f"R{number}_own"]
        assert set(hand) == set(heads)
        for name, value in hand.items():
            assert abs(told[name] - value) < 1e-9, (step, name)
    assert float(log[-1]["max_latency"]) > 5
    assert float(log[-1]["returning"]) > 0
    assert float(log[-1]["double_sensing"]) > 0
