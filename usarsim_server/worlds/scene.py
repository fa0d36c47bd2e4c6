"""From a world folder to a MuJoCo specification: scenery, victims, machinery, light; and its
picture.

`python -m usarsim_server.worlds.scene WORLD PICTURE.png` draws a world (a name or a folder) as its
camera `overview` sees it, or from above one corner, with an arrow at every start pose.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server import errors
from usarsim_server.errors import UsarsimError, WorldError
from usarsim_server.files import Folders, data_directory, read_regular, write_bytes
from usarsim_server.logs import Log
from usarsim_server.model_check import check_model
from usarsim_server.simulation.frames import Array
from usarsim_server.simulation.ground import Surface
from usarsim_server.simulation.motion_laws import add_bounds
from usarsim_server.simulation.splice import FixedPart
from usarsim_server.specs import read_spec
from usarsim_server.world_cost import LARGE, LIMITS, WorldLimits, check_scene
from usarsim_server.worlds.description import SmokeVolume, WorldDescription
from usarsim_server.worlds.loader import find_world, load_world
from usarsim_server.worlds.machinery.bodies import add_machinery
from usarsim_server.worlds.smoke import SmokeField
from usarsim_server.worlds.solids import read_apart
from usarsim_server.worlds.strips import add_strips
from usarsim_server.worlds.victims import add_victim

PAINT = {
    "water": (0.30, 0.45, 0.60, 1.0),
    "mud": (0.33, 0.24, 0.16, 1.0),
    "sand": (0.80, 0.69, 0.46, 1.0),
    "ice": (0.80, 0.90, 0.96, 1.0),
    "custom": (0.50, 0.50, 0.48, 1.0),
}
"""Colours of patches of ground whose substance the scene has no material for."""
PAINT_DEPTH = 0.01
"""m: thickness of a patch that is drawn on the floor."""
PAINT_HEIGHT = 0.0005
"""m by which it stands out, so that it covers the floor."""

_log = Log("worlds")

_LINE = re.compile(r"\bline (?:number=)?(\d+)", re.IGNORECASE)


def build_scene(
    world: WorldDescription, *, allow_outside: bool = False, compiled: bool = True
) -> mujoco.MjSpec:
    """Read the scene of a world and put its victims and its machinery in.

    The result compiles and knows the box of the world. Its extent and centre are fixed, so that
    parking robots far away does not change clip planes and shadows of cameras; a scene without
    light is given some, one without a sky a blue one.

    Args:
        world: whose scene it is.
        allow_outside: it may name files outside the world's folder and the shipped data.
        compiled: False if the caller compiles it at once, and asks `scene_error` when that fails:
            then it is compiled here only to learn an extent or a centre that it does not say.

    Raises:
        WorldError: if it names files outside, or would grow too large (`model_check`), if MuJoCo
            cannot read or compile the scene, if the scene sets what the server
            decides (`option`, `keyframe`), if a movable body has no name, or if a name or a
            material of the machinery does not fit the scene.
    """
    _look_through(world, allow_outside)
    spec = _read(world)
    _furnish(world, spec, compiled)
    return spec


def build_in_parts(
    world: WorldDescription, *, allow_outside: bool = False, limits: WorldLimits = LIMITS
) -> tuple[mujoco.MjSpec, FixedPart | None]:
    """The same as `build_scene` for a server, which compiles it again and again.

    Returns:
        A specification, and fixed geoms of a large world that are compiled already; these are not
        in it.

    Raises:
        WorldError: see `build_scene`; or it is beyond its limits.
    """
    _look_through(world, allow_outside)
    try:
        cost = check_scene(world.scene, limits, WorldError)
        told = _log.warning if cost.pieces >= LARGE else _log.debug
        told("what the world costs", world=world.name, cost=cost.text())
        parts = read_apart(world.scene)
    except (ValueError, OSError) as error:
        raise scene_error(world, error) from error
    spec, fixed = parts if parts is not None else (_read(world), None)
    _furnish(world, spec, compiled=False)
    return spec, fixed


def _look_through(world: WorldDescription, allow_outside: bool) -> None:
    shipped = data_directory("worlds")
    own = [world.folder, world.scene.parent]
    folders = Folders([*own, shipped], allow_outside=allow_outside)
    check_model(world.scene, folders, WorldError)


def _read(world: WorldDescription) -> mujoco.MjSpec:
    try:
        return read_spec(world.scene)
    except (ValueError, OSError) as error:
        raise scene_error(world, error) from error


def _furnish(world: WorldDescription, spec: mujoco.MjSpec, compiled: bool) -> None:
    """Put into a scene what the world's facts say, see `build_scene`."""
    _refuse_server_settings(world, spec)
    if not spec.lights:
        _add_light(spec)
    if all(texture.type != mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        _add_sky(spec)
    add_bounds(spec, world.lower, world.upper)
    try:
        add_strips(spec, world.zones)
        for victim in world.victims:
            add_victim(spec, victim)
        for number, surface in enumerate(world.surfaces, start=1):
            if surface.painted:
                _paint(spec, surface, number)
        add_machinery(spec, world)
        if compiled or math.isnan(spec.stat.extent) or math.isnan(spec.stat.center[0]):
            model = spec.compile()
            spec.stat.extent = model.stat.extent
            spec.stat.center = model.stat.center
    except ValueError as error:
        raise scene_error(world, error) from error


def scene_error(world: WorldDescription, error: Exception) -> WorldError:
    """What MuJoCo says of a scene that it cannot read or compile, with file, line and cure."""
    text = " ".join(str(error).split())
    line = _LINE.search(text)
    problem = text.removeprefix("Error: ")
    cure = "mend the scene; MuJoCo's XML reference lists elements and attributes"
    where = f"line {line[1]}" if line else None
    return WorldError(errors.at(world.scene, problem, cure, where=where))


def _is_movable(body: mujoco.MjsBody) -> bool:
    return any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints)


