"""Camera pictures that clients get, against a loop that only renders and encodes.

The loop (`usarsim_bench.instruments.frames`) runs before and after the server, on the same cameras
of the same team, so that both have the machine for themselves.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from usarsim_bench.camera_client import Viewer, ViewerTrial, summed_up
from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.robot_files import SURVEYOR, SURVEYOR_CAMERAS, scouts
from usarsim_bench.server import SERVE, Server
from usarsim_bench.team import TeamTrial, gather, load_figures, try_team
from usarsim_bench.watched import TILE_SIZE, grid, tiles_of

ROBOTS = 4
SECONDS = 20.0
MOST_TILES = 64
DEMAND = 1.5
"""Pictures asked for, over those that the loop makes."""
RATES = (5.0, 60.0)
"""Pictures per second of a camera that a server can be asked for here."""

RATIO_AIM = Aim(">=", 0.85)

_INSTRUMENT = "usarsim_bench.instruments.frames"
_SHOWN_ERRORS = 2000


@dataclass(frozen=True, slots=True)
class Loop:
    """What the loop without a server made.

    Attributes:
        renderer: platform of OpenGL, or "rays" if there is none and nothing was drawn.
        pictures: per s of wall time.
        cores: processors kept busy meanwhile.
    """

    renderer: str
    pictures: float
    cores: float


def rate_for(pictures: float, cameras: int) -> float:
    """Pictures per second to ask of each camera so that all together are more than a loop makes."""
    if not math.isfinite(pictures):
        return RATES[0]
    return min(RATES[1], max(RATES[0], DEMAND * pictures / cameras))


def measure_delivery(plan: Plan) -> Section:
    """Loop, server, loop; the server and both loops together for `plan.seconds` of wall time."""
    robots = min(plan.robots or ROBOTS, MOST_TILES // SURVEYOR_CAMERAS)
    seconds = plan.seconds or SECONDS
    cameras = robots * SURVEYOR_CAMERAS
    with scouts() as classes:
        folder = classes[1]
        plan.say(f"delivery: {cameras} cameras without a server for {seconds / 2:g} s")
        loops = [_loop(plan.world, folder, robots, seconds / 2)]
        rate = rate_for(loops[0].pictures, cameras)
        plan.say(f"delivery: {cameras} cameras watched for {seconds:g} s")
        columns, rows = grid(cameras)
        command = (
            *(*SERVE, *classes, "--tiles", f"{columns}x{rows}"),
            *("--tile-size", "x".join(map(str, TILE_SIZE)), "--camera-rate", f"{rate:.2f}"),
        )
        with (
            Server(plan.world, robots, command) as server,
            Crowd(server.port, plan.seed) as crowd,
        ):
            trial, seen = _watched(server, crowd, robots, rate, seconds)
        plan.say(f"delivery: {cameras} cameras without a server for {seconds / 2:g} s")
        loops.append(_loop(plan.world, folder, robots, seconds / 2))
    return Section(
        "delivery",
        "Camera pictures that arrive",
        f"{cameras} cameras of {TILE_SIZE[0]} x {TILE_SIZE[1]} on {robots} {DEFAULT_CLASS} in "
        f"{plan.world}, drawn by {loops[0].renderer}. Server: all of them watched by a client "
        f"each, {rate:.1f} pictures a second asked for, real time, random DRIVE commands, "
        f"{seconds:g} s; counted are pictures that differ from the one before. Loop: "
        "mujoco.Renderer and the same JPEG, nothing else, on the same cameras, half before and "
        "half after.",
        tuple(delivery_figures(trial, seen, loops)),
    )


def _watched(
    server: Server, crowd: Crowd, robots: int, rate: float, seconds: float
) -> tuple[TeamTrial, list[ViewerTrial]]:
    port = server.ports.get("images")
    if port is None:
        raise BenchError("the server has no images")
    gather(crowd, robots, (SURVEYOR,))
    with ExitStack() as stack:
        viewers = [
            stack.enter_context(Viewer(port, tile, rate))
            for tile in tiles_of(robots * SURVEYOR_CAMERAS)
        ]
        trial = try_team(server, crowd, 0, seconds)
    return trial, [summed_up(one.pictures, trial.start, trial.stop) for one in viewers]


def delivery_figures(
    trial: TeamTrial, seen: Sequence[ViewerTrial], loops: Sequence[Loop]
) -> list[Figure]:
    """Pictures that arrived, against the mean of the loops; no ratio without OpenGL."""
    delivered = sum(one.news for one in seen)
    figures = []
    bare = sum(loop.pictures for loop in loops) / len(loops)
    if math.isfinite(bare):
        figures = [
            Figure("Delivered / rendered by the loop", delivered / bare, "", 2, RATIO_AIM),
            Figure("Loop: pictures", bare, "1/s", 1),
            Figure("Loop: processor use", sum(x.cores for x in loops) / len(loops), "cores", 2),
        ]
    return [
        *figures,
        Figure("Server: new pictures of all cameras", delivered, "1/s", 1),
        Figure("Server: pictures of all cameras", sum(s.pictures for s in seen), "1/s", 1),
        Figure("Server: real-time factor", trial.factor, "", 4),
        Figure("Server: processor use", trial.load.process, "cores", 2),
        *load_figures(trial.load),
    ]


def _loop(world: str, folder: str, robots: int, seconds: float) -> Loop:
    command = [sys.executable, "-m", _INSTRUMENT, "--world", world, "--robots", str(robots)]
    command += ["--class", SURVEYOR, "--folder", folder, "--seconds", str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError(f"the frames instrument failed: {done.stderr[-_SHOWN_ERRORS:].strip()}")
    told = json.loads(done.stdout)
    return Loop(told["renderer"], float(told["pictures"]), float(told["cores"]))
