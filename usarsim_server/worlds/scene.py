"""From a world folder to a MuJoCo specification: scenery, victims, machinery, light."""

from __future__ import annotations

import math
import re

import mujoco

from usarsim_server.base import errors
from usarsim_server.base.errors import WorldError
from usarsim_server.base.files import Folders, data_directory, read_regular
from usarsim_server.base.logs import Log
from usarsim_server.model_check import check_model
from usarsim_server.simulation.ground import Surface
from usarsim_server.simulation.motion_laws import add_bounds
from usarsim_server.simulation.splice import FixedPart
from usarsim_server.specs import read_spec
from usarsim_server.world_cost import LARGE, LIMITS, WorldLimits, check_scene
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.machinery.bodies import add_machinery
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
        add_machinery(spec, world.machinery, world.folder, world.scene.name)
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
