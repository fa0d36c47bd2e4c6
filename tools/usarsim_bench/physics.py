"""The physics thread of a running server against bare MuJoCo; measured inside it by the server's
own instrument (`usarsim_bench.instruments.physics`), which says what is compared with what."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import mean, median

from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.robot_files import SCOUT, SCOUT_SENSORS, scouts
from usarsim_bench.server import Server
from usarsim_bench.swarm import TOGETHER
from usarsim_bench.team import SETTLE, gather

ROBOTS = (16, 64)
SECONDS = 20.0

RATIO_AIM = Aim("<=", 1.10)

_INSTRUMENT = "usarsim_bench.instruments.physics"

Turn = Mapping[str, float]


def within(turns: Sequence[Turn], robots: int, start: float, stop: float) -> list[Turn]:
    """The turns of a span of wall time in which a whole team was there.

    Raises:
        BenchError: if there are none.
    """
    found = [one for one in turns if start <= one["moment"] <= stop and one["robots"] == robots]
    if not found:
        raise BenchError(f"the physics thread was not compared in {stop - start:.1f} s")
    return found


def measure_physics(plan: Plan) -> Section:
    """Teams at real time; `plan.seconds` of wall time are watched for each size."""
    seconds = plan.seconds or SECONDS
    figures: list[Figure] = []
    for robots in plan.sizes(ROBOTS, max(ROBOTS)):
        plan.say(f"physics: {robots} robots for {seconds:g} s")
        figures += physics_figures(robots, _turns(plan, robots, seconds))
    return Section(
        "physics",
        "The physics thread against bare MuJoCo",
        f"{DEFAULT_CLASS} with {SCOUT_SENSORS} each in {plan.world} at real time, random DRIVE "
        f"commands at 2 Hz each, clients in another process, {seconds:g} s for each size. Every "
        "0.7 s the thread pauses and steps the scene that it has reached with mj_step and nothing "
        "else, the wheels driven by MuJoCo's own velocity actuators. MuJoCo's part: inside "
        "mj_step1 and mj_step2 in the thread's own run, so in the very same states. Processor "
        "time per step; ratios are medians of these turns.",
        tuple(figures),
    )


def _turns(plan: Plan, robots: int, seconds: float) -> list[Turn]:
    with tempfile.TemporaryDirectory() as folder, scouts() as classes:
        file = Path(folder, "turns.json")
        command = (_INSTRUMENT, str(file), "serve", *classes)
        with Server(plan.world, robots, command) as server, Crowd(server.port, plan.seed) as crowd:
            gather(crowd, robots, (SCOUT,), TOGETHER)
            crowd.run(SETTLE)
            start, stop = crowd.run(seconds)
        return within(json.loads(file.read_text()), robots, start, stop)


def physics_figures(robots: int, turns: Sequence[Turn]) -> list[Figure]:
    """The figures of one size, from at least one turn."""
    name = f"{robots} robots"
    ratios = [turn["thread"] / turn["bare"] for turn in turns]
    engine = [turn["engine"] / turn["bare"] for turn in turns]
    return [
        Figure(f"{name}: physics thread / bare mj_step", median(ratios), "", 2, RATIO_AIM),
        Figure(f"{name}: its step loop alone / bare mj_step", median(engine), "", 2),
        *_to_mujoco(name, turns),
        Figure(f"{name}: physics thread", 1e6 * median(t["thread"] for t in turns), "us/step", 0),
        Figure(f"{name}: bare mj_step", 1e6 * median(t["bare"] for t in turns), "us/step", 0),
        Figure(f"{name}: contacts", mean(turn["contacts"] for turn in turns), "", 0),
        Figure(f"{name}: turns", len(turns), "", 0),
    ]


def _to_mujoco(name: str, turns: Sequence[Turn]) -> list[Figure]:
    ratios = [turn["thread"] / turn["mujoco"] for turn in turns if turn["mujoco"] > 0.0]
    if not ratios:
        return []
    return [Figure(f"{name}: physics thread / MuJoCo's part of it", median(ratios), "", 2)]
