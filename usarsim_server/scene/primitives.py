"""A compiled model as shapes, looks and lights that somebody else can draw (docs/scene-port.md).

The scenery is described once, every class of robots and things once as a `kind`, in the frames of
its bodies. Bodies that cannot move against each other count as one. What cannot be seen is left
out. Meshes and textures are assets whose names follow from what is in them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.looks import SMOKE_GREY
from usarsim_server.cameras.posed_model import Stage, lamp_place
from usarsim_server.cameras.shading import PLAIN, Paint
from usarsim_server.cameras.spectators import named_viewpoints
from usarsim_server.scene.assets import (
    TEXTURE_BYTES,
    Message,
    hfield,
    mesh,
    scalar,
    texture,
    vector,
)
from usarsim_server.simulation.frames import Pose, pose_of
from usarsim_server.simulation.model import SHELF_NAME, CompiledWorld
from usarsim_server.worlds.description import Smoke, WorldDescription
from usarsim_server.worlds.machinery.bodies import leaves_of
from usarsim_server.worlds.smoke import SmokeField

_SHAPES = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): ("plane", 2),
    int(mujoco.mjtGeom.mjGEOM_SPHERE): ("sphere", 1),
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): ("capsule", 2),
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): ("cylinder", 2),
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): ("ellipsoid", 3),
    int(mujoco.mjtGeom.mjGEOM_BOX): ("box", 3),
}
"""Name of a shape, and how many numbers its size has."""
_LIGHTS = {
    int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL): "directional",
    int(mujoco.mjtLightType.mjLIGHT_POINT): "point",
    int(mujoco.mjtLightType.mjLIGHT_SPOT): "spot",
}
_SLOT = re.compile(r"robot([0-9]+):")
_NO_ROTATION = (1, 0, 0, 0)


@dataclass(frozen=True, slots=True)
class Described:
    """A message with everything that has to be sent before it, by id."""

    message: Message
    assets: Mapping[str, Message]


@dataclass(slots=True)
class _Palette:
    """What the geoms of one message are painted with."""

    materials: dict[str, tuple[int, Message]] = field(default_factory=dict)
    assets: dict[str, Message] = field(default_factory=dict)
    bytes_left: int = TEXTURE_BYTES
    ids: dict[tuple[str, int], str] = field(default_factory=dict)
    """Of assets, by what they are and their number in the model."""

    def number(self, material: Message) -> int:
        """Number of a material in the list."""
        return self.materials.setdefault(repr(material), (len(self.materials), material))[0]

    def described(self, message: Message) -> Described:
        """The message with its materials."""
        message["materials"] = [material for _, material in self.materials.values()]
        return Described(message, self.assets)


class Primitives:
    """One model generation; used by one thread."""

    def __init__(self, world: CompiledWorld) -> None:
        """Look at a model; it is not changed."""
        self._world = world
        self._model = model = world.model
        names = [str(model.body(body).name) for body in range(model.nbody)]
        self._names = names
        self._slot = np.array([_slot_of(name, len(world.slots)) for name in names])
        self._visible = self._seen()

    @cached_property
    def _data(self) -> mujoco.MjData:
        data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        return data

    def _seen(self) -> NDArray[np.bool_]:
        model = self._model
        alpha = model.geom_rgba[:, 3].copy()
        painted = (model.geom_matid >= 0) & (model.geom_rgba == PLAIN).all(axis=1)
        alpha[painted] = model.mat_rgba[model.geom_matid[painted], 3]
        seen: NDArray[np.bool_] = (model.geom_group <= 2) & (alpha > 0.0)
        shelf = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, SHELF_NAME)
        if shelf >= 0:
            seen[shelf] = False
        return seen

    # -- bodies ------------------------------------------------------------------------------

    def moving(self) -> list[int]:
        """Bodies of the scenery that move and can be seen, in a fixed order."""
        return [body for body in self._roots(-1) if body != 0]

    def bodies(self, slot: int) -> list[int]:
        """Bodies of a slot that can be seen, its reference point first."""
        base = self._world.layouts[slot].base
        return [base, *(body for body in self._roots(slot) if body != base)]

    def _roots(self, slot: int) -> list[int]:
        """Bodies of a slot, -1 for the scenery, that carry visible geoms; welded ones are one."""
        owners = self._model.geom_bodyid[self._visible]
        own = owners[self._slot[owners] == slot]
        return [int(body) for body in np.unique(self._model.body_weldid[own])]

    def _geoms(self, root: int) -> list[int]:
        model = self._model
        fitting = self._visible & (model.body_weldid[model.geom_bodyid] == root)
        return [int(geom) for geom in np.flatnonzero(fitting)]

    # -- messages ----------------------------------------------------------------------------

    def scene(self, description: WorldDescription) -> Described:
        """The `scene` message: everything but robots and things of clients."""
        palette = _Palette()
        owners = _owners(description)
        still: dict[tuple[str, str], list[Message]] = {("world", ""): []}
        for geom in self._geoms(0):
            body = int(self._model.geom_bodyid[geom])
            if self._slot[body] < 0:
                whose = owners.get(self._names[body], ("world", ""))
                still.setdefault(whose, []).append(self._geom(geom, 0, palette))
        bodies = []
        for body in self.moving():
            name = self._names[body]
            what, whose_name = owners.get(name, ("body", name))
            geoms = [self._geom(geom, body, palette) for geom in self._geoms(body)]
            bodies.append({"what": what, "name": whose_name, "body": name, "geoms": geoms})
        message: Message = {
            "type": "scene",
            "world": description.level,
            "lower": vector(description.lower),
            "upper": vector(description.upper),
            "still": [{"what": a, "name": b, "geoms": geoms} for (a, b), geoms in still.items()],
            "bodies": bodies,
            "lights": self._lights(),
            **self._headlight(),
            **self._sky(),
            "views": self._views(description),
        }
        if not description.smoke.clear:
            message["smoke"] = _smoke(description.smoke)
        if description.zones:
            message["zones"] = [
                {
                    "name": one.name,
                    "kind": one.kind,
                    "x": list(one.x),
                    "y": list(one.y),
                    "corners": [list(corner) for corner in one.corners],
                }
                for one in description.zones
            ]
        return palette.described(message)

    def kind(self, slot: int) -> Described:
        """The `kind` message of what is in a slot."""
        palette = _Palette()
        layout, model = self._world.layouts[slot], self._world.slots[slot]
        prefix = f"robot{slot}:"
        bodies = [
            {
                "body": self._names[body].removeprefix(prefix),
                "geoms": [self._geom(geom, body, palette) for geom in self._geoms(body)],
            }
            for body in self.bodies(slot)
        ]
        message: Message = {"type": "kind", "id": model.key, "bodies": bodies}
        if model.robot:
            message["lamp"] = _placed(lamp_place(self._model, layout))
        return palette.described(message)

    # -- geoms -------------------------------------------------------------------------------

    def _geom(self, geom: int, root: int, palette: _Palette) -> Message:
        """A geom in the frame of a body; 0: in the world."""
        model, data = self._model, self._data
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, data.geom_xmat[geom])
        pose = pose_of(data.geom_xpos[geom], turn)
        if root:
            pose = pose_of(data.xpos[root], data.xquat[root]).inverse() @ pose
        kind = int(model.geom_type[geom])
        if kind in _SHAPES:
            shape, count = _SHAPES[kind]
            found: Message = {"shape": shape, "size": vector(model.geom_size[geom, :count])}
        else:
            make = hfield if kind == mujoco.mjtGeom.mjGEOM_HFIELD else mesh
            what = make.__name__, int(model.geom_dataid[geom])
            if what not in palette.ids:
                palette.ids[what], asset = make(model, what[1])
                palette.assets[palette.ids[what]] = asset
            found = {"shape": "mesh", "mesh": palette.ids[what]}
        return found | _placed(pose) | {"material": palette.number(self._material(geom, palette))}

    def _material(self, geom: int, palette: _Palette) -> Message:
        model = self._model
        number = int(model.geom_matid[geom])
        own = number < 0 or not np.array_equal(model.geom_rgba[geom], PLAIN)
        rgba = model.geom_rgba[geom] if own else model.mat_rgba[number]
        found: Message = {"rgba": vector(rgba, 3)}
        if number < 0:
            return found
        texture = _texture_of(model, number)
        if texture >= 0:
            found["texture"] = self._texture(texture, palette)
            found["repeat"] = vector(model.mat_texrepeat[number])
            found["uniform"] = bool(model.mat_texuniform[number])
        for key, absent in (
            ("emission", 0.0),
            ("specular", 0.5),
            ("shininess", 0.5),
            ("reflectance", 0.0),
            ("metallic", -1.0),
            ("roughness", -1.0),
        ):
            value = float(getattr(model, f"mat_{key}")[number])
            if value != absent and value >= 0.0:
                found[key] = scalar(value, 3)
        return found

    def _texture(self, number: int, palette: _Palette) -> str:
        what = "texture", number
        if what not in palette.ids:
            name, asset, size = texture(self._model, number, palette.bytes_left)
            palette.ids[what] = name
            if palette.assets.setdefault(name, asset) is asset:
                palette.bytes_left -= size
        return palette.ids[what]

    # -- light and air -----------------------------------------------------------------------

    def _lights(self) -> list[Message]:
        model, data, found = self._model, self._data, []
        for number in np.flatnonzero(model.light_active[: model.nlight]).tolist():
            body, kind = int(model.light_bodyid[number]), int(model.light_type[number])
            if model.body_weldid[body] != 0 or kind not in _LIGHTS:
                continue
            light: Message = {
                "type": _LIGHTS[kind],
                "pos": vector(data.light_xpos[number]),
                "dir": vector(data.light_xdir[number]),
                **{key: vector(getattr(model, f"light_{key}")[number], 3) for key in _COLORS},
                "attenuation": vector(model.light_attenuation[number]),
                "shadow": bool(model.light_castshadow[number]),
            }
            if _LIGHTS[kind] == "spot":
                light["cutoff"] = scalar(math.radians(float(model.light_cutoff[number])))
                light["exponent"] = scalar(float(model.light_exponent[number]))
            found.append(light)
        return found

    def _headlight(self) -> Message:
        head = self._model.vis.headlight
        if not head.active:
            return {}
        return {"headlight": {key: vector(getattr(head, key), 3) for key in _COLORS}}

    def _sky(self) -> Message:
        types = self._model.tex_type[: self._model.ntex]
        if not (types == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX)).any():
            return {}
        paint, colors = Paint(self._model), []
        around = np.linspace(0.0, math.tau, 16, endpoint=False)
        for height in np.linspace(math.pi / 2, -math.pi / 2, 9):
            level = math.cos(height) + 1e-6
            ways = np.stack([level * np.cos(around), level * np.sin(around)], axis=1)
            up = np.full((len(around), 1), math.sin(height))
            seen = paint.sky(np.hstack([ways, up]).astype(np.float32))
            colors.append(vector(seen.mean(axis=0), 3))
        return {"sky": colors}

    def _views(self, description: WorldDescription) -> list[Message]:
        views = named_viewpoints(Stage(self._world), description).values()
        return [
            {"name": view.name, **_placed(view.pose), "fov": scalar(view.fov)} for view in views
        ]


_COLORS = ("diffuse", "ambient", "specular")


def _owners(description: WorldDescription) -> dict[str, tuple[str, str]]:
    """What a body of the scenery is a part of, by its name."""
    machinery = description.machinery
    found = {leaf.body: ("door", door.name) for door in machinery.doors for leaf in leaves_of(door)}
    found |= {lift.name: ("lift", lift.name) for lift in machinery.lifts}
    found |= {one.name: ("obstacle", one.name) for one in machinery.obstacles}
    for victim in description.victims:
        whose = ("victim", victim.name)
        found |= {f"victim:{victim.name}{part}": whose for part in ("", "/forearm")}
    return found


def _slot_of(name: str, slots: int) -> int:
    """Number of the slot that a body belongs to; -1 for the scenery."""
    found = _SLOT.match(name)
    return int(found[1]) if found is not None and int(found[1]) < slots else -1


def _texture_of(model: mujoco.MjModel, material: int) -> int:
    roles = model.mat_texid[material]
    texture = int(roles[mujoco.mjtTextureRole.mjTEXROLE_RGB])
    return texture if texture >= 0 else int(roles[mujoco.mjtTextureRole.mjTEXROLE_RGBA])


def _smoke(smoke: Smoke) -> Message:
    found: Message = {"color": list(SMOKE_GREY)}
    if smoke.haze:
        top = {} if math.isinf(smoke.haze_top) else {"top": scalar(smoke.haze_top)}
        found["haze"] = {"density": smoke.haze, **top}
    found["volumes"] = [
        {
            "name": one.name,
            "shape": one.shape,
            **_placed(one.pose),
            "size": vector(one.size),
            "density": one.density,
        }
        for one in smoke.volumes
    ]
    found["clouds"] = [
        {
            "name": puff.name,
            "pos": vector(puff.position),
            "size": vector(puff.size),
            "radius": puff.radius,
            "lifetime": puff.lifetime,
            **{key: values.round(4).tolist() for key, values in balls.items()},
        }
        for puff, balls in zip(smoke.puffs, SmokeField(smoke).balls(), strict=True)
    ]
    return found


def _placed(pose: Pose) -> Message:
    found: Message = {}
    position, quaternion = vector(pose.position), vector(pose.quaternion)
    if any(position):
        found["pos"] = position
    if tuple(quaternion) != _NO_ROTATION:
        found["quat"] = quaternion
    return found
