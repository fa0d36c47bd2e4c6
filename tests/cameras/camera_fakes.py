"""A small scenery with carts that carry cameras, and a world whose clock the test turns."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.errors import UsarsimError
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.render_loop import RenderLoop, RenderOptions
from usarsim_server.cameras.view import CameraView, Eye, Frame, Grid, Region, Watch
from usarsim_server.cameras.watching import EMPTY
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.model import CompiledWorld, RobotModel
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.testing import PATIENCE, eventually

Geom = mujoco.mjtGeom
Picture = NDArray[np.uint8]
MakePainter = Callable[..., Painter]

FOV = 1.3963
MAST = Pose((0.1, 0.0, 0.4))
"""Where a cart carries its camera: above everything else."""
RED_BOX = (4.0, 0.0, 0.5)
"""Middle of a red box of 1 m."""


def scenery() -> mujoco.MjSpec:
    """A grey floor, a red box, a green cylinder far to the left; light from above; a blue sky."""
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient = (0.4, 0.4, 0.4)
    spec.visual.headlight.diffuse = (0.2, 0.2, 0.2)
    spec.visual.headlight.specular = (0.0, 0.0, 0.0)
    spec.stat.extent, spec.stat.center = 10.0, (0.0, 0.0, 0.0)
    world = spec.worldbody
    world.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        dir=(0.3, 0.2, -1.0),
        diffuse=(0.3, 0.3, 0.3),
        specular=(0.0, 0.0, 0.0),
        castshadow=False,
    )
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=(0.2, 0.3, 0.9),
        rgb2=(0.2, 0.3, 0.9),
        width=32,
        height=32 * 6,
    )
    world.add_geom(
        name="floor", type=Geom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0], rgba=[0.5, 0.5, 0.5, 1.0]
    )
    world.add_geom(
        name="red",
        type=Geom.mjGEOM_BOX,
        size=[0.5, 0.5, 0.5],
        pos=RED_BOX,
        rgba=[0.9, 0.05, 0.05, 1.0],
    )
    world.add_geom(
        name="green",
        type=Geom.mjGEOM_CYLINDER,
        size=[0.4, 1.0, 0.0],
        pos=[0.0, 6.0, 1.0],
        rgba=[0.05, 0.8, 0.1, 1.0],
    )
    return spec


def darken(spec: mujoco.MjSpec) -> None:
    """Put out all light of a scenery."""
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = (0.0, 0.0, 0.0)
    for light in spec.lights:
        light.active = False


def build_cart(color: tuple[float, float, float] = (0.1, 0.1, 0.8)) -> mujoco.MjSpec:
    """A box with a mast; its reference point is 0.1 m above the ground."""
    spec = mujoco.MjSpec()
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="free")
    base.add_geom(
        name="chassis",
        type=Geom.mjGEOM_BOX,
        size=[0.25, 0.2, 0.1],
        mass=9.0,
        rgba=[*color, 1.0],
    )
    head = base.add_body(name="head", pos=[0.1, 0.0, 0.3])
    head.add_joint(name="pan", axis=[0.0, 0.0, 1.0])
    head.add_geom(
        type=Geom.mjGEOM_SPHERE, size=[0.05, 0.0, 0.0], mass=0.1, rgba=[0.9, 0.9, 0.1, 1.0]
    )
    return spec


def cart(key: str = "cart", color: tuple[float, float, float] = (0.1, 0.1, 0.8)) -> RobotModel:
    """A class of carts."""
    return RobotModel(key, lambda: build_cart(color), (), rest_height=0.1, anchored=True)


class Yard:
    """The scenery, changed or not, with carts in it, not moving."""

    def __init__(self, change: Callable[[mujoco.MjSpec], object] = lambda spec: None) -> None:
        def changed() -> mujoco.MjSpec:
            spec = scenery()
            change(spec)
            return spec

        self.simulation = Simulation(changed, SimulationOptions())

    def park(self, x: float, y: float, yaw: float = 0.0, model: RobotModel | None = None) -> int:
        """Put a cart there; returns its number."""
        robot, _ = self.simulation.spawn(model or cart(), standing(x, y, yaw))
        return robot

    def turn(self, robot: int, x: float, y: float, yaw: float) -> None:
        """Put a cart somewhere else."""
        self.simulation.body(robot).teleport(standing(x, y, yaw))
        self.simulation.settle()

    def look(self) -> Snapshot:
        """The yard as it is."""
        return self.simulation.look()


def standing(x: float, y: float, yaw: float = 0.0) -> Pose:
    """Pose of a cart that stands somewhere."""
    return Pose((x, y, 0.1), quaternion_from_rpy(0.0, 0.0, yaw))


def camera(
    robot: int | None,
    tile: int | None = 0,
    *,
    key: int = 1,
    pose: Pose = MAST,
    link: str | None = None,
    fov: float = FOV,
) -> CameraView:
    """A camera of a cart."""
    owner = "" if robot is None else f"cart{robot}"
    return CameraView(key, "Camera", owner, robot, link, pose, fov, tile)


def eye_at(pose: Pose, width: int = 160, height: int = 120, fov: float = FOV) -> Eye:
    """An eye in the world."""
    return Eye(pose, fov, width, height)


def is_red(picture: Picture) -> NDArray[np.bool_]:
    """Pixels of the red box, in any light."""
    colors = picture.astype(int)
    strong = colors[..., 0] > 2 * np.maximum(colors[..., 1], colors[..., 2])
    found: NDArray[np.bool_] = strong & (colors[..., 0] > 40)
    return found


class FakeWorld:
    """A yard whose clock the test turns; what the render loop needs of a simulation."""

    def __init__(self, yard: Yard, speed: float = 1.0) -> None:
        self.speed = speed
        self.looks = 0
        self.ended = False
        self._yard = yard
        self._lock = threading.Lock()
        self._snapshot = yard.look()
        self._time = 0.0

    def set_time(self, time: float) -> None:
        """Turn the clock; what the main thread has moved is seen from now on."""
        with self._lock:
            self._time = time
            if threading.current_thread() is threading.main_thread():
                self._snapshot = self._yard.look()

    def look(self) -> Snapshot:
        """The yard at the time that the clock shows."""
        with self._lock:
            if self.ended:
                raise UsarsimError("the simulation has ended")
            self.looks += 1
            return replace(self._snapshot, time=self._time)

    def compiled(self, snapshot: Snapshot) -> CompiledWorld:
        """The model of a snapshot."""
        return self._yard.simulation.compiled(snapshot)


GRID = Grid(2, 2, 32, 24)


MOMENT = 0.15
"""s of wall time in which nothing may happen."""


class Board:
    """Cameras that a test puts there."""

    grid = GRID

    def __init__(self) -> None:
        self.views: tuple[CameraView, ...] = ()


class Set:
    """A yard with three carts, their cameras on the first three tiles, and a studio."""

    def __init__(self) -> None:
        self.yard = Yard()
        # One sees the red box, one looks away from it, one sees it from the side.
        places = ((0.0, 0.0, 0.0), (-3.0, -4.0, 3.1), (3.0, -4.0, 1.3))
        self.robots = [self.yard.park(*place) for place in places]
        self.world = FakeWorld(self.yard)
        self.board = Board()
        self.board.views = tuple(
            camera(robot, tile, key=tile + 1) for tile, robot in enumerate(self.robots)
        )
        self.render_loop = self.make()

    def watch(self, region: Region) -> Watcher:
        """Somebody who watches a region from now on."""
        watcher = Watcher()
        watcher.watch = self.render_loop.watch(region, watcher)
        return watcher

    def make(self, **options: object) -> RenderLoop:
        """A studio over the same yard."""
        painter = PainterOptions(renderer="rays")
        return RenderLoop(
            self.world,
            self.board,  # type: ignore[arg-type]
            RenderOptions(painter=painter, **options),  # type: ignore[arg-type]
        )


class Watcher:
    """Takes frames."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.watch: Watch | None = None
        self._news = threading.Condition()

    def __call__(self, frame: Frame) -> None:
        with self._news:
            self.frames.append(frame)
            self._news.notify_all()

    def wait(self, count: int = 1) -> Frame:
        """The newest frame, once there are so many."""
        with self._news:
            assert self._news.wait_for(lambda: len(self.frames) >= count, PATIENCE), "no frame came"
            return self.frames[-1]


def at_once(work: Callable[[], object], count: int = 4) -> None:
    """Have some threads do the same, and wait for them."""
    threads = [threading.Thread(target=work) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)


def until(condition: Callable[[], bool]) -> None:
    """Wait for something that another thread does."""
    assert eventually(condition)


def part(frame: Frame, tile: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A tile of a frame."""
    region = GRID.region(tile)
    return frame.pixels[region.y :, region.x :][: region.height, : region.width]


def empty(frame: Frame, tile: int) -> bool:
    """Whether a tile is plain."""
    return bool((part(frame, tile) == EMPTY).all())


WIDTH, HEIGHT = 160, 120


def seen(painter: Painter, yard: Yard, robot: int, **kind: object) -> Picture:
    """What the camera of a cart sees."""
    snapshot = yard.look()
    view = camera(robot, **kind)  # type: ignore[arg-type]
    eye = painter.place(view, snapshot, WIDTH, HEIGHT)
    assert eye is not None
    return painter.tile(eye, snapshot).copy()
