"""Camera pictures that clients get, against a loop that only renders and encodes.

The loop (`measure_frames`) puts a team into a world and lets time stand still; then one thread
draws the cameras of all robots in turn with `mujoco.Renderer`, in the quality of the server's
default, and makes a JPEG of each picture with the server's own codec. It runs in a process of its
own before and after the server, on the same cameras of the same team, so that both have the machine
for themselves.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.apart import run_apart
from benchmarks.cameras import TILE_SIZE, grid, tiles_of
from benchmarks.measures import ViewerTrial, summed_up
from benchmarks.plan import Plan
from benchmarks.rendering import BareRenderer, assemble_team
from benchmarks.robot_files import SURVEYOR, SURVEYOR_CAMERAS, scouts
from benchmarks.server import Server
from benchmarks.team import TeamTrial, gather, load_figures, try_team
from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.figures import Aim, Figure, Section
from usarsim_bench.watching import watching
from usarsim_server.assembly import Assembly
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cameras.encoding import encode_jpeg
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.view import Eye
from usarsim_server.protocol.images import NORMAL
from usarsim_server.simulation.snapshot import Snapshot

SETTLE = 1.0
"""s of simulated time before pictures are taken."""


@dataclass(frozen=True, slots=True)
class Frames:
    """What the loop made."""

    renderer: str  # platform of OpenGL; "rays" if there is none here, so that nothing was drawn
    cameras: int  # that took turns
    pictures: float  # per s of wall time
    cores: float  # processors kept busy meanwhile, by this process
    octets: float  # mean length of a JPEG


def measure_frames(
    world: str, robot_class: str, folders: Sequence[Path], robots: int, seconds: float
) -> Frames:
    """Draw and encode for so many seconds of wall time.

    The robots, all of a class that carries cameras, stand on the world's start poses in turn;
    `folders` have further robot files.

    Raises:
        UsarsimError: if the world or the class cannot be used, or carries no camera.
    """
    assembly = assemble_team(
        world,
        robot_class,
        robots,
        speed=math.inf,
        robots=tuple(folders),
        max_robots=robots,
        tile_size=TILE_SIZE,
    )
    try:
        assembly.simulation.run_until(SETTLE)
        snapshot = assembly.simulation.look()
        painter = Painter(assembly.simulation.compiled, PainterOptions())
        renderer, eyes = painter.renderer, _eyes(assembly, painter, snapshot)
        painter.close()
        if not eyes:
            raise UsarsimError(f"{robot_class} carries no camera (name a class that does)")
        if renderer == "rays":
            return Frames(renderer, len(eyes), math.nan, math.nan, math.nan)
        compiled = assembly.simulation.compiled(snapshot)
        with BareRenderer(renderer, compiled, snapshot, eyes[0]) as bare:
            return _drawn(bare, renderer, eyes, seconds)
    finally:
        assembly.stop()


def _drawn(bare: BareRenderer, renderer: str, eyes: Sequence[Eye], seconds: float) -> Frames:
    quality = NORMAL.quality
    assert quality is not None  # a JPEG
    for eye in eyes:
        encode_jpeg(bare.draw(eye), quality, b"")
    pictures = octets = 0
    begun, spent = time.perf_counter(), time.process_time()
    while (elapsed := time.perf_counter() - begun) < seconds:
        octets += len(encode_jpeg(bare.draw(eyes[pictures % len(eyes)]), quality, b""))
        pictures += 1
    cores = (time.process_time() - spent) / elapsed
    return Frames(renderer, len(eyes), pictures / elapsed, cores, octets / pictures)


def _eyes(assembly: Assembly, painter: Painter, snapshot: Snapshot) -> list[Eye]:
    placed = (painter.place(view, snapshot, *TILE_SIZE) for view in assembly.board.views)
    return [eye for eye in placed if eye is not None]


ROBOTS = 4
SECONDS = 20.0
MOST_TILES = 64
DEMAND = 1.5
"""Pictures asked for, over those that the loop makes."""
RATES = (5.0, 60.0)
"""Pictures per second of a camera that a server can be asked for here."""

RATIO_AIM = Aim(">=", 0.85)


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
        drawn = (plan.world, SURVEYOR, [Path(classes[1])], robots, seconds / 2)
        plan.say(f"delivery: {cameras} cameras without a server for {seconds / 2:g} s")
        loops = [run_apart(measure_frames, *drawn)]
        rate = rate_for(loops[0].pictures, cameras)
        plan.say(f"delivery: {cameras} cameras watched for {seconds:g} s")
        columns, rows = grid(cameras)
        options = (
            *(*classes, "--tiles", f"{columns}x{rows}"),
            *("--tile-size", "x".join(map(str, TILE_SIZE)), "--camera-rate", f"{rate:.2f}"),
        )
        with (
            Server(plan.world, robots, *options) as server,
            Crowd(server.port, plan.seed) as crowd,
        ):
            trial, seen = _watched(server, crowd, robots, rate, seconds)
        plan.say(f"delivery: {cameras} cameras without a server for {seconds / 2:g} s")
        loops.append(run_apart(measure_frames, *drawn))
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
    port = server.port_of("images")
    gather(crowd, robots, (SURVEYOR,))
    with watching(port, tiles_of(robots * SURVEYOR_CAMERAS), rate) as found:
        trial = try_team(server, crowd, 0, seconds)
    return trial, [summed_up(one, trial.start, trial.stop) for one in found]


def delivery_figures(
    trial: TeamTrial, seen: Sequence[ViewerTrial], loops: Sequence[Frames]
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
