"""Draws a world: `python -m world_generators.drawing WORLD PICTURE.png`.

The picture of a world (a name or a folder) is what its camera `overview` sees, or a view from above
one corner, with an arrow at every start pose.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import write_bytes
from usarsim_server.cameras.encoding import encode_png
from usarsim_server.simulation.frames import Array
from usarsim_server.worlds.description import SmokeVolume, WorldDescription
from usarsim_server.worlds.loader import find_world, load_world
from usarsim_server.worlds.scene import build_scene
from usarsim_server.worlds.smoke import SmokeField

OVERVIEW = "overview"
_OVERSAMPLING = 2
_SHADOW_MAP = 8192
_ARROW_LENGTH, _ARROW_WIDTH = 1.5, 0.07
_ARROW_COLOR = np.array([0.05, 0.60, 0.30, 1.0], np.float32)
_SMOKE_SHADE = 0.55
_SMOKE_ALPHA = 0.35
_PARTICLE_COLOR = np.array([0.25, 0.25, 0.25, 0.45], np.float32)
_SHAPES = {"box": mujoco.mjtGeom.mjGEOM_BOX, "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID}


def draw_world(world: WorldDescription, width: int = 960, height: int = 600) -> NDArray[np.uint8]:
    """Render a world with shadows and smoothed edges: (height, width, 3), red, green, blue.

    Start poses are shown as green arrows, regional and local smoke (as it is at first) as grey
    bodies that can be seen through.

    Raises:
        WorldError: if the scene cannot be built.
        RuntimeError: if there is no way to render on this machine (see `MUJOCO_GL`).
    """
    spec = build_scene(world)
    shape = (height * _OVERSAMPLING, width * _OVERSAMPLING)
    settings = spec.visual
    settings.global_.offheight, settings.global_.offwidth = shape
    settings.quality.shadowsize = _SHADOW_MAP
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE
    particles, radii = SmokeField(world.smoke).particles(0.0)
    extra = len(world.starts) + len(world.smoke.volumes) + len(particles)
    with mujoco.Renderer(model, *shape, max_geom=model.ngeom + extra + 100) as renderer:
        renderer.update_scene(data, _viewpoint(model))
        for start in world.starts:
            _add_arrow(renderer.scene, start.pose.position, start.pose.rotate((1.0, 0.0, 0.0)))
        for volume in world.smoke.volumes:
            _add_volume(renderer.scene, volume)
        for centre, radius in zip(particles, radii, strict=True):
            size = np.array([radius, 0.0, 0.0])
            _add(renderer.scene, sphere, size, centre, np.eye(3), _PARTICLE_COLOR)
        fine = renderer.render()
    blocks = fine.reshape(height, _OVERSAMPLING, width, _OVERSAMPLING, 3)
    smooth: NDArray[np.uint8] = blocks.mean(axis=(1, 3)).round().astype(np.uint8)
    return smooth


def _viewpoint(model: mujoco.MjModel) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    fixed = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, OVERVIEW)
    if fixed >= 0:
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = fixed
        return camera
    camera.lookat[:] = model.stat.center
    camera.distance = 2.2 * model.stat.extent
    camera.azimuth, camera.elevation = 60.0, -50.0
    return camera


def _add_arrow(scene: mujoco.MjvScene, tail: Sequence[float], heading: Sequence[float]) -> None:
    geom = scene.geoms[scene.ngeom]
    start = np.array(tail)
    tip = start + _ARROW_LENGTH * np.array(heading)
    kind = mujoco.mjtGeom.mjGEOM_ARROW
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), _ARROW_COLOR)
    mujoco.mjv_connector(geom, kind, _ARROW_WIDTH, start, tip)
    scene.ngeom += 1


def _add_volume(scene: mujoco.MjvScene, volume: SmokeVolume) -> None:
    """Denser smoke is darker."""
    shade = _SMOKE_SHADE * math.exp(-0.5 * volume.density)
    color = np.array([shade, shade, shade, _SMOKE_ALPHA], np.float32)
    pose, half = volume.pose, np.array(volume.size) / 2.0
    _add(scene, _SHAPES[volume.shape], half, np.array(pose.position), pose.matrix(), color)


def _add(
    scene: mujoco.MjvScene,
    shape: int,
    size: Array,
    place: Array,
    turn: Array,
    color: NDArray[np.float32],
) -> None:
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, shape, size, place, turn.reshape(9), color)
    scene.ngeom += 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw one world into one file; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m world_generators.drawing", description="Draw a world into a PNG file."
    )
    parser.add_argument("world", help="name of a shipped world, or a world folder")
    parser.add_argument("picture", type=Path, help="PNG file to write")
    parser.add_argument("--width", type=int, default=960, help="pixels (default 960)")
    parser.add_argument("--height", type=int, default=600, help="pixels (default 600)")
    chosen = parser.parse_args(arguments)
    try:
        picture = draw_world(load_world(find_world(chosen.world)), chosen.width, chosen.height)
        write_bytes(chosen.picture, encode_png(picture))
    except (UsarsimError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
