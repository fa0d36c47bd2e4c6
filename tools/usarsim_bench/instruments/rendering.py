"""What a camera picture costs, beside a bare MuJoCo renderer on the same scene, and how old it is.

One process, one thread, in turns, for a team of robots with cameras on their start poses:

* **bare**: `mujoco.Renderer` and nothing else, with the same quality, camera and OpenGL;
* **tile**: the painter of the server, from a snapshot to the finished pixels of a tile;
* **smoky** and **lit**: the same in haze, and with the headlight on;
* **rays**: the same without OpenGL;
* **jpeg**: encoding a tile;
* **depth**: an image as of a `RangeImager`, by rendering, and by the rays of the sensor itself.

These are processor times per picture, so that other programs disturb them little. After that the
world runs at real time with the robots driving in circles, and some cameras are watched: pictures
per second, the age of a frame when its watcher is told, and the real-time factor are wall times.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from statistics import median

import numpy as np

from usarsim_bench.instruments.bare_renderer import BareRenderer
from usarsim_server.app import Assembly, assemble
from usarsim_server.cameras.encoding import Encoder
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.view import Eye, Frame, View
from usarsim_server.protocol.images import NORMAL
from usarsim_server.sensors.ranges import wire_directions
from usarsim_server.settings import Settings
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.description import Smoke

ROBOT_CLASS = "P3AT"
REPETITIONS = 15
SETTLE = 1.0
"""s of simulated time before pictures are taken, and of wall time before they are counted."""
LATEST = 60.0
"""s of wall time after which a run without any frame is given up."""
MAST = Pose((0.1, 0.0, 0.42))
"""Of cameras that are added where the team has not enough of its own."""
RANGE_IMAGER = (320, 240, 1.01226, 0.7854, 20.0)
"""Width, height, fields of view (rad) and range (m) of the sensor's defaults."""


@dataclass(frozen=True, slots=True)
class Costs:
    """Processor milliseconds per picture of 320 x 240; medians. Infinite: no OpenGL here.

    Attributes:
        renderer: what drew `tile`.
        bare, tile, smoky, lit, rays, jpeg: see the module.
        depth_rendered, depth_rays: a whole depth image.
        to_bare: `bare` over `tile`: the part of the speed of bare MuJoCo that is left.
    """

    renderer: str
    robots: int
    bare: float
    tile: float
    smoky: float
    lit: float
    rays: float
    jpeg: float
    depth_rendered: float
    depth_rays: float
    to_bare: float


@dataclass(frozen=True, slots=True)
class Watched:
    """A number of watched cameras at real time.

    Attributes:
        cameras: watched.
        pictures: of all of them per s of wall time.
        age: median s between the simulated instant of a frame and its delivery.
        oldest: 99th percentile of that.
        factor: simulated over wall time meanwhile.
    """

    cameras: int
    pictures: float
    age: float
    oldest: float
    factor: float


def measure_costs(world: str, robots: int) -> Costs:
    """Take the costs in one world.

    Raises:
        UsarsimError: if the world cannot be used.
    """
    assembly = _assembly(world, robots, math.inf)
    try:
        assembly.simulation.run_until(SETTLE)
        snapshot = assembly.simulation.look()
        return _costs(assembly, snapshot)
    finally:
        assembly.stop()


def _costs(assembly: Assembly, snapshot: Snapshot) -> Costs:
    compiled = assembly.simulation.compiled
    view = assembly.board.views[0]
    painters = {
        "tile": Painter(compiled, PainterOptions()),
        "smoky": Painter(compiled, PainterOptions(smoke=Smoke(haze=0.05))),
        "lit": Painter(compiled, PainterOptions(), lambda robot: robot == view.robot),
        "rays": Painter(compiled, PainterOptions(renderer="rays")),
    }
    plain = painters["tile"]
    eye = plain.place(view, snapshot, 320, 240)
    assert eye is not None
    works: dict[str, Callable[[], object]] = {
        name: (lambda painter=painter: painter.tile(eye, snapshot))  # type: ignore[misc]
        for name, painter in painters.items()
    }
    frame = Frame(1, 0.0, plain.tile(eye, snapshot).copy())
    tile = assembly.board.grid.region(0)
    works["jpeg"] = lambda: Encoder(NORMAL).encode(frame, tile)
    works |= _depth_works(assembly, plain, snapshot, eye)
    bare = None
    if plain.renderer != "rays":
        bare = BareRenderer(plain.renderer, assembly.simulation.compiled(snapshot), snapshot, eye)
        works["bare"] = lambda: bare.draw(eye)
    spent = _in_turns(works)
    for painter in painters.values():
        painter.close()
    if bare is not None:
        bare.close()
    spent.setdefault("bare", math.inf)
    return Costs(
        renderer=plain.renderer,
        robots=len(snapshot.layouts),
        to_bare=spent["bare"] / spent["tile"],
        **spent,
    )


