"""Classes of avatars as plain values, and their file.

`worlds/avatars.toml` holds the shipped classes; an `avatars.toml` in a world folder adds some for
that world, or replaces shipped ones.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.errors import WorldError
from usarsim_server.simulation.frames import Vector
from usarsim_server.tables import read_toml
from usarsim_server.worlds.tables import Table

__all__ = ["FIGURES", "SHEET", "AvatarClass", "load_avatars"]

SHEET = "avatars.toml"
FIGURES = ("male", "female")

WALK, RUN = 1.3, 3.0
"""m/s: preferred walking speed of adults, and an unhurried run (starting value)."""


@dataclass(frozen=True, slots=True)
class AvatarClass:
    """One class of people.

    Attributes:
        name: as clients call it, without package. aliases: further names.
        figure: one of `FIGURES`.
        height: m.
        walk_speed, run_speed: m/s; backward people go at half the speed.
        skin, shirt, trousers, hair: colours.
    """

    name: str
    figure: str = "male"
    height: float = 1.7
    walk_speed: float = WALK
    run_speed: float = RUN
    skin: Vector = (0.87, 0.67, 0.52)
    shirt: Vector = (0.3, 0.4, 0.6)
    trousers: Vector = (0.2, 0.2, 0.25)
    hair: Vector = (0.2, 0.15, 0.1)
    aliases: tuple[str, ...] = ()


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


def _read(sheet: Path) -> list[AvatarClass]:
    table = Table(sheet, read_toml(sheet, WorldError, "avatar"))
    classes = [_avatar(entry) for entry in table.tables("avatar")]
    table.finish()
    return classes


def _avatar(table: Table) -> AvatarClass:
    usual = AvatarClass("")
    one = AvatarClass(
        name=table.word("name"),
        figure=table.choice("figure", FIGURES) if table.has("figure") else usual.figure,
        height=table.number("height", default=usual.height, low=0.5, high=2.5),
        walk_speed=table.number("walk_speed", default=usual.walk_speed, low=0.1, high=3.0),
        run_speed=table.number("run_speed", default=usual.run_speed, low=0.1, high=12.0),
        skin=_color(table, "skin", usual.skin),
        shirt=_color(table, "shirt", usual.shirt),
        trousers=_color(table, "trousers", usual.trousers),
        hair=_color(table, "hair", usual.hair),
        aliases=table.words("aliases", default=()),
    )
    table.finish()
    return one


def _color(table: Table, key: str, default: Vector) -> Vector:
    color = table.vector(key, default=default)
    if not all(0.0 <= channel <= 1.0 for channel in color):
        raise table.error(key, f"{color} is out of range", "write numbers from 0 to 1")
    return color
