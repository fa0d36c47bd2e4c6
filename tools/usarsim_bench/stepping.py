"""The server's step loop against MuJoCo alone; measured inside one process by the server's own
instrument (`usarsim_bench.instruments.stepping`), which says what is compared with what."""

from __future__ import annotations

import json
import subprocess
import sys

from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section

ROBOTS = (1, 4, 16)
SECONDS = 10.0
BARE_WORLD = "empty"
"""Measured besides the world asked for: a floor and nothing else."""

RATIO_AIM = Aim(">=", 0.8)

_INSTRUMENT = "usarsim_bench.instruments.stepping"
_SHOWN_ERRORS = 2000


def measure_stepping(plan: Plan) -> Section:
    """Rates of the step loop; `plan.seconds` of simulated time for each loop on each scene."""
    sizes = plan.sizes(ROBOTS, max(ROBOTS))
    seconds = plan.seconds or SECONDS
    figures: list[Figure] = []
    for world in dict.fromkeys((BARE_WORLD, plan.world)):
        plan.say(f"stepping: {', '.join(map(str, sizes))} robots in {world}")
        for scene in _scenes(world, sizes, seconds, plan.seed):
            figures += _figures(scene)
    return Section(
        "stepping",
        "The step loop against MuJoCo alone",
        f"P3AT driving around, {seconds:g} simulated s for each loop on each scene, the loops in "
        "turns on one thread, rates in steps per s of processor time. Engine: the server's loop, "
        "with wheel servos and contact compensation. Bare: mj_step and nothing else, on the same "
        "model with MuJoCo's own wheel servos. MuJoCo's part: mj_step1 and mj_step2 inside the "
        "engine's own run.",
        tuple(figures),
    )


def _scenes(
    world: str, sizes: tuple[int, ...], seconds: float, seed: int
) -> list[dict[str, float | int | str]]:
    command = [sys.executable, "-m", _INSTRUMENT, "--world", world, "--seconds", str(seconds)]
    command += ["--seed", str(seed), "--robots", *map(str, sizes)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError(f"the stepping instrument failed: {done.stderr[-_SHOWN_ERRORS:].strip()}")
    return [json.loads(line) for line in done.stdout.splitlines()]


def _figures(scene: dict[str, float | int | str]) -> list[Figure]:
    robots = scene["robots"]
    place = f"{scene['world']}, {robots} robot{'s' if robots != 1 else ''}"

    def figure(name: str, key: str, unit: str, digits: int, aim: Aim | None = None) -> Figure:
        return Figure(f"{place}: {name}", float(scene[key]), unit, digits, aim)

    return [
        figure("engine / bare mj_step", "to_bare", "", 2, RATIO_AIM),
        figure("engine / MuJoCo's part of it", "to_mujoco", "", 2),
        figure("engine", "engine", "steps/s", 0),
        figure("bare mj_step", "bare", "steps/s", 0),
        figure("MuJoCo's part", "mujoco", "steps/s", 0),
        figure("contacts, engine", "contacts", "", 1),
        figure("contacts, bare mj_step", "bare_contacts", "", 1),
    ]
