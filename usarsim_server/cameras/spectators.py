"""Views for spectators: by six numbers, by the name of a view of the world, or of one robot.

Every world has `top`, `overview` and `start`; each camera of its scene is a view of its name, and
goes before an automatic one of that name. A portrait is a view that one robot fills.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from usarsim_server.base.errors import UsarsimError
from usarsim_server.cameras.cutaway import find_cutaway
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.view import View, looking
from usarsim_server.simulation.frames import Array, Pose, Vector, flip_point, pose_of
from usarsim_server.simulation.layout import RobotLayout
from usarsim_server.simulation.model import SHELF_NAME
from usarsim_server.worlds.description import WorldDescription

FOV = math.radians(80.0)
"""Of a view that has none of its own: that of the robots' cameras (robots reference 2.7)."""
_SLANT = math.radians(40.0)
"""Angle at which `overview` looks down."""
_ROOM = 1.1
"""How much more than the world itself is in `top` and `overview`."""
_PREVIEW = 1.6
"""Width by height of the previews that cameras of scenes are made for: as much is always seen."""
_ALONE = 5.0
"""m around the start poses that count as the world where there is nothing but a floor."""
PORTRAIT_FOV = math.radians(32.0)
"""Narrow, so that what is near does not look larger than it is."""
FROM = (0.80, -0.62, 0.52)
"""Direction from the robot to the camera in its own frame: ahead, to the right, above."""
MARGIN = 1.06
"""How much more than the robot is in the picture."""
CLOSEST = 0.3
"""m; nearer, a camera would cut off what is in front of its near plane."""
_SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Where a spectator stands."""

    name: str  # for people
    pose: Pose  # in the world; x looks, y is left, z is up
    fov: float = FOV  # horizontal field of view, rad
    cut: float = math.inf  # m: what is higher is left out, see `View`


def find_viewpoint(text: str, known: Mapping[str, Viewpoint]) -> Viewpoint:
    """What a user means.

    Args:
        text: `x,y,z,x,y,z`, from where and to where in the wire frame (z down), or a name.
        known: views of the world by name.

    Raises:
        UsarsimError: if it is neither, with the names.
    """
    names = {name.lower(): name for name in known}
    wanted = text.strip().lower()
    if wanted in names:
        return known[names[wanted]]
    try:
        x, y, z, *target = (float(part) for part in text.split(","))
        u, v, w = target
        pose = looking(flip_point((x, y, z)), flip_point((u, v, w)))
    except ValueError:
        raise UsarsimError(
            f"there is no view {text!r} (known: {', '.join(known)}; or write six numbers, "
            "x,y,z,x,y,z: from where and to where in the wire frame)"
        ) from None
    return Viewpoint(text, pose)


def named_viewpoints(
    stage: Stage, world: WorldDescription, aspect: float = 4.0 / 3.0, *, open_roofs: bool = False
) -> dict[str, Viewpoint]:
    """The views of a world, which is in the stage, by name.

    Args:
        stage, world: what is seen.
        aspect: width by height of the pictures; cameras of scenes have a vertical field of view.
        open_roofs: `top` and `overview` show the inside of a world that lies below ceilings, see
            `cutaway`; it takes rays through all of the world.
    """
    starts = [start.pose for start in world.starts]
    lower, upper = _bounds(stage, starts)
    lower, upper = np.maximum(lower, world.lower), np.minimum(upper, world.upper)
    level = math.inf
    if open_roofs:
        places = [pose.position for pose in starts]
        cutaway = find_cutaway(stage.model, stage.data, places, lower, upper)
        level, lower, upper = cutaway.level, cutaway.lower, cutaway.upper
    views = {
        "top": replace(_top(lower, upper, aspect), cut=level),
        "overview": replace(_overview(lower, upper, aspect, level), cut=level),
        "start": _start(stage, starts[0]),
    }
    views |= {view.name: view for view in _scene_cameras(stage, aspect)}
    return views


def _bounds(stage: Stage, starts: list[Pose]) -> tuple[Array, Array]:
    """Corners of the box that holds everything that does not move, planes left out."""
    model, data = stage.model, stage.data
    counts = model.body_weldid[model.geom_bodyid] == 0
    counts &= model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE)
    shelf = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, SHELF_NAME)
    if shelf >= 0:
        counts[shelf] = False
    if not counts.any():
        around = np.array([pose.position for pose in starts] or [(0.0, 0.0, 0.0)])
        return around.min(axis=0) - _ALONE, around.max(axis=0) + _ALONE
    turns, boxes = data.geom_xmat[counts].reshape(-1, 3, 3), model.geom_aabb[counts]
    middles = data.geom_xpos[counts] + np.einsum("nij,nj->ni", turns, boxes[:, :3])
    halves = np.einsum("nij,nj->ni", np.abs(turns), boxes[:, 3:])
    return (middles - halves).min(axis=0), (middles + halves).max(axis=0)


def _top(lower: Array, upper: Array, aspect: float) -> Viewpoint:
    """Straight down; x points up in the picture, y to the left, as on a map."""
    middle, half = (lower + upper) / 2.0, (upper - lower) / 2.0
    width = max(half[1], half[0] * aspect) * _ROOM
    fov = math.radians(60.0)
    x, y, _ = middle.tolist()
    height = float(upper[2]) + width / math.tan(fov / 2.0)
    return Viewpoint("top", looking((x, y, height), (x, y, 0.0)), fov)


def _overview(lower: Array, upper: Array, aspect: float, level: float) -> Viewpoint:
    """From a corner at a slant, far enough to see all; `level` is where the world is cut, m."""
    middle = (lower + upper) / 2.0
    radius = float(np.linalg.norm(upper - lower)) / 2.0 * _ROOM
    fov = math.radians(60.0)
    narrow = math.atan(math.tan(fov / 2.0) / max(1.0, aspect))
    away = (0.8 if math.isinf(level) else 0.95) * radius / math.sin(narrow)
    level, climb = away * math.cos(_SLANT), away * math.sin(_SLANT)
    x, y, z = middle.tolist()
    position = (x - 0.8 * level, y - 0.6 * level, z + climb)
    return Viewpoint("overview", looking(position, (x, y, z)), fov)


def _start(stage: Stage, pose: Pose) -> Viewpoint:
    """Over the shoulder of a robot at the first start, or as far behind as there is room."""
    above, ahead = pose @ Pose((0.0, 0.0, 1.2)), pose @ Pose((2.0, 0.0, 0.0))
    back = np.array(pose.rotate((-1.0, 0.0, 0.0)))
    met = np.array([-1], np.int32)
    free = mujoco.mj_ray(
        stage.model, stage.data, np.array(above.position), back, None, 1, -1, met, None
    )
    distance = 2.0 if free < 0.0 else max(0.0, min(2.0, free - 0.2))
    x, y, z = (np.array(above.position) + distance * back).tolist()
    return Viewpoint("start", looking((x, y, z), ahead.position))


def _scene_cameras(stage: Stage, aspect: float) -> Iterable[Viewpoint]:
    model, data = stage.model, stage.data
    for camera in range(model.ncam):
        name = model.camera(camera).name
        if not name or model.body_weldid[model.cam_bodyid[camera]] != 0:
            continue
        # A camera of MuJoCo looks along -z, x is right, y is up.
        right, up, back = data.cam_xmat[camera].reshape(3, 3).T
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, np.column_stack([-back, -right, up]).ravel())
        tall = math.tan(math.radians(float(model.cam_fovy[camera])) / 2.0)
        fov = 2.0 * math.atan(tall * max(aspect, _PREVIEW))
        yield Viewpoint(name, pose_of(data.cam_xpos[camera], turn), fov)


def extent(stage: Stage, layout: RobotLayout) -> tuple[Array, Array]:
    """Lowest and highest coordinates (3,) of the visible parts of a robot, in its own frame, m.

    The stage is posed as in a snapshot with it. Both are zero if nothing of it can be seen.
    """
    corners = _corners(stage, layout)
    if not corners.size:
        return np.zeros(3), np.zeros(3)
    turn = stage.data.xmat[layout.base].reshape(3, 3)
    own = (corners - stage.data.xpos[layout.base]) @ turn
    return own.min(axis=0), own.max(axis=0)


def portrait_view(stage: Stage, layout: RobotLayout, width: int, height: int) -> View:
    """A view from ahead, above and the right, just far enough to see all of a robot.

    The stage is posed as in a snapshot with it; the picture has so many pixels.
    """
    corners = _corners(stage, layout)
    if not corners.size:
        corners = stage.data.xpos[layout.base] + 0.5 * _SIGNS
    turn = stage.data.xmat[layout.base].reshape(3, 3)
    towards = turn @ (np.array(FROM) / np.linalg.norm(FROM))
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    seen = looking(_point(middle + towards), _point(middle))
    apart = (corners - middle) @ seen.matrix()
    across = math.tan(PORTRAIT_FOV / 2.0)
    upward = across * height / width
    needed = np.maximum(np.abs(apart[:, 1]) / across, np.abs(apart[:, 2]) / upward)
    distance = max(CLOSEST, MARGIN * float((needed - apart[:, 0]).max()))
    pose = Pose(_point(middle + distance * towards), seen.quaternion)
    return View(pose, PORTRAIT_FOV, width, height)


def _corners(stage: Stage, layout: RobotLayout) -> Array:
    """Corners (n, 3) of the boxes around all visible geoms of a robot, in the world."""
    model, data = stage.model, stage.data
    visible = stage.visible()
    corners = []
    for geom in layout.geoms:
        if visible[geom]:
            turn = data.geom_xmat[geom].reshape(3, 3)
            middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
            corners.append(data.geom_xpos[geom] + (middle + _SIGNS * half) @ turn.T)
    return np.concatenate(corners) if corners else np.zeros((0, 3))


def _point(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