def _depth_works(
    assembly: Assembly, painter: Painter, snapshot: Snapshot, eye: Eye
) -> dict[str, Callable[[], object]]:
    """A depth image by rendering and by the rays of the sensor."""
    width, height, fov, tall, reach = RANGE_IMAGER
    image = View(eye.pose, fov, width, height, "depth")
    yaw = fov * (np.arange(width) / width - 0.5)
    pitch = tall * (0.5 - np.arange(height) / height)
    rays = wire_directions(np.tile(yaw, height), np.repeat(pitch, width))
    directions = rays @ eye.pose.matrix().T
    fan = RayFan(np.array(eye.pose.position), directions, reach)
    robot = next(iter(snapshot.layouts))
    return {
        "depth_rendered": lambda: painter.picture(image, snapshot),
        "depth_rays": lambda: assembly.simulation.cast([fan], snapshot, robot),
    }


def _in_turns(works: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Median processor milliseconds of each work, done in turns so that all suffer alike."""
    spent: dict[str, list[float]] = {name: [] for name in works}
    for repetition in range(REPETITIONS + 1):
        for name, work in works.items():
            started = time.thread_time()
            work()
            if repetition:
                spent[name].append(1e3 * (time.thread_time() - started))
    return {name: median(times) for name, times in spent.items()}


def measure_watched(world: str, robots: int, cameras: int, seconds: float) -> Watched:
    """Watch some cameras of a driving team for so many s of wall time, longer if no frame comes.

    Raises:
        UsarsimError: if the world cannot be used.
    """
    assembly = _assembly(world, robots, 1.0, cameras)
    simulation, studio = assembly.simulation, assembly.studio
    told: list[tuple[float, float]] = []
    try:
        studio.open()
        simulation.start()
        for vehicle in assembly.fleet.vehicles:
            wheels = vehicle.description.driven_wheels
            vehicle.body.drive(np.array([0.6 if wheel.side == "left" else 1.2 for wheel in wheels]))
        tiles = [assembly.board.grid.region(tile) for tile in range(cameras)]
        watches = [
            studio.watch(tile, lambda frame: told.append((time.perf_counter(), frame.time)))
            for tile in tiles
        ]
        time.sleep(2.0 * SETTLE)
        started, begun, painted = time.perf_counter(), simulation.look().time, studio.pictures
        told.clear()
        time.sleep(seconds)
        while not told and time.perf_counter() < started + seconds + LATEST:
            time.sleep(0.01)
        now, ended = time.perf_counter(), simulation.look().time
        pictures, frames = studio.pictures - painted, list(told)
        for watch in watches:
            watch.close()
    finally:
        assembly.stop()
    factor = (ended - begun) / (now - started)
    # The world's clock at a moment of wall time, by the line through both ends.
    ages = [begun + (moment - started) * factor - seen for moment, seen in frames]
    return Watched(
        cameras=cameras,
        pictures=pictures / (now - started),
        age=median(ages),
        oldest=float(np.percentile(ages, 99.0)),
        factor=factor,
    )


def _assembly(world: str, robots: int, speed: float, cameras: int = 1) -> Assembly:
    """A world with a team, and with as many cameras as are wanted."""
    assembly = assemble(
        Settings(
            world=world,
            speed=speed,
            port=None,
            image_port=None,
            groundtruth_port=None,
            wireless_port=None,
            truth_port=None,
        )
    )
    description = assembly.fleet.describe(ROBOT_CLASS)
    assert description is not None
    starts = assembly.world.starts
    for number in range(robots):
        assembly.fleet.spawn(description, None, starts[number % len(starts)].pose)
    vehicles = assembly.fleet.vehicles
    for number in range(cameras - len(assembly.board.views)):
        vehicle = vehicles[number % robots]
        turned = Pose(MAST.position, (math.cos(number), 0.0, 0.0, math.sin(number)))
        assembly.board.add(f"More{number}", vehicle.name, vehicle.robot, None, turned, 1.3963)
    return assembly


def main(arguments: Sequence[str]) -> int:
    """Measure, and print one JSON object for the costs and one for each number of cameras."""
    parser = argparse.ArgumentParser(prog="python -m usarsim_bench.instruments.rendering")
    parser.add_argument("--world", default="arena", help="name or folder (default arena)")
    parser.add_argument("--robots", type=int, default=4, help="size of the team (default 4)")
    parser.add_argument("--cameras", type=int, nargs="*", default=[1, 4, 16], metavar="N")
    parser.add_argument("--seconds", type=float, default=5.0, help="wall time for each number")
    given = parser.parse_args(arguments)
    print(json.dumps(asdict(measure_costs(given.world, given.robots))), flush=True)
    for cameras in given.cameras:
        watched = measure_watched(given.world, given.robots, cameras, given.seconds)
        print(json.dumps(asdict(watched)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
