"""Maps that the import measurement writes itself, so that it needs no files of others.

`write_hall` makes a hall such as competitions had: Unreal text with brushes, and static meshes
beside it. `write_yard` makes one COLLADA file of many triangles, as modelling programs export
whole sites.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

Triple = tuple[float, float, float]

SCALE = 250.0
"""Unreal units per metre in USARSim maps (worlds reference 2)."""

BRUSHES, MESHES = 50, 100
"""Of the hall: what a competition map was made of (worlds reference 11)."""

YARD_TRIANGLES = 52_000

_BAYS = 6
"""Rooms along each side of the hall's corridor."""
_BAY, _DEPTH, _HEIGHT, _WALL = 4.0, 5.0, 3.0, 0.16
"""m: a room, and the wall between rooms."""
_CORRIDOR = 2.4
_DOOR = 1.2


@dataclass(slots=True)
class Shape:
    """Triangles with shared vertices, metres, z up; faces look outwards."""

    vertices: list[Triple] = field(default_factory=list)  # corners
    triangles: list[tuple[int, int, int]] = field(default_factory=list)  # indices

    def prism(self, ring: Sequence[tuple[float, float]], low: float, high: float) -> None:
        """Add an upright prism over a convex anticlockwise ring of x, y."""
        base, n = len(self.vertices), len(ring)
        for z in (low, high):
            self.vertices += [(x, y, z) for x, y in ring]
        for k in range(n):
            a, b = base + k, base + (k + 1) % n
            self.triangles += [(a, b, b + n), (a, b + n, a + n)]
        for k in range(1, n - 1):
            self.triangles += [(base, base + k + 1, base + k)]
            self.triangles += [(base + n, base + n + k, base + n + k + 1)]

    def box(self, low: Triple, high: Triple) -> None:
        """Add a box."""
        (a, b, c), (d, e, f) = low, high
        self.prism([(a, b), (d, b), (d, e), (a, e)], c, f)

    def drum(self, x: float, y: float, low: float, high: float, radius: float, sides: int) -> None:
        """Add a standing cylinder."""
        angles = [math.tau * k / sides for k in range(sides)]
        ring = [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles]
        self.prism(ring, low, high)

    def sheet(self, x: Sequence[float], y: Sequence[float], heights: Sequence[float]) -> None:
        """Add a surface over a grid that looks up; heights by rows of equal y."""
        base, columns = len(self.vertices), len(x)
        self.vertices += [
            (u, v, heights[row * columns + column])
            for row, v in enumerate(y)
            for column, u in enumerate(x)
        ]
        for row in range(len(y) - 1):
            for column in range(columns - 1):
                a = base + row * columns + column
                b, c, d = a + 1, a + columns + 1, a + columns
                self.triangles += [(a, b, c), (a, c, d)]


# ---- the hall --------------------------------------------------------------------------------


def write_hall(folder: Path) -> tuple[Path, Path]:
    """Write the hall.

    Returns:
        The T3D file, and the folder of the meshes that it names.
    """
    assets = folder / "StaticMeshes"
    assets.mkdir(parents=True)
    furniture = _furniture()
    for name, shape in furniture.items():
        _write_obj(assets / f"{name}.obj", shape)
    actors = [*_hall_brushes(), *_hall_meshes(sorted(furniture)), *_hall_starts()]
    source = folder / "hall.t3d"
    inside = "\n".join(actors)
    source.write_text(
        f"Begin Map\nBegin Level Name=PersistentLevel\n{inside}\nEnd Level\nEnd Map\n",
        encoding="utf-8",
    )
    return source, assets


