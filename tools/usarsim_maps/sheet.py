"""Writes `world.toml`: the facts of an imported world.

Names that MuJoCo and the wire can carry, made from names that maps have.

A look into the finished scene: where floors are, what is blocked, how large it all is.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from usarsim_server.errors import MapImportError, at
from usarsim_server.simulation.frames import Pose, Vector, rpy_from_quaternion
from usarsim_server.worlds.description import Smoke

Entry = Mapping[str, object]
"""Keys and values of one table; None values are left out."""


def write_sheet(
    head: Entry, single: Mapping[str, Entry], lists: Mapping[str, Sequence[Entry]]
) -> str:
    """TOML text.

    Args:
        head: keys at the top.
        single: tables by name, `[name]`.
        lists: lists of tables by name, `[[name]]`.
    """
    blocks = ["# Made by `usarsim import`; import again rather than edit, or keep a sidecar file."]
    blocks.append("\n".join(_lines(head)))
    for name, entry in single.items():
        blocks.append("\n".join([f"[{name}]", *_lines(entry)]))
    for name, entries in lists.items():
        for entry in entries:
            blocks.append("\n".join([f"[[{name}]]", *_lines(entry)]))
    return "\n\n".join(blocks) + "\n"


def rotation(pose: Pose) -> dict[str, object]:
    """`yaw_degrees`, or `rotation_degrees` where a pose is not upright."""
    roll, pitch, yaw = (math.degrees(angle) for angle in rpy_from_quaternion(pose.quaternion))
    if abs(roll) < 1e-9 and abs(pitch) < 1e-9:
        return {"yaw_degrees": round(yaw, 9) + 0.0}
    return {"rotation_degrees": [round(angle, 9) + 0.0 for angle in (roll, pitch, yaw)]}


def smoke_tables(smoke: Smoke) -> list[Entry]:
    """`[[smoke]]` tables."""
    tables: list[Entry] = []
    for volume in smoke.volumes:
        _, _, yaw = rpy_from_quaternion(volume.pose.quaternion)
        tables.append(
            {
                "name": volume.name,
                "kind": "regional",
                "shape": volume.shape,
                "position": list(volume.pose.position),
                "yaw_degrees": math.degrees(yaw),
                "size": list(volume.size),
                "density": volume.density,
            }
        )
    for puff in smoke.puffs:
        tables.append(
            {
                "name": puff.name,
                "kind": "local",
                "position": list(puff.position),
                "size": list(puff.size),
                "particles": puff.particles,
                "radius": puff.radius,
                "seed": puff.seed,
                "lifetime": puff.lifetime,
            }
        )
    if smoke.haze:
        top = smoke.haze_top if math.isfinite(smoke.haze_top) else None
        tables.append({"name": "haze", "kind": "global", "density": smoke.haze, "top": top})
    return tables


def _lines(entry: Entry) -> Iterable[str]:
    for key, value in entry.items():
        if value is not None:
            yield f"{key} = {_value(value)}"


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # A JSON string is a TOML basic string, but for DEL, which JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, float):
        text = repr(round(value, 9) + 0.0)
        return text if text not in ("inf", "-inf", "nan") else "0.0"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, Mapping):
        inner = ", ".join(
            f"{json.dumps(str(k))} = {_value(v)}" for k, v in value.items() if v is not None
        )
        return "{ " + inner + " }" if inner else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    raise TypeError(f"{value!r} has no place in a world file")


_UNSAFE = re.compile(r"[^A-Za-z0-9_.+\-]+")

LONGEST = 120


def safe(name: str) -> str:
    """A name of letters, digits and `_ . + -` only; `unnamed` if nothing is left."""
    return _UNSAFE.sub("_", name.strip()).strip("_")[:LONGEST] or "unnamed"


class NameBook:
    """Hands out names that differ, whatever their capitals (item 69)."""

    def __init__(self, *reserved: str) -> None:
        self._taken = {name.lower() for name in reserved}
        self._next: dict[str, int] = {}

    def take(self, name: str) -> str:
        """The safe form of a name, with `-2`, `-3`, ... behind it where it is taken."""
        plain = safe(name)
        answer, number = plain, self._next.get(plain.lower(), 2)
        while answer.lower() in self._taken:
            answer = f"{plain}-{number}"
            number += 1
        self._next[plain.lower()] = number
        self._taken.add(answer.lower())
        return answer


_MEBI = 1 << 20
BALL = "probe:ball"
"""Geom and body of the ball with which free space is looked for."""
NUDGE = np.array([1e-3, 0.7e-3, 0.4e-3])
"""m: a ball whose centre is exactly that of a box counts as not touching it (MuJoCo 3.17)."""


class Probe:
    """The compiled scenery of a world folder, movable things where the map has them.

    Attributes:
        model: compiled.
        seconds: not timed here; compile once and ask many things.
    """

    def __init__(self, scene: Path, source: Path) -> None:
        """Compile.

        Raises:
            MapImportError: MuJoCo refuses the scene.
        """
        try:
            spec = mujoco.MjSpec.from_file(str(scene))
            ball = spec.worldbody.add_body(name=BALL, pos=[0.0, 0.0, 1e4])
            ball.add_freejoint()  # what cannot move does not touch what cannot move
            ball.add_geom(name=BALL, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0])
            self.model: mujoco.MjModel = spec.compile()
        except ValueError as error:
            text = " ".join(str(error).split()).removeprefix("Error: ")
            cure = "report this map; --sidecar can exclude the object that is named"
            raise MapImportError(at(source, f"MuJoCo refuses the result: {text}", cure)) from error
        model = self.model
        self._data = mujoco.MjData(model)
        mujoco.mj_forward(model, self._data)
        self._ball_geom = model.geom(BALL).id
        self._rays: mujoco.MjModel = model.__copy__()
        hollow = (model.geom_contype | model.geom_conaffinity) == 0
        hollow[self._ball_geom] = True
        self._rays.geom_rgba[hollow, 3] = 0.0
        self._rays.geom_matid[hollow] = -1

    @property
    def memory(self) -> float:
        """MiB of the compiled model."""
        return float(self.model.nbuffer) / _MEBI

    @property
    def has_ground(self) -> bool:
        """Whether anything solid is fixed in the world (worlds reference 11)."""
        model = self.model
        solid = (model.geom_contype | model.geom_conaffinity) != 0
        return bool((solid & (model.body_weldid[model.geom_bodyid] == 0)).any())

    def way(self, start: Vector, direction: Vector) -> float:
        """m to the next solid surface in a direction; inf if there is none."""
        geom = np.zeros(1, dtype=np.int32)
        way = mujoco.mj_ray(
            self._rays,
            self._data,
            np.array(start),
            np.array(direction),
            None,
            1,
            -1,
            geom,
            None,
        )
        return float(way) if geom[0] >= 0 else math.inf

    def height(self, point: Vector) -> float:
        """m from a point down to the floor; inf if there is none."""
        return self.way(point, (0.0, 0.0, -1.0))

    def headroom(self, point: Vector) -> float:
        """m from a point up to the ceiling."""
        return self.way(point, (0.0, 0.0, 1.0))

    def overlap(self, point: Vector, radius: float = 0.1) -> float:
        """m by which a ball at a point would be inside something solid; 0 if it is free."""
        data, model, geom = self._data, self.model, self._ball_geom
        body = model.body(BALL).id
        place = int(model.joint(model.body_jntadr[body]).qposadr[0])
        model.geom_size[geom, 0] = model.geom_rbound[geom] = radius
        model.geom_aabb[geom, 3:] = model.bvh_aabb[model.body_bvhadr[body], 3:] = radius
        data.qpos[place : place + 3] = np.array(point) + NUDGE
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        own = (data.contact.geom == geom).any(axis=1)
        return max(0.0, -float(data.contact.dist[own].min())) if own.any() else 0.0
