"""A whole run in a folder: a robot crosses three rooms, two victims are marked."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from scripted import WORLD, corridor, sick

from usarsim_mission.live import LiveRun
from usarsim_mission.model import Mission, World
from usarsim_mission.referee import Referee
from usarsim_mission.runlog import RunWriter
from usarsim_mission.scoring import find_rules

MISSION = Mission("scripted", 1, 60.0)
ROOMS = World(
    "three rooms",
    victims=WORLD.victims,
    zones=WORLD.zones,
    starts=(sick("R1"),),
    floor=corridor(30.0),
)


class Clock:
    """A clock that is set."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def begin(folder: Path, clock: Clock | None = None) -> LiveRun:
    rules = find_rules("usar-mj-1")[1]
    text = 'name = "scripted"\n'
    log = RunWriter(folder, text, MISSION, rules, ROOMS, clock or Clock())
    return LiveRun(log, Referee(MISSION, rules, ROOMS))


def play(run: LiveRun) -> None:
    """A robot crosses the three rooms; Anna is marked from a dirty visit, Ben from a clean one."""
    run.tell("session", 0.0, robots=[{"name": "R1", "class": "P3AT"}], operators=1)
    run.tell("trial_start", 0.0, limit=60.0)
    for step in range(1, 251):
        time = round(0.1 * step, 6)
        if step == 20:
            run.tell("command", time, robot="R1", source="operator", left=0.5, right=0.5)
        if step == 40:
            run.tell("mark_set", time, mark=1, robot="R1", place=(5.0, 5.3, 0.0), by="A", page=1)
        if step == 90:
            run.tell("command", time, robot="R1", source="autonomy", left=0.5, right=0.5)
        if step == 160:
            run.tell("mark_set", time, mark=2, robot="R1", place=(15.0, 5.3, 0.0), by="A", page=1)
        if step == 170:
            run.tell("mark_set", time, mark=3, robot="R1", place=(15.0, 9.0, 0.0), by="A", page=1)
        row: dict[str, Any] = {
            "name": "R1",
            "pos": (1.0 + 0.1 * step, 1.0, 0.1 if step != 60 else math.nan),
            "quat": (1.0, 0.0, 0.0, 0.0),
            "linear": (1.0, 0.0, 0.0),
            "angular": (0.0, 0.0, 0.0),
            "battery": 0.9,
            "contacts": [{"with": "world", "name": "door", "time": time}] if step == 99 else [],
        }
        run.tell("truth", time, robots=[row], victims=[], views=[])
    run.tell("map", 25.0, **corridor(30.0).packed())
    run.tell("trial_end", 25.0, why="operator", text="")
