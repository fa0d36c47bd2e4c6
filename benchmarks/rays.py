"""Rays per second in the server, and by bare Embree in the same scene.

A team stands in a world; the fans of all its sensors at one instant are answered as the server
answers them (`Simulation.cast_all`, one batch), and the very same rays are cast by Embree alone in
one scene that holds all triangles of world and robots as they stand, arrays made beforehand. The
loops take turns on one thread; times are processor times. Bare Embree does less: it knows no glass,
no endless planes, no ranges and no names, and a robot's rays meet its own body.
`measure` runs in a process that does nothing else.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from benchmarks.apart import run_apart
from benchmarks.plan import Plan
from benchmarks.rendering import assemble_team
from benchmarks.robot_files import SCOUT, SCOUT_SENSORS, scouts
from usarsim_bench.figures import Aim, Figure, Section
from usarsim_server.simulation.model import SHELF_NAME
from usarsim_server.simulation.rays.query import PendingReport
from usarsim_server.simulation.rays.scenery import is_visible
from usarsim_server.simulation.rays.triangles import triangles
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.simulation.snapshot import Snapshot

Array = NDArray[np.float64]
Rays = NDArray[np.float32]

SETTLE = 2.0
"""Simulated s before the instant."""
TURNS = 7
PLANE_HALF = 100.0
"""m: endless planes end here for bare Embree."""


@dataclass(frozen=True, slots=True)
class Rates:
    """What was measured: rays in a batch, and rays per s of processor time."""

    rays: int  # of all sensors
    server: float
    bare: float
    server_scans: float  # lasers alone
    bare_scans: float
    scenery: float  # the server, all sensors, against what never moves
    bare_scenery: float  # bare Embree in the scene of that alone


def measure(world: str, robots: int, folder: Path, seconds: float) -> Rates:
    """Measure one team of the `SCOUT` of a folder, each loop for about so many processor s."""
    assembly = assemble_team(
        world, SCOUT, robots, speed=math.inf, max_robots=robots, robots=(folder,)
    )
    simulation = assembly.simulation
    simulation.run_until(simulation.look().time + SETTLE)
    snapshot = simulation.look()
    queries = []
    for vehicle in assembly.robots.vehicles:
        state = vehicle.body.state(snapshot)
        if state is not None:
            fans = [fan for sensor in vehicle.sensors for fan in sensor.rays(state)]
            queries.append(PendingReport(snapshot, vehicle.robot, fans))
    lasers = [
        replace(query, fans=[fan for fan in query.fans if len(fan.directions) > 100])
        for query in queries
    ]
    whole, fixed = bare_scene(simulation, snapshot), bare_scene(simulation, None)
    rates = _in_turns(
        [
            (_count(queries), lambda: simulation.cast_all(queries)),
            (_count(queries), _bare(whole, queries)),
            (_count(lasers), lambda: simulation.cast_all(lasers)),
            (_count(lasers), _bare(whole, lasers)),
            (
                _count(queries),
                lambda: simulation.cast_scenery([fan for query in queries for fan in query.fans]),
            ),
            (_count(queries), _bare(fixed, queries)),
        ],
        seconds,
    )
    assembly.stop()
    return Rates(_count(queries), *rates)


def bare_scene(simulation: Simulation, snapshot: Snapshot | None) -> rtcore_scene.EmbreeScene:
    """One Embree scene of everything visible as it stands; None: of what never moves."""
    world = simulation.compiled(simulation.look() if snapshot is None else snapshot)
    model, data = world.model, mujoco.MjData(world.model)
    if snapshot is not None:
        data.qpos[:] = snapshot.qpos
    mujoco.mj_kinematics(model, data)
    present = set() if snapshot is None else {lay.base for lay in snapshot.layouts.values()}
    parked = {lay.base for lay in world.layouts} - present
    parts: list[Array] = []
    for geom in range(model.ngeom):
        body = model.geom_bodyid[geom]
        moves = model.body_weldid[body] != 0
        hidden = int(model.body_rootid[body]) in parked or (moves and snapshot is None)
        if hidden or model.geom(geom).name == SHELF_NAME or not is_visible(model, geom):
            continue
        place, turn = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * PLANE_HALF
            parts.append(corners[[[0, 1, 2], [0, 2, 3]]] @ turn.T + place)
        else:
            parts.append(triangles(model, geom, place, turn))
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.concatenate(parts).astype(np.float32))
    return scene


def _bare(
    scene: rtcore_scene.EmbreeScene, queries: Sequence[PendingReport]
) -> Callable[[], object]:
    fans = [fan for query in queries for fan in query.fans]
    origins: Rays = np.concatenate(
        [np.broadcast_to(fan.origin, fan.directions.shape) for fan in fans]
    ).astype(np.float32)
    directions: Rays = np.concatenate([fan.directions for fan in fans]).astype(np.float32)
    return lambda: scene.run(origins, directions, output=1)


def _count(queries: Sequence[PendingReport]) -> int:
    return sum(len(fan.directions) for query in queries for fan in query.fans)


def _in_turns(loops: Sequence[tuple[int, Callable[[], object]]], seconds: float) -> list[float]:
    """Rays per processor second of each loop, the median of some turns."""
    found: list[list[float]] = [[] for _ in loops]
    for _ in range(TURNS):
        for (rays, work), rates in zip(loops, found, strict=True):
            work()
            begun, times = time.thread_time(), 0
            while (spent := time.thread_time() - begun) < seconds / TURNS or not times:
                work()
                times += 1
            rates.append(rays * times / max(spent, 1e-9))
    return [median(rates) for rates in found]


ROBOTS = (1, 16, 64)
SECONDS = 3.0
RATIO_AIM = Aim(">=", 0.5)
JUDGED = 16
"""Size of the team whose ratio has an aim."""


def measure_rays(plan: Plan) -> Section:
    """Teams that stand; `plan.seconds` of processor time for each loop."""
    seconds = plan.seconds or SECONDS
    figures: list[Figure] = []
    with scouts() as classes:
        for robots in plan.sizes(ROBOTS, JUDGED):
            plan.say(f"rays: {robots} robots in {plan.world}")
            found = run_apart(measure, plan.world, robots, Path(classes[-1]), seconds)
            figures += ray_figures(robots, found)
    return Section(
        "rays",
        "Rays against bare Embree",
        f"P3AT with {SCOUT_SENSORS} each, standing in {plan.world}; the rays of all sensors at one "
        "instant as one batch. Bare: the same rays, cast by Embree alone in one scene of all "
        "triangles of world and robots, which is built beforehand; it knows no glass, no ranges "
        "and no names, and does not leave out the own body. On one thread, in turns, rates per s "
        "of processor time.",
        tuple(figures),
    )


def ray_figures(robots: int, found: Rates) -> list[Figure]:
    """What was measured of one team."""
    team = f"{robots} robot{'s' if robots != 1 else ''}"
    aim = RATIO_AIM if robots == JUDGED else None
    unmoved = found.scenery / found.bare_scenery
    return [
        Figure(f"{team}: server / bare Embree", found.server / found.bare, "", 2, aim),
        Figure(f"{team}: the same, lasers alone", found.server_scans / found.bare_scans),
        Figure(f"{team}: the same, against what never moves", unmoved),
        Figure(f"{team}: server", found.server / 1e6, "M rays/s"),
        Figure(f"{team}: bare Embree", found.bare / 1e6, "M rays/s"),
        Figure(f"{team}: rays in the batch", found.rays, "", 0),
    ]