def _refuse_server_settings(world: WorldDescription, spec: mujoco.MjSpec) -> None:
    name = _changed_option(spec)
    if name is not None:
        raise _refusal(
            world,
            f"the scene sets the simulation option `{name}`",
            "delete the <option> element; the server chooses the options of the physics",
            "<option",
        )
    if spec.keys:
        raise _refusal(
            world,
            "the scene has a keyframe, which cannot fit once robots are added",
            "delete the <keyframe> element; movable bodies start where the scene puts them",
            "<keyframe",
        )
    if any(_is_movable(body) and not body.name for body in spec.bodies):
        raise _refusal(
            world,
            "a body with a free joint has no name",
            'write <body name="..."> so that it can be addressed',
            "<freejoint",
        )


def _changed_option(spec: mujoco.MjSpec) -> str | None:
    ours, fresh = spec.option, mujoco.MjSpec().option
    for name in dir(fresh):
        if name.startswith("_") or callable(getattr(fresh, name)):
            continue
        if str(getattr(ours, name)) != str(getattr(fresh, name)):
            return name
    return None


def _refusal(world: WorldDescription, problem: str, cure: str, text: str) -> WorldError:
    """What is wrong with a scene, in the first line that has a text."""
    lines = read_regular(world.scene).decode("utf-8", "replace").splitlines()
    where = next((f"line {n}" for n, line in enumerate(lines, start=1) if text in line), None)
    return WorldError(errors.at(world.scene, problem, cure, where=where))


def _paint(spec: mujoco.MjSpec, surface: Surface, number: int) -> None:
    """Draw a patch of ground on the floor; nothing touches the drawing."""
    if spec.material(surface.kind) is None:
        spec.add_material(name=surface.kind, rgba=PAINT[surface.kind])
    middle = [sum(limits) / 2.0 for limits in (surface.x, surface.y)]
    half = [(limits[1] - limits[0]) / 2.0 for limits in (surface.x, surface.y)]
    spec.worldbody.add_geom(
        name=f"surface_{number}",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[*middle, PAINT_HEIGHT - PAINT_DEPTH / 2.0],
        size=[*half, PAINT_DEPTH / 2.0],
        material=surface.kind,
        contype=0,
        conaffinity=0,
    )


def _add_sky(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name="usarsim:sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=(0.55, 0.67, 0.80),
        rgb2=(0.93, 0.95, 0.96),
        width=64,
        height=6 * 64,
    )


def _add_light(spec: mujoco.MjSpec) -> None:
    spec.worldbody.add_light(
        name="daylight",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=(0.0, 0.0, 20.0),
        dir=(0.3, -0.2, -1.0),
        diffuse=(0.6, 0.6, 0.6),
        castshadow=False,
    )


Shade = NDArray[np.float32]
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
    import cv2  # no use to a server

    parser = argparse.ArgumentParser(
        prog="python -m usarsim_server.worlds.scene", description="Draw a world into a PNG file."
    )
    parser.add_argument("world", help="name of a shipped world, or a world folder")
    parser.add_argument("picture", type=Path, help="PNG file to write")
    parser.add_argument("--width", type=int, default=960, help="pixels (default 960)")
    parser.add_argument("--height", type=int, default=600, help="pixels (default 600)")
    chosen = parser.parse_args(arguments)
    try:
        picture = draw_world(load_world(find_world(chosen.world)), chosen.width, chosen.height)
        _, content = cv2.imencode(".png", picture[..., ::-1])
        write_bytes(chosen.picture, content.tobytes())
    except (UsarsimError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