def _hall_brushes() -> list[str]:
    """A corridor, rooms on both sides, doorways, and then posts until there are enough."""
    length = _BAYS * _BAY
    half = _CORRIDOR / 2.0
    found = [_brush("Corridor", (0, -half, 0), (length, half, _HEIGHT), "Subtract")]
    for bay in range(_BAYS):
        low, high = bay * _BAY + _WALL / 2.0, (bay + 1) * _BAY - _WALL / 2.0
        middle = (low + high) / 2.0
        for side in (-1, 1):
            name = f"{bay}{'L' if side > 0 else 'R'}"
            near, far = side * (half + _WALL), side * (half + _WALL + _DEPTH)
            span = sorted((near, far))
            found.append(
                _brush(f"Room{name}", (low, span[0], 0), (high, span[1], _HEIGHT), "Subtract")
            )
            gap = sorted((side * (half - 0.1), near + side * 0.1))
            door = (middle - _DOOR / 2, gap[0], 0), (middle + _DOOR / 2, gap[1], 2.2)
            found.append(_brush(f"Door{name}", *door, "Subtract"))
    number = 0
    while len(found) < BRUSHES:
        bay, rest = divmod(number % (4 * _BAYS), 4)
        x = bay * _BAY + (0.6 if rest % 2 else _BAY - 0.8)
        y = (1 if rest < 2 else -1) * (half + _WALL + _DEPTH - 0.9)
        found.append(_brush(f"Post{number}", (x, y, 0), (x + 0.2, y + 0.25, _HEIGHT), "Add"))
        number += 1
    return found


def _hall_meshes(kinds: Sequence[str]) -> Iterable[str]:
    """Furniture in the rooms, each piece turned and placed at random, the doors kept free."""
    dice = random.Random(12)
    for number in range(MESHES):
        bay, side = divmod(number % (2 * _BAYS), 2)
        x = (bay + dice.uniform(0.2, 0.8)) * _BAY
        depth = dice.uniform(1.8, _DEPTH - 1.0)
        y = (1 if side else -1) * (_CORRIDOR / 2.0 + _WALL + depth)
        kind = kinds[number % len(kinds)]
        yield (
            f"Begin Actor Class=StaticMeshActor Name=StaticMeshActor_{number}\n"
            f"Begin Object Class=StaticMeshComponent Name=StaticMeshComponent0\n"
            f"StaticMesh=StaticMesh'Bench.Furniture.{kind}'\nEnd Object\n"
            f"Location=({_xyz((x, y, 0.0))})\n"
            f"Rotation=(Pitch=0,Yaw={dice.randrange(65536)},Roll=0)\n"
            f'Name="StaticMeshActor_{number}"\nEnd Actor'
        )


def _hall_starts() -> Iterable[str]:
    for number in range(4):
        place = ((number + 1.0) * _BAY, 0.0, 0.3)
        yield (
            f"Begin Actor Class=PlayerStart Name=PlayerStart_{number}\n"
            f"Location=({_xyz(place)})\nRotation=(Pitch=0,Yaw=0,Roll=0)\n"
            f'Name="PlayerStart_{number}"\nEnd Actor'
        )


def _furniture() -> dict[str, Shape]:
    """Ten kinds of furniture and debris."""
    found = {name: Shape() for name in _KINDS}
    found["Table"].box((-0.7, -0.4, 0.7), (0.7, 0.4, 0.74))
    for x in (-0.65, 0.6):
        for y in (-0.35, 0.3):
            found["Table"].box((x, y, 0.0), (x + 0.05, y + 0.05, 0.7))
            found["Chair"].box((x * 0.35, y * 0.6, 0), (x * 0.35 + 0.04, y * 0.6 + 0.04, 0.45))
    found["Chair"].box((-0.24, -0.22, 0.45), (0.26, 0.24, 0.5))
    found["Chair"].box((-0.24, 0.18, 0.5), (0.26, 0.24, 0.95))
    found["Crate"].box((-0.4, -0.4, 0.0), (0.4, 0.4, 0.8))
    found["Barrel"].drum(0.0, 0.0, 0.0, 0.9, 0.3, 24)
    found["Bin"].drum(0.0, 0.0, 0.0, 0.35, 0.15, 16)
    for level in range(5):
        found["Shelf"].box((-0.5, -0.15, 0.45 * level), (0.5, 0.15, 0.45 * level + 0.03))
    for x in (-0.53, 0.5):
        found["Shelf"].box((x, -0.15, 0.0), (x + 0.03, 0.15, 1.9))
    for step in range(4):
        found["Steps"].box((-0.4, 0.25 * step, 0.0), (0.4, 0.25 * step + 0.25, 0.12 * (step + 1)))
    for x in (-0.75, 0.72):
        found["Bed"].box((x, -0.4, 0.0), (x + 0.03, 0.4, 0.5))
    found["Bed"].box((-0.72, -0.4, 0.25), (0.72, 0.4, 0.4))
    found["Pipe"].drum(0.0, 0.0, 0.0, 2.5, 0.08, 20)
    dice = random.Random(3)
    grid = [-0.6 + 0.1 * k for k in range(13)]
    heap = [
        max(0.0, 0.35 - math.hypot(x, y) * 0.6) * dice.uniform(0.5, 1.0) for y in grid for x in grid
    ]
    found["Rubble"].sheet(grid, grid, heap)
    return found


