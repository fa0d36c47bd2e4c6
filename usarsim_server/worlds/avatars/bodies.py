"""Classes of avatars as plain values, and their file.

`worlds/avatars.toml` holds the shipped classes; an `avatars.toml` in a world folder adds some for
that world, or replaces shipped ones.

The body of an avatar: nine pieces that are placed, trunk first, each with its origin in a joint.

Lengths are those of an adult of 1.70 m and grow with the class's height.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import mujoco

from usarsim_server.base.errors import WorldError
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import read_toml
from usarsim_server.simulation.frames import Vector
from usarsim_server.simulation.model import RobotModel

SHEET = "avatars.toml"

WALK, RUN = 1.3, 3.0
"""m/s: preferred walking speed of adults, and an unhurried run (starting value)."""


@dataclass(frozen=True, slots=True)
class AvatarClass:
    """One class of people; backward they go at half the speed."""

    name: str = field(
        parse=Table.word, expects="a name", help="as clients call it, without package"
    )
    figure: str = field(default="male", choices=("male", "female"), help="of the body")
    height: float = field(default=1.7, unit="m", low=0.5, high=2.5, help="of the whole body")
    walk_speed: float = field(default=WALK, unit="m/s", low=0.1, high=3.0, help="of Walk_Forward")
    run_speed: float = field(default=RUN, unit="m/s", low=0.1, high=12.0, help="of Run")
    skin: Vector = field(default=(0.87, 0.67, 0.52), low=0.0, high=1.0, help="red, green, blue")
    shirt: Vector = field(default=(0.3, 0.4, 0.6), low=0.0, high=1.0, help="likewise")
    trousers: Vector = field(default=(0.2, 0.2, 0.25), low=0.0, high=1.0, help="likewise")
    hair: Vector = field(default=(0.2, 0.15, 0.1), low=0.0, high=1.0, help="likewise")
    aliases: tuple[str, ...] = field(
        default=(), parse=Table.words, expects="a list of names", help="further names"
    )


def load_avatars(sheets: Iterable[Path]) -> dict[str, AvatarClass]:
    """Read the files that exist; all classes by all their names in lower case.

    A class of a later file replaces one of the same name of an earlier file.

    Raises:
        WorldError: naming file, key, what is wrong and what to write instead.
    """
    found: dict[str, AvatarClass] = {}
    for sheet in sheets:
        if os.path.lexists(sheet):
            for one in _read(sheet):
                found |= {name.lower(): one for name in (one.name, *one.aliases)}
    return found


def _read(sheet: Path) -> tuple[AvatarClass, ...]:
    table = Table(read_toml(sheet, WorldError, "avatar"), sheet, WorldError)
    classes = table.all("avatar", AvatarClass)
    table.finish()
    return classes


ADULT = 1.70
"""m: height that the lengths below belong to."""

PELVIS = 0.93
"""m above the ground: the reference point, as of a standing victim."""

CHEST, HEAD = 0.28, 0.65
"""m above the pelvis: middles of chest and head."""

THIGH, SHIN, SOLE = 0.43, 0.41, 0.06
"""m; with the height of the hip below the pelvis they add up to `PELVIS`."""
UPPER_ARM, FOREARM = 0.28, 0.25

LIMBS = (
    "thigh_left",
    "shin_left",
    "thigh_right",
    "shin_right",
    "upper_arm_left",
    "forearm_left",
    "upper_arm_right",
    "forearm_right",
)
"""The bodies beside the trunk; every second one hangs on the one before it."""

_HIP: Vector = (0.0, 0.09, -0.03)
_SHOULDER: Vector = (0.0, 0.22, 0.425)

SOFT_SOLREF = (0.1, 1.0)
"""A person gives way: five times as slow as stiff things push out what they overlap, so that a
robot that is caught between a person and a wall is not shot out."""
FRICTION = (0.5, 0.005, 0.0001)


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """One body being filled with geoms; lengths of an adult come in and are scaled."""

    body: mujoco.MjsBody
    scale: float

    def limb(self, start: Vector, end: Vector, radius: float, color: Vector) -> None:
        self._add(
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            [radius * self.scale, 0.0, 0.0],
            color,
            fromto=[self.scale * value for value in (*start, *end)],
        )

    def egg(self, center: Vector, axes: Vector, color: Vector) -> None:
        self._add(
            mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            [self.scale * value for value in axes],
            color,
            pos=[self.scale * value for value in center],
        )

    def _add(self, kind: int, size: list[float], color: Vector, **place: list[float]) -> None:
        self.body.add_geom(
            type=kind,
            size=size,
            rgba=[*color, 1.0],
            friction=FRICTION,
            solref=SOFT_SOLREF,
            # Decides alone how a contact behaves, however stiff the other side is.
            priority=1,
            **place,
        )


def joint_of(limb: str, height: float) -> Vector:
    """Where a limb hangs (m), in the frame of what it hangs on at rest.

    Raises:
        KeyError: if there is no such limb.
    """
    scale = height / ADULT
    side = 1.0 if limb.endswith("_left") else -1.0
    x, y, z = {
        "thigh": _HIP,
        "shin": (0.0, 0.0, -THIGH),
        "upper_arm": _SHOULDER,
        "forearm": (0.0, 0.0, -UPPER_ARM),
    }[limb.rpartition("_")[0]]
    return scale * x, scale * y * side, scale * z


def avatar_model(kind: AvatarClass) -> RobotModel:
    """The body of a class of avatars as the simulation wants it; limbs hang straight down."""
    return RobotModel(
        key=f"avatar:{kind.name}",
        build=_builder(kind),
        driven=(),
        rest_height=PELVIS * kind.height / ADULT,
        kinematic=True,
        robot=False,
    )


def _builder(kind: AvatarClass) -> Callable[[], mujoco.MjSpec]:
    def build() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        scale = kind.height / ADULT
        _fill_trunk(_Piece(spec.worldbody.add_body(name="base", mocap=True), scale), kind)
        above: Vector = (0.0, 0.0, 0.0)
        for limb in LIMBS:
            x, y, z = joint_of(limb, kind.height)
            if limb.startswith(("thigh", "upper")):
                above = (0.0, 0.0, 0.0)
            above = (above[0] + x, above[1] + y, above[2] + z)
            piece = _Piece(spec.worldbody.add_body(name=limb, mocap=True, pos=above), scale)
            _FILL[limb.rpartition("_")[0]](piece, kind)
        return spec

    return build


def _fill_trunk(piece: _Piece, kind: AvatarClass) -> None:
    width = 0.88 if kind.figure == "female" else 1.0
    piece.egg((0.0, 0.0, 0.0), (0.115, 0.165, 0.12), kind.trousers)
    piece.egg((0.0, 0.0, 0.12), (0.105, 0.15 * width, 0.17), kind.shirt)
    piece.egg((0.0, 0.0, CHEST), (0.118, 0.175 * width, 0.20), kind.shirt)
    across = 0.16 * width
    piece.limb((0.0, across, 0.425), (0.0, -across, 0.425), 0.058, kind.shirt)
    piece.limb((0.0, 0.0, 0.46), (0.0, 0.0, 0.58), 0.048, kind.skin)
    piece.egg((0.0, 0.0, HEAD), (0.093, 0.077, 0.118), kind.skin)
    piece.egg((-0.016, 0.0, 0.678), (0.095, 0.084, 0.105), kind.hair)
    if kind.figure == "female":
        piece.egg((-0.05, 0.0, 0.58), (0.06, 0.085, 0.13), kind.hair)


def _fill_thigh(piece: _Piece, kind: AvatarClass) -> None:
    piece.limb((0.0, 0.0, 0.0), (0.0, 0.0, -THIGH), 0.076, kind.trousers)


def _fill_shin(piece: _Piece, kind: AvatarClass) -> None:
    piece.limb((0.0, 0.0, 0.0), (0.0, 0.0, -SHIN), 0.055, kind.trousers)
    sole = -SHIN - SOLE + 0.04
    piece.limb((-0.04, 0.0, sole), (0.15, 0.0, sole), 0.04, (0.12, 0.11, 0.11))


def _fill_upper_arm(piece: _Piece, kind: AvatarClass) -> None:
    piece.limb((0.0, 0.0, 0.0), (0.0, 0.0, -UPPER_ARM), 0.05, kind.shirt)


def _fill_forearm(piece: _Piece, kind: AvatarClass) -> None:
    piece.limb((0.0, 0.0, 0.0), (0.0, 0.0, -FOREARM), 0.038, kind.skin)
    piece.egg((0.0, 0.0, -FOREARM - 0.07), (0.042, 0.022, 0.085), kind.skin)


_FILL: dict[str, Callable[[_Piece, AvatarClass], None]] = {
    "thigh": _fill_thigh,
    "shin": _fill_shin,
    "upper_arm": _fill_upper_arm,
    "forearm": _fill_forearm,
}
