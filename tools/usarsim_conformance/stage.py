"""What stands on the kit's own stage, the world in the folder beside this file.

`--self` takes it, and every server that can load such a world may. It lies 400 m behind the start
poses, so that it is in the way of no other check.
"""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from usarsim_conformance.case import Case
from usarsim_conformance.registry import NotApplicable

FOLDER = Path(__file__).with_name("stage")
"""Holds the world and the robots that are brought along."""

Point = tuple[float, float, float]


def need_stage(case: Case, what: str) -> None:
    """Go on only if the server runs the stage, whose level its greeting tells.

    Args:
        case: of the check.
        what: what the check needs, for the reason.

    Raises:
        NotApplicable: if it runs another world.
    """
    greeting = case.survey.greeting
    level = greeting.get("Level") if greeting is not None else None
    if level != facts()["level"]:
        raise NotApplicable(
            f"not judged: the level is {level}, and not {facts()['level']}, the kit's own world, "
            f"which has {what}"
        )


@cache
def facts() -> dict[str, Any]:
    """The world file of the stage; frame and units of world files (z up, degrees)."""
    return tomllib.loads((FOLDER / "world" / "world.toml").read_text(encoding="utf-8"))


def one_of(kind: str, name: str) -> dict[str, Any]:
    """The table of a kind, such as `door`, that has a name or tag."""
    return next(one for one in facts()[kind] if name in (one.get("name"), one.get("tag")))


def spot(kind: str, name: str) -> Point:
    """Where a thing of the world file is, m, frame of the wire."""
    x, y, z = one_of(kind, name)["position"]
    return x, -y, -z


@cache
def boxes(prefix: str) -> tuple[tuple[Point, Point], ...]:
    """Middle (m, frame of the wire) and full size (m, own axes) of the scene's boxes, by the
    beginning of their names, in their order."""
    scene = ElementTree.parse(FOLDER / "world" / "scene.xml")
    found = []
    for geom in scene.iter("geom"):
        if geom.get("type") == "box" and geom.get("name", "").startswith(prefix):
            x, y, z = map(float, geom.get("pos", "").split())
            a, b, c = (2.0 * float(half) for half in geom.get("size", "").split())
            found.append(((x, -y, -z), (a, b, c)))
    return tuple(found)
