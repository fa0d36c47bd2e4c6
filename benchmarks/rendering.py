"""What a camera picture costs, beside a bare MuJoCo renderer on the same scene, and how old it is.

In a process of its own, on one thread, in turns, for a team of robots with cameras on their start
poses:

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

import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.apart import run_apart
from benchmarks.measures import p99
from benchmarks.plan import Plan
from usarsim_bench.figures import Aim, Figure, Section, in_ms
from usarsim_server.app import assemble
from usarsim_server.assembly import Assembly
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cameras.backend import NEAR
from usarsim_server.cameras.encoding import Encoder
from usarsim_server.cameras.gl import QUADS, SLICES, STACKS
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.view import Eye, Frame, View
from usarsim_server.protocol.images import NORMAL
from usarsim_server.sensors.ranges import wire_directions
from usarsim_server.settings import Settings
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.testing import Closing
from usarsim_server.worlds.description import Smoke


class BareRenderer(Closing):
    """`mujoco.Renderer` as anybody would use it, on a scene of the server.

    Draws from eyes of one size and field of view, none of them rolled. Quality, near plane and
    OpenGL are those of the server's default; nothing else is set.
    """

    def __init__(self, platform: str, world: CompiledWorld, snapshot: Snapshot, eye: Eye) -> None:
        """Open a renderer on a platform of OpenGL, "egl" or "osmesa"; `world` is the model of the
        snapshot, `eye` one of those that it will be drawn from."""
        # The platform that mujoco took when it was imported may not be the one that works here.
        renderer = importlib.import_module("mujoco.rendering.classic.renderer")
        context: Any = importlib.import_module(f"mujoco.{platform}").GLContext
        renderer.gl_context.GLContext = context
        stage = Stage(world)
        stage.show(snapshot)
        quality = stage.model.vis.quality
        quality.shadowsize = quality.offsamples = 0
        quality.numslices, quality.numstacks, quality.numquads = SLICES, STACKS, QUADS
        tall = math.atan(eye.slope * eye.height / eye.width)
        stage.model.vis.global_.fovy = math.degrees(2.0 * tall)
        stage.model.vis.map.znear = NEAR / stage.model.stat.extent
        self._camera = mujoco.MjvCamera()
        self._camera.distance = 1.0
        self._data = stage.data
        self._renderer = mujoco.Renderer(stage.model, eye.height, eye.width)
        for flag in ("mjRND_REFLECTION", "mjRND_SHADOW"):
            self._renderer.scene.flags[getattr(mujoco.mjtRndFlag, flag)] = 0

    def draw(self, eye: Eye) -> NDArray[np.uint8]:
        """One picture: (height, width, 3), red green blue."""
        ahead = eye.pose.rotate((1.0, 0.0, 0.0))
        self._camera.lookat = np.add(eye.pose.position, ahead)
        self._camera.azimuth = math.degrees(math.atan2(ahead[1], ahead[0]))
        self._camera.elevation = math.degrees(math.asin(max(-1.0, min(1.0, ahead[2]))))
        self._renderer.update_scene(self._data, self._camera)
        picture: NDArray[np.uint8] = self._renderer.render()
        return picture

    def close(self) -> None:
        """Give everything back."""
        self._renderer.close()


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
    """Processor milliseconds per picture of 320 x 240; medians. Infinite: no OpenGL here."""

    renderer: str  # what drew `tile`
    robots: int
    bare: float  # see the module
    tile: float
    smoky: float
    lit: float
    rays: float
    jpeg: float
    depth_rendered: float  # a whole depth image
    depth_rays: float
    to_bare: float  # `bare` over `tile`: the part of the speed of bare MuJoCo that is left


@dataclass(frozen=True, slots=True)
class Watched:
    """A number of watched cameras at real time."""

    cameras: int  # watched
    pictures: float  # of all of them per s of wall time
    age: float  # median s between the simulated instant of a frame and its delivery
    oldest: float  # 99th percentile of that
    factor: float  # simulated over wall time meanwhile


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
    frame = Frame.of(1, 0.0, plain.tile(eye, snapshot).copy())
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
    simulation, render_loop = assembly.simulation, assembly.render_loop
    told: list[tuple[float, float]] = []
    try:
        render_loop.open()
        simulation.start()
        for vehicle in assembly.robots.vehicles:
            wheels = vehicle.description.driven_wheels
            vehicle.body.drive(np.array([0.6 if wheel.side == "left" else 1.2 for wheel in wheels]))
        tiles = [assembly.board.grid.region(tile) for tile in range(cameras)]
        watches = [
            render_loop.watch(tile, lambda frame: told.append((time.perf_counter(), frame.time)))
            for tile in tiles
        ]
        time.sleep(2.0 * SETTLE)
        started, begun, painted = time.perf_counter(), simulation.look().time, render_loop.pictures
        told.clear()
        time.sleep(seconds)
        while not told and time.perf_counter() < started + seconds + LATEST:
            time.sleep(0.01)
        now, ended = time.perf_counter(), simulation.look().time
        pictures, frames = render_loop.pictures - painted, list(told)
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
        oldest=p99(ages),
        factor=factor,
    )


def _assembly(world: str, robots: int, speed: float, cameras: int = 1) -> Assembly:
    """A world with a team, and with as many cameras as are wanted."""
    assembly = assemble_team(world, ROBOT_CLASS, robots, speed=speed)
    vehicles = assembly.robots.vehicles
    for number in range(cameras - len(assembly.board.views)):
        vehicle = vehicles[number % robots]
        turned = Pose(MAST.position, (math.cos(number), 0.0, 0.0, math.sin(number)))
        assembly.board.add(f"More{number}", vehicle.name, vehicle.robot, None, turned, 1.3963)
    return assembly


def assemble_team(world: str, robot_class: str, size: int, **settings: Any) -> Assembly:
    """A server without ports, and a team on the start poses of its world, in turn.

    Raises:
        UsarsimError: if the world or the class cannot be used.
    """
    ports = dict.fromkeys(("port", "image_port", "groundtruth_port", "wireless_port", "truth_port"))
    assembly = assemble(Settings(world=world, **{**ports, **settings}))
    description = assembly.robots.describe(robot_class)
    if description is None:
        raise UsarsimError(f"there is no robot class {robot_class!r} (see usarsim robots)")
    starts = assembly.world.starts
    for number in range(size):
        assembly.robots.spawn(description, None, starts[number % len(starts)].pose)
    return assembly


ROBOTS = 4
CAMERAS = (1, 4, 16)
SECONDS = 10.0

RATIO_AIM = Aim(">=", 0.85)
FACTOR_AIM = Aim(">=", 0.999)

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
    costs = run_apart(measure_costs, plan.world, robots)
    figures = [
        Figure("bare mujoco.Renderer / tile", costs.to_bare, "", 2, RATIO_AIM),
        *(Figure(name, getattr(costs, key), "ms", 1) for name, key in _COSTS),
    ]
    for cameras in CAMERAS:
        one = run_apart(measure_watched, plan.world, robots, cameras, seconds)
        name = f"{cameras} watched"
        figures += [
            Figure(f"{name}: pictures of all", one.pictures, "1/s", 1),
            in_ms(f"{name}: age when handed out, median", one.age, 0),
            in_ms(f"{name}: age, 99th percentile", one.oldest, 0),
            Figure(f"{name}: real-time factor", one.factor, "", 4, FACTOR_AIM),
        ]
    return Section(
        "rendering",
        "Camera pictures against a bare renderer",
        f"Pictures of 320 x 240 by {costs.renderer}, {robots} P3AT; costs in ms of processor "
        f"time, in turns on one thread; then {seconds:g} s of wall time for each number of "
        "watched cameras, 15 pictures of each asked for per simulated second, the team driving.",
        tuple(figures),
    )
