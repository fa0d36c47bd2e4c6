"""Small maps in T3D, written by hand and by functions; no data of others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mesh_samples import read, write

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Scene

Triple = tuple[float, float, float]

SCALE = 250.0


def cuboid(low: Triple, high: Triple) -> list[list[Triple]]:
    """Six faces in Unreal coordinates whose ordinary cross products point outwards."""
    (a, b, c), (d, e, f) = low, high
    return [
        [(a, b, c), (a, b, f), (a, e, f), (a, e, c)],
        [(d, b, c), (d, e, c), (d, e, f), (d, b, f)],
        [(a, b, c), (d, b, c), (d, b, f), (a, b, f)],
        [(a, e, c), (a, e, f), (d, e, f), (d, e, c)],
        [(a, b, c), (a, e, c), (d, e, c), (d, b, c)],
        [(a, b, f), (d, b, f), (d, e, f), (a, e, f)],
    ]


def polygon(points: Sequence[Triple], texture: str = "Pkg.Wall", extra: str = "") -> str:
    """One polygon."""
    lines = [f"Begin Polygon Texture={texture} Flags=3584 Link=0"]
    lines += [extra] if extra else []
    lines += ["TextureU +00001.000000,+00000.000000,+00000.000000"]
    lines += ["TextureV +00000.000000,+00001.000000,+00000.000000"]
    lines += [f"Vertex   {x:+013.6f},{y:+013.6f},{z:+013.6f}" for x, y, z in points]
    return "\n".join([*lines, "End Polygon"])


def brush(
    name: str,
    low: Triple,
    high: Triple,
    operation: str = "CSG_Add",
    properties: str = "",
    kind: str = "Brush",
    faces: Sequence[Sequence[Triple]] | None = None,
) -> str:
    """A brush actor as UE3 writes it, the empty PolyList at actor level included."""
    polygons = "\n".join(polygon(face) for face in (faces or cuboid(low, high)))
    oper = f"CsgOper={operation}\n" if operation else ""
    return (
        f"Begin Actor Class={kind} Name={name}\nBegin PolyList\nEnd PolyList\n"
        f"Begin Brush Name=Model_{name}\nBegin PolyList\n{polygons}\nEnd PolyList\nEnd Brush\n"
        f'{oper}{properties}Tag="{kind}"\nName="{name}"\nEnd Actor'
    )


def actor(kind: str, name: str, location: Triple = (0, 0, 0), properties: str = "") -> str:
    """Any actor."""
    x, y, z = location
    return (
        f"Begin Actor Class={kind} Name={name}\nLocation=(X={x},Y={y},Z={z})\n{properties}\n"
        f'Name="{name}"\nEnd Actor'
    )


def start(name: str, location: Triple, tag: str = "PlayerStart", yaw: int = 0) -> str:
    """A start pose."""
    return actor("PlayerStart", name, location, f'Rotation=(Pitch=0,Yaw={yaw},Roll=0)\nTag="{tag}"')


def level(*actors: str) -> str:
    """A whole file."""
    inside = "\n".join(actors)
    return f"Begin Map\nBegin Level Name=PersistentLevel\n{inside}\nEnd Level\nEnd Map\n"


def read_level(
    folder: Path, text: str, findings: Findings | None = None, **options: object
) -> Scene:
    """The scene in a text."""
    return read(write(folder, text, "map.t3d"), findings, **options)


def room(width: float = 1000.0, height: float = 750.0) -> str:
    """A closed room, 4 m square and 3 m high, floor at 0, cut out of the solid."""
    half = width / 2.0
    return brush("Room", (-half, -half, 0.0), (half, half, height), "CSG_Subtract")


def two_rooms() -> str:
    """Two rooms of 4 m with a doorway of 1 m in the wall between them; starts in both."""
    return level(
        brush("A", (-500, -500, 0), (500, 500, 625), "CSG_Subtract"),
        brush("B", (550, -500, 0), (1550, 500, 625), "CSG_Subtract"),
        brush("Door", (490, -125, 0), (560, 125, 500), "CSG_Subtract"),
        start("PlayerStart_0", (0, 0, 60), "Entry"),
        start("PlayerStart_1", (0, 375, 60)),
    )


def corner() -> str:
    """An L-shaped block with an asymmetric tower on a floor: shows mirroring."""
    return level(
        brush("Floor", (-1000, -1000, -50), (1000, 1000, 0)),
        brush("Long", (0, 0, 0), (750, 100, 250)),
        brush("Short", (0, 100, 0), (100, 400, 250)),
        brush("Tower", (500, -250, 0), (600, -100, 500)),
        start("PlayerStart_0", (-500, -500, 60)),
    )
