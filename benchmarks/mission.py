"""What missions cost: a referee, a whole trial, reports.

The referee has 16 robots that all move, look and bump, 20 victims and twelve zones. No server: rows
are made beforehand, as the truth channel would tell them, and told as fast as they are taken. Each
simulated second has ten rows and a command to each robot.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.mission_run import MISSION, study_figures, trial_figures
from benchmarks.plan import Plan
from usarsim_bench.figures import Aim, Figure, Section
from usarsim_mission.grid import FREE, WALL, Grid
from usarsim_mission.live import LiveRun
from usarsim_mission.map_quality import judge
from usarsim_mission.model import Colour, Fan, Mission, Start, Victim, World, Zone
from usarsim_mission.records import Record
from usarsim_mission.referee import Referee
from usarsim_mission.rescoring import rescore
from usarsim_mission.runlog import RunWriter
from usarsim_mission.scoring import find_rules

ROBOTS, VICTIMS = 16, 20
REFEREE_AIM = Aim("<", 0.05)
LOGS_AIM = Aim("<", 100.0)
_SECONDS = 60.0
_CELL = 0.1
_LENGTH, _WIDTH = 60.0, 40.0
_COLOURS: tuple[Colour, ...] = ("yellow", "orange", "red")


def measure_mission(plan: Plan) -> Section:
    """All of it; `plan.seconds` are simulated."""
    seconds = plan.seconds or _SECONDS
    return Section(
        "mission",
        "Missions and studies",
        f"The referee has {plan.robots or ROBOTS} robots, {VICTIMS} victims, twelve zones and a "
        f"floor of {_LENGTH:g} x {_WIDTH:g} m at {_CELL:g} m; the trial is {MISSION} with the "
        f"robots that explore by themselves; {seconds:g} s of simulated time each. The study is "
        "made up.",
        (*referee_figures(plan), *trial_figures(plan), *study_figures(plan)),
    )


def referee_figures(plan: Plan) -> tuple[Figure, ...]:
    """Processor time of a referee and its logs; `plan.seconds` are simulated."""
    count = plan.robots or ROBOTS
    seconds = plan.seconds or _SECONDS
    world, (path, rules) = hall(count), find_rules("usar-mj-1")
    plan.say(f"{count} robots for {seconds:g} s of simulated time, by {path.stem}")
    records = list(told(world, seconds))
    referee = Referee(Mission(), rules, world)
    begun = time.process_time()
    for record in records:
        referee.feed(record)
    judged = (time.process_time() - begun) / seconds
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "run"
        run = LiveRun(
            RunWriter(target, "", Mission(), rules, world), Referee(Mission(), rules, world)
        )
        begun = time.process_time()
        for record in records:
            run.tell(**record)
        logged = (time.process_time() - begun) / seconds
        size = sum(one.stat().st_size for one in target.glob("*.jsonl"))
        run.close()
        begun = time.process_time()
        found = rescore(target)
        again = (time.process_time() - begun) / seconds
    assert world.floor is not None
    begun = time.process_time()
    judge(world.floor, world.floor)
    return (
        Figure("Referee", judged, "cores at the pace of the clock", 4, REFEREE_AIM),
        Figure("Referee with its logs", logged, "cores", 4, REFEREE_AIM),
        Figure("Scored again, to real time", 1.0 / again, "times as fast", 0),
        Figure("Differences then", len(found.differences), "", 0, Aim("<=", 0)),
        Figure("A map judged", time.process_time() - begun, "s", 2),
        Figure("Logs of 20 minutes", size / seconds * 1200.0 / 1e6, "MB", 0, LOGS_AIM),
    )


def hall(robots: int) -> World:
    """A hall with partitions and twelve zones in turns of three colours."""
    cells = np.full((round(_WIDTH / _CELL), round(_LENGTH / _CELL)), FREE, np.uint8)
    cells[[0, -1]] = WALL
    cells[:, [0, -1]] = WALL
    for column in range(50, cells.shape[1], 50):
        cells[:180, column] = cells[220:, column] = WALL
    wide = _LENGTH / 12
    zones = [
        Zone(
            f"zone {number}",
            colour,
            (
                (wide * number, 0.0),
                (wide * number + wide, 0.0),
                (wide * number + wide, _WIDTH),
                (wide * number, _WIDTH),
            ),
        )
        for number, colour in enumerate(_COLOURS * 4)
    ]
    victims = [Victim(f"V{one}", (3.0 * one, 5.0 + one, 0.2)) for one in range(VICTIMS)]
    starts = [Start(f"R{one}", "P3AT", sensors=(Fan(20.0, math.pi),)) for one in range(robots)]
    floor = Grid(0.0, 0.0, _CELL, cells)
    return World(
        "hall",
        (0.0, 0.0, -1.0),
        (_LENGTH, _WIDTH, 5.0),
        tuple(victims),
        tuple(zones),
        tuple(starts),
        floor,
    )


def told(world: World, seconds: float) -> Iterator[Record]:
    """All records of a run in which everybody drives in circles of different sizes."""
    yield {"t_sim": 0.0, "kind": "session", "robots": [], "operators": 1}
    yield {"t_sim": 0.0, "kind": "trial_start", "limit": seconds + 1.0}
    victims = [{"name": one.name, "pos": list(one.pos)} for one in world.victims]
    for step in range(1, round(seconds * 10) + 1):
        at = round(0.1 * step, 6)
        names = [start.name for start in world.starts]
        robots = [_row(name, number, at) for number, name in enumerate(names)]
        views = [
            {
                "robot": name,
                "victim": f"V{victim}",
                "angle": 0.1 * ((number + victim + step // 40) % 9),
                "distance": 3.0,
                "clear": (number + victim) % 2 == 0,
            }
            for number, name in enumerate(names)
            for victim in range(4)
        ]
        yield {"t_sim": at, "kind": "truth", "robots": robots, "victims": victims, "views": views}
        if step % 10 == 0:
            for name in names:
                text = "DRIVE {Left 0.3} {Right 0.3}"
                yield {
                    "t_sim": at,
                    "kind": "command",
                    "robot": name,
                    "source": "autonomy",
                    "text": text,
                }
        if step % 100 == 0:
            yield {
                "t_sim": at,
                "kind": "mark_set",
                "mark": step,
                "robot": "R0",
                "place": [step / 50, 9.0],
            }


def _row(name: str, number: int, at: float) -> dict[str, Any]:
    phase = at / 50.0 + number
    bumps = [{"with": "world", "name": "wall", "time": at}] if number % 4 == 0 else []
    return {
        "name": name,
        "pos": [30.0 + 25.0 * math.sin(phase), 20.0 + 15.0 * math.cos(0.7 * phase), 0.2],
        "quat": [math.cos(at / 20.0), 0.0, 0.0, math.sin(at / 20.0)],
        "linear": [0.5, 0.2, 0.0],
        "angular": [0.0, 0.0, 0.1],
        "battery": 0.9,
        "contacts": bumps,
    }
