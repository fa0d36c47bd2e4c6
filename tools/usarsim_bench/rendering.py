"""Camera pictures against a bare MuJoCo renderer, and how old they are when they are handed out;
measured inside one process by the server's own instrument (`usarsim_bench.instruments.rendering`),
which says what is compared with what."""

from __future__ import annotations

import json
import subprocess
import sys

from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section

ROBOTS = 4
CAMERAS = (1, 4, 16)
SECONDS = 10.0

RATIO_AIM = Aim(">=", 0.85)
FACTOR_AIM = Aim(">=", 0.999)

_INSTRUMENT = "usarsim_bench.instruments.rendering"
_SHOWN_ERRORS = 2000
_COSTS = (
    ("bare mujoco.Renderer", "bare"),
    ("tile", "tile"),
    ("tile in haze", "smoky"),
    ("tile with a headlight on", "lit"),
    ("tile by rays", "rays"),
    ("JPEG of a tile", "jpeg"),
    ("depth image by rendering", "depth_rendered"),
    ("depth image by rays", "depth_rays"),
)


def measure_rendering(plan: Plan) -> Section:
    """Costs of a picture, then cameras watched for `plan.seconds` of wall time each."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"rendering: {robots} robots in {plan.world}")
    costs, *watched = _measured(plan.world, robots, seconds)
    figures = [
        Figure("bare mujoco.Renderer / tile", float(costs["to_bare"]), "", 2, RATIO_AIM),
        *(Figure(name, float(costs[key]), "ms", 1) for name, key in _COSTS),
    ]
    for one in watched:
        name = f"{one['cameras']} watched"
        figures += [
            Figure(f"{name}: pictures of all", float(one["pictures"]), "1/s", 1),
            Figure(f"{name}: age when handed out, median", 1e3 * float(one["age"]), "ms", 0),
            Figure(f"{name}: age, 99th percentile", 1e3 * float(one["oldest"]), "ms", 0),
            Figure(f"{name}: real-time factor", float(one["factor"]), "", 4, FACTOR_AIM),
        ]
    return Section(
        "rendering",
        "Camera pictures against a bare renderer",
        f"Pictures of 320 x 240 by {costs['renderer']}, {robots} P3AT; costs in ms of processor "
        f"time, in turns on one thread; then {seconds:g} s of wall time for each number of "
        "watched cameras, 15 pictures of each asked for per simulated second, the team driving.",
        tuple(figures),
    )


def _measured(world: str, robots: int, seconds: float) -> list[dict[str, float | int | str]]:
    command = [sys.executable, "-m", _INSTRUMENT, "--world", world, "--robots", str(robots)]
    command += ["--seconds", str(seconds), "--cameras", *map(str, CAMERAS)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError(f"the rendering instrument failed: {done.stderr[-_SHOWN_ERRORS:].strip()}")
    return [json.loads(line) for line in done.stdout.splitlines()]