_KINDS = (
    *("Table", "Chair", "Crate", "Barrel", "Bin"),
    *("Shelf", "Steps", "Bed", "Pipe", "Rubble"),
)


def _brush(name: str, low: Triple, high: Triple, operation: str) -> str:
    a, b, c = (value * SCALE for value in low)
    d, e, f = (value * SCALE for value in high)
    faces = (
        ((a, b, c), (a, b, f), (a, e, f), (a, e, c)),
        ((d, b, c), (d, e, c), (d, e, f), (d, b, f)),
        ((a, b, c), (d, b, c), (d, b, f), (a, b, f)),
        ((a, e, c), (a, e, f), (d, e, f), (d, e, c)),
        ((a, b, c), (a, e, c), (d, e, c), (d, b, c)),
        ((a, b, f), (d, b, f), (d, e, f), (a, e, f)),
    )
    polygons = "\n".join(
        "\n".join(
            [
                "Begin Polygon Texture=Bench.Wall",
                *(f"Vertex {x:+.6f},{y:+.6f},{z:+.6f}" for x, y, z in face),
                "End Polygon",
            ]
        )
        for face in faces
    )
    return (
        f"Begin Actor Class=Brush Name={name}\nBegin Brush Name=Model_{name}\n"
        f"Begin PolyList\n{polygons}\nEnd PolyList\nEnd Brush\n"
        f'CsgOper=CSG_{operation}\nName="{name}"\nEnd Actor'
    )


def _xyz(place: Triple) -> str:
    x, y, z = (value * SCALE for value in place)
    return f"X={x:.6f},Y={y:.6f},Z={z:.6f}"


def _write_obj(path: Path, shape: Shape) -> None:
    """As Unreal's editor exports a mesh: y upwards, in its own units."""
    lines = [f"v {x * SCALE:.4f} {z * SCALE:.4f} {-y * SCALE:.4f}" for x, y, z in shape.vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in shape.triangles]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


# ---- the yard --------------------------------------------------------------------------------


def write_yard(folder: Path, triangles: int = YARD_TRIANGLES) -> Path:
    """Write the yard, a walled place of 60 m with containers, drums, pipes and rolling ground.

    Args:
        folder: exists.
        triangles: in all, at least some thousands; exact up to a hundred.

    Returns:
        The COLLADA file; start poses stand in a sidecar beside it.
    """
    ground, walls, goods = Shape(), Shape(), Shape()
    cells = [-30.0 + 0.75 * k for k in range(81)]
    heights = [_ground(x, y) for y in cells for x in cells]
    ground.sheet(cells, cells, heights)
    for low, high in _yard_walls():
        walls.box(low, high)
    _fill(goods, triangles - len(ground.triangles) - len(walls.triangles))
    source = folder / "yard.dae"
    source.write_text(
        _collada({"Ground": ground, "Walls": walls, "Goods": goods}), encoding="utf-8"
    )
    places = [(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)]
    starts = (
        f'[[start]]\ntag = "Yard{n}"\nposition = [{x}, {y}, 0.3]\n'
        for n, (x, y) in enumerate(places)
    )
    (folder / "yard.usarsim.toml").write_text("\n".join(starts), encoding="utf-8")
    return source


