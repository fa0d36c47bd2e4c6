"""Rays per second in the server, and by bare Embree in the same scene.

A team stands in a world; the fans of all its sensors at one instant are answered as the server
answers them (`Simulation.cast_all`, one batch), and the very same rays are cast by Embree alone in
one scene that holds all triangles of world and robots as they stand, arrays made beforehand. The
loops take turns on one thread; times are processor times. Bare Embree does less: it knows no glass,
no endless planes, no ranges and no names, and a robot's rays meet its own body.
`python -m usarsim_bench.rays` measures, in a process that does nothing else; `usarsim bench rays`
runs it and makes figures of what it prints.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.robot_files import SCOUT, SCOUT_SENSORS, scouts
from usarsim_bench.server import run_instrument
from usarsim_server.app import assemble
from usarsim_server.settings import Settings
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
    """What was measured.

    Attributes:
        world: where. robots: how many.
        rays: in the batch of all. scans: the same with the lasers alone.
        server, bare: rays per s of processor time, all sensors.
        server_scans, bare_scans: the same, lasers alone.
        scenery: rays per s of the server against what never moves, all sensors.
        bare_scenery: of bare Embree in the scene of that alone.
    """

    world: str
    robots: int
    rays: int
    scans: int
    server: float
    bare: float
    server_scans: float
    bare_scans: float
    scenery: float
    bare_scenery: float


def measure(
    world: str, robots: int, robot_class: str, folder: Path | None, seconds: float
) -> Rates:
    """Measure one team.

    Args:
        world: name or folder.
        robots: size of the team.
        robot_class: its class.
        folder: with that class, None for a shipped one.
        seconds: of processor time for each loop, about.
    """
    folders = () if folder is None else (folder,)
    assembly = assemble(
        Settings(world=world, speed=float("inf"), max_robots=max(robots, 1), robots=folders)
    )
    simulation, all_robots = assembly.simulation, assembly.robots
    description = all_robots.describe(robot_class)
    if description is None:
        raise ValueError(f"no such robot class: {robot_class}")
    starts = assembly.world.starts
    team = [
        all_robots.spawn(description, None, starts[number % len(starts)].pose)
        for number in range(robots)
    ]
    simulation.run_until(simulation.look().time + SETTLE)
    snapshot = simulation.look()
    queries = []
    for vehicle in team:
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
    return Rates(Path(world).name, robots, _count(queries), _count(lasers), *rates)


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


def main(arguments: Sequence[str]) -> int:
    """Measure teams and print one JSON object per line, one for each number of robots."""
    parser = argparse.ArgumentParser(prog="python -m usarsim_bench.rays")
    parser.add_argument("--world", default="arena", help="name or folder (default arena)")
    parser.add_argument("--robots", type=int, nargs="+", default=[16], metavar="N")
    parser.add_argument("--class", dest="robot_class", default="P3AT", help="default P3AT")
    parser.add_argument("--folder", type=Path, help="folder with the class")
    parser.add_argument("--seconds", type=float, default=3.0, help="for each loop")
    given = parser.parse_args(arguments)
    for robots in given.robots:
        found = measure(given.world, robots, given.robot_class, given.folder, given.seconds)
        print(json.dumps(asdict(found)), flush=True)
    return 0


ROBOTS = (1, 16, 64)
SECONDS = 3.0
RATIO_AIM = Aim(">=", 0.5)
JUDGED = 16
"""Size of the team whose ratio has an aim."""


def measure_rays(plan: Plan) -> Section:
    """Teams that stand; `plan.seconds` of processor time for each loop."""
    seconds = plan.seconds or SECONDS
    figures: list[Figure] = []
    sizes = plan.sizes(ROBOTS, JUDGED)
    plan.say(f"rays: {', '.join(map(str, sizes))} robots in {plan.world}")
    with scouts() as classes:
        words = ["--world", plan.world, "--class", SCOUT, "--folder", classes[-1]]
        words += ["--seconds", str(seconds), "--robots", *map(str, sizes)]
        for found in run_instrument("rays", words):
            figures += ray_figures(found)
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


def ray_figures(found: dict[str, float]) -> list[Figure]:
    """What the instrument said about one team."""
    robots = int(found["robots"])
    team = f"{robots} robot{'s' if robots != 1 else ''}"
    aim = RATIO_AIM if robots == JUDGED else None
    return [
        Figure(f"{team}: server / bare Embree", found["server"] / found["bare"], "", 2, aim),
        Figure(
            f"{team}: the same, lasers alone", found["server_scans"] / found["bare_scans"], "", 2
        ),
        Figure(
            f"{team}: the same, against what never moves",
            found["scenery"] / found["bare_scenery"],
            "",
            2,
        ),
        Figure(f"{team}: server", found["server"] / 1e6, "M rays/s", 2),
        Figure(f"{team}: bare Embree", found["bare"] / 1e6, "M rays/s", 2),
        Figure(f"{team}: rays in the batch", found["rays"], "", 0),
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
