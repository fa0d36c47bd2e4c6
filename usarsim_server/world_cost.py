"""What a world costs, estimated before MuJoCo compiles it, and the bounds of that.

Estimates follow from counts alone, so they are the same on every machine; the times are those of
one core of an AMD EPYC. Fitted to worlds of 20,000 to 150,000 pieces, of five meshes or all
different.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import named, read_regular

MIB = 1 << 20

MAX_PIECES = 160_000
MAX_MEMORY = 480
"""Geoms of a world, and MiB of its model, unless somebody sets other bounds: a world that reaches
both has its first sensor some 2 s after an INIT, as estimated."""
RAYS_SHARE = 4
"""What the triangles of a world may take, beside its model, of what the model may take."""
MOST = 10_000_000
"""Of pieces and of MiB, whatever somebody asks for."""
LARGE = 20_000
"""Pieces from which on it is worth a line what a world costs."""
TOLD = 5
"""Things named that have most of the pieces."""

_PIECE, _HULL, _POINT = 500, 1050, 255
"""Bytes of a model for each geom, for each mesh of a file of solids, for each of its points."""
_TRIANGLE = 205
"""Bytes of each triangle of each geom that rays meet: corners, normal, tree."""
_READY, _READY_PIECE, _READY_HULL = 1.0, 79e-6, 65e-6
"""s until a server is READY: at least, and more for each geom and each mesh."""
_INIT, _INIT_PIECE, _INIT_MIB = 0.3, 8.6e-6, 5.4e-4
"""s from an INIT that needs a larger model to the first sensor: at least, for each geom and MiB."""

_GEOM = re.compile(rb"<geom[\s/>]")
_HULL_POINTS = re.compile(rb'<mesh[^>]*\svertex="([^"]*)"')
_FILE = re.compile(rb'<(?:include|model)[^>]*\sfile="([^"]*)"')
_MESH_FILE = re.compile(rb'<mesh[^>]*\sfile="([^"]*)"[^>]*>')
_TAG = re.compile(rb"<(/?body|geom)\b([^>]*)>")
_NAME = re.compile(rb'\sname="([^"]*)"')
_SHOWN = re.compile(rb'<geom(?![^>]*\sgroup="[3-9]")[^>]*\smesh="([^"]*)"')
_NUMBER = re.compile(r"[-_.\s]*\d+$")
SOLID = ".solid"
"""What follows the name of a thing in the names of its pieces, in worlds that were imported."""
_BYTES_OF_FACE = {".stl": 50, ".obj": 60}
"""Of mesh files: of a triangle in binary STL, and about so many in OBJ."""


@dataclass(frozen=True, slots=True)
class WorldLimits:
    """The most that a world may have."""

    pieces: int = MAX_PIECES
    memory: int = MAX_MEMORY  # MiB


LIMITS = WorldLimits()
"""Where nobody asks for others."""


@dataclass(frozen=True, slots=True)
class WorldCost:
    """What a world costs.

    Attributes:
        pieces: geoms. hulls: meshes that only collide. points: of these. meshes: bytes of others.
        triangles: of meshes that are seen, those of every copy counted.
    """

    pieces: int
    hulls: int = 0
    points: int = 0
    meshes: int = 0
    triangles: int = 0

    @property
    def memory(self) -> float:
        """MiB of the compiled model."""
        size = _PIECE * self.pieces + _HULL * self.hulls + _POINT * self.points + self.meshes
        return size / MIB

    @property
    def rays(self) -> float:
        """MiB of the triangles that rays meet."""
        return _TRIANGLE * self.triangles / MIB

    @property
    def ready(self) -> float:
        """s until the server is READY."""
        return _READY + _READY_PIECE * self.pieces + _READY_HULL * self.hulls

    @property
    def init(self) -> float:
        """s from an INIT to the first sensor, where a larger model is needed."""
        return _INIT + _INIT_PIECE * self.pieces + _INIT_MIB * self.memory

    def text(self) -> str:
        """For people."""
        return (
            f"{self.pieces:,} pieces, {self.memory:.0f} MiB, {self.rays:.0f} MiB for rays; READY "
            f"after about {self.ready:.0f} s, first sensor {self.init:.1f} s after INIT"
        )

    def excess(self, limits: WorldLimits) -> str | None:
        """What is more than a bound; None if nothing is."""
        if self.pieces > limits.pieces:
            return f"{self.pieces:,} pieces are more than {limits.pieces:,} (max_pieces)"
        if self.memory > limits.memory:
            memory = f"its model would take {self.memory:,.0f} MiB, more than {limits.memory:,}"
            return f"{memory} (max_world_memory)"
        if self.rays > RAYS_SHARE * limits.memory:
            return (
                f"the {self.triangles:,} triangles of all copies would take {self.rays:,.0f} MiB, "
                f"more than {RAYS_SHARE} times {limits.memory:,} (max_world_memory)"
            )
        return None


def cost_of(scene: Path) -> WorldCost:
    """Count what a scene's files say, without reading them as XML; they have been looked through.

    Raises:
        OSError: a file cannot be read.
    """
    pieces = hulls = points = meshes = 0
    faces: dict[bytes, int] = {}
    shown: Counter[bytes] = Counter()
    for path, text in _files(scene):
        pieces += len(_GEOM.findall(text))
        for numbers in _HULL_POINTS.findall(text):
            hulls += 1
            points += (numbers.count(b" ") + 1) // 3
        for found in _MESH_FILE.finditer(text):
            mesh = path.parent / named(found[1].decode("utf-8", "replace"))
            name = _NAME.search(found[0])
            if mesh.is_file():
                meshes += mesh.stat().st_size
                faces[name[1] if name else mesh.stem.encode()] = _triangles(mesh)
        shown.update(_SHOWN.findall(text))
    triangles = sum(faces.get(name, 0) * count for name, count in shown.items())
    return WorldCost(pieces, hulls, points, meshes, triangles)


def most_pieces(owners: Counter[str]) -> str:
    """What has most of the pieces, for people; things of one name and other numbers are one.

    Args:
        owners: how many pieces each thing has, by name.
    """
    pieces: Counter[str] = Counter()
    things: Counter[str] = Counter()
    for owner, count in owners.items():
        stem = _NUMBER.sub("", owner) or owner
        pieces[stem] += count
        things[stem] += 1
    told = (
        f"{stem or 'without a name'}* ({pieces[stem]:,} in {things[stem]:,} things)"
        if things[stem] > 1
        else f"{stem or 'without a name'} ({count:,})"
        for stem, count in pieces.most_common(TOLD)
    )
    return "most pieces: " + ", ".join(told)


def owners_in(text: bytes) -> Counter[str]:
    """How many geoms of MJCF each thing has: by the name of the geom, else of the body around it,
    else an empty one."""
    found: Counter[str] = Counter()
    bodies = [""]
    for tag in _TAG.finditer(text):
        name = _NAME.search(tag[2])
        own = name[1].decode("utf-8", "replace") if name else ""
        if tag[1] == b"geom":
            found[(own or bodies[-1]).rsplit(SOLID, 1)[0]] += 1
        elif tag[1] == b"/body":
            del bodies[max(1, len(bodies) - 1) :]
        elif not tag[2].endswith(b"/"):
            bodies.append(own or bodies[-1])
    return found


def check_cost(
    cost: WorldCost,
    limits: WorldLimits,
    source: Path,
    most: str,
    error: type[UsarsimError],
    *,
    whole: bool = True,
) -> None:
    """Refuse a world that is beyond a bound.

    Args:
        cost, limits: of it.
        source: the file that is to blame.
        most: what has most of the pieces, for people.
        error: what is raised.
        whole: whether that is all of it; else more will come.
    """
    excess = cost.excess(limits)
    if excess is None:
        return
    cure = (
        'leave them out or make them coarse with a sidecar (`exclude = true`, `collision = "hull"`)'
        ", or raise the bound with --max-pieces or --max-world-memory"
    )
    problem = f"{excess}; {most}" if whole else f"at least {excess}; so far, {most}"
    raise error(at(source, problem, cure))


def check_scene(scene: Path, limits: WorldLimits, error: type[UsarsimError]) -> WorldCost:
    """What the scene of a world folder costs, if that is within the bounds.

    Raises:
        OSError: a file cannot be read.
        error: it is beyond a bound.
    """
    cost = cost_of(scene)
    if cost.excess(limits) is not None:
        owners: Counter[str] = Counter()
        for _, text in _files(scene):
            owners += owners_in(text)
        check_cost(cost, limits, scene, most_pieces(owners), error)
    return cost


def _files(scene: Path) -> Iterator[tuple[Path, bytes]]:
    """A scene and the files that it names, each once."""
    todo, seen = [scene], set[Path]()
    while todo:
        path = todo.pop()
        if path in seen:
            continue
        seen.add(path)
        text = read_regular(path)
        yield path, text
        found = (
            path.parent / named(name.decode("utf-8", "replace")) for name in _FILE.findall(text)
        )
        todo += [one for one in found if one.is_file()]


def _triangles(mesh: Path) -> int:
    """How many triangles a mesh file has: exactly in MSH, else by its size."""
    size = mesh.stat().st_size
    if mesh.suffix.lower() == ".msh" and size >= 16:
        with mesh.open("rb") as file:
            return max(0, int(struct.unpack("<4i", file.read(16))[3]))
    return size // _BYTES_OF_FACE.get(mesh.suffix.lower(), 50)