def _ground(x: float, y: float) -> float:
    """Height: level where robots start, gently rolling around."""
    far = max(0.0, math.hypot(x, y) - 9.0) / 20.0
    return 0.5 * far * math.sin(0.35 * x) * math.cos(0.3 * y)


def _yard_walls() -> Iterable[tuple[Triple, Triple]]:
    for side in (-30.0, 29.7):
        yield (side, -30.0, -1.0), (side + 0.3, 30.0, 3.0)
        yield (-29.7, side, -1.0), (29.7, side + 0.3, 3.0)
    for x in (-12.0, 12.0):
        for y in (-24.0, -6.0, 12.0):
            yield (x, y, -1.0), (x + 0.2, y + 9.0, 2.5)


def _fill(goods: Shape, triangles: int) -> None:
    """Containers with ribs, drums and bent pipes until there are enough triangles."""
    dice = random.Random(5)
    number = 0
    while len(goods.triangles) + 100 < triangles:
        angle, way = dice.uniform(0.0, math.tau), dice.uniform(12.0, 28.0)
        x, y = way * math.cos(angle), way * math.sin(angle)
        z = _ground(x, y) - 0.1
        match number % 3:
            case 0:
                _container(goods, x, y, z, triangles - len(goods.triangles))
            case 1:
                goods.drum(x, y, z, z + 1.0, 0.3, 24)
            case _:
                goods.drum(x, y, z, z + dice.uniform(2.0, 4.0), 0.12, 20)
        number += 1


def _container(goods: Shape, x: float, y: float, z: float, triangles: int) -> None:
    goods.box((x - 1.5, y - 1.1, z), (x + 1.5, y + 1.1, z + 2.4))
    for rib in range(min(12, (triangles - 12) // 24)):
        u = x - 1.4 + 0.23 * rib
        goods.box((u, y - 1.16, z + 0.1), (u + 0.1, y - 1.1, z + 2.3))
        goods.box((u, y + 1.1, z + 0.1), (u + 0.1, y + 1.16, z + 2.3))


def _collada(shapes: dict[str, Shape]) -> str:
    geometries = "\n".join(_geometry(name, shape) for name, shape in shapes.items())
    nodes = "".join(
        f'<node name="{name}"><instance_geometry url="#{name}"/></node>' for name in shapes
    )
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">\n'
        '<asset><unit meter="1" name="meter"/><up_axis>Z_UP</up_axis></asset>\n'
        f"<library_geometries>{geometries}</library_geometries>\n"
        f'<library_visual_scenes><visual_scene id="scene">{nodes}</visual_scene>'
        "</library_visual_scenes>\n"
        '<scene><instance_visual_scene url="#scene"/></scene>\n</COLLADA>\n'
    )


def _geometry(name: str, shape: Shape) -> str:
    points = " ".join(f"{x:.5f} {y:.5f} {z:.5f}" for x, y, z in shape.vertices)
    indices = " ".join(f"{a} {b} {c}" for a, b, c in shape.triangles)
    count = len(shape.vertices)
    return (
        f'<geometry id="{name}"><mesh><source id="{name}-p">'
        f'<float_array id="{name}-a" count="{3 * count}">{points}</float_array>'
        f'<technique_common><accessor source="#{name}-a" count="{count}" stride="3">'
        '<param name="X" type="float"/><param name="Y" type="float"/>'
        '<param name="Z" type="float"/></accessor></technique_common></source>'
        f'<vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/></vertices>'
        f'<triangles count="{len(shape.triangles)}">'
        f'<input semantic="VERTEX" source="#{name}-v" offset="0"/><p>{indices}</p></triangles>'
        "</mesh></geometry>"
    )
