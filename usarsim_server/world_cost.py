"""What a world costs, estimated before MuJoCo compiles it, and the bounds of that.

Estimates follow from counts alone, so they are the same on every machine; the times are those of
one core of an AMD EPYC. Fitted to worlds of 20,000 to 150,000 pieces, of five meshes or all
different.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.errors import UsarsimError, at
from usarsim_server.files import read_regular

MIB = 1 << 20

MAX_PIECES = 500_000
"""Geoms of a world, unless somebody sets another bound."""
MAX_MEMORY = 512
"""MiB of a model, unless somebody sets another bound: so much is joined anew within 2 s of an
INIT."""
MOST = 10_000_000
"""Of both, whatever somebody asks for."""
LARGE = 20_000
"""Pieces from which on it is worth a line what a world costs."""

_PIECE, _HULL, _POINT = 500, 1050, 255
"""Bytes of a model for each geom, for each mesh of a file of solids, for each of its points."""
_READY, _READY_PIECE, _READY_HULL = 1.0, 79e-6, 65e-6
"""s until a server is READY: at least, and more for each geom and each mesh."""
_INIT, _INIT_MIB = 0.3, 3.4e-3
"""s from an INIT that needs a larger model to the first sensor: at least, and for each MiB."""

_GEOM = re.compile(rb"<geom[\s/>]")
_HULL_POINTS = re.compile(rb'<mesh[^>]*\svertex="([^"]*)"')
_FILE = re.compile(rb'<(?:include|model)[^>]*\sfile="([^"]*)"')
_MESH_FILE = re.compile(rb'<mesh[^>]*\sfile="([^"]*)"')


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
    """

    pieces: int
    hulls: int = 0
    points: int = 0
    meshes: int = 0

    @property
    def memory(self) -> float:
        """MiB of the compiled model."""
        size = _PIECE * self.pieces + _HULL * self.hulls + _POINT * self.points + self.meshes
        return size / MIB

    @property
    def ready(self) -> float:
        """s until the server is READY."""
        return _READY + _READY_PIECE * self.pieces + _READY_HULL * self.hulls

    @property
    def init(self) -> float:
        """s from an INIT to the first sensor, where a larger model is needed."""
        return _INIT + _INIT_MIB * self.memory

    def text(self) -> str:
        """For people."""
        return (
            f"{self.pieces:,} pieces, {self.memory:.0f} MiB; READY after about {self.ready:.0f} s, "
            f"first sensor {self.init:.1f} s after INIT"
        )

    def excess(self, limits: WorldLimits) -> str | None:
        """What is more than a bound; None if nothing is."""
        if self.pieces > limits.pieces:
            return f"{self.pieces:,} pieces are more than {limits.pieces:,} (max_pieces)"
        if self.memory > limits.memory:
            memory = f"its model would take {self.memory:,.0f} MiB, more than {limits.memory:,}"
            return f"{memory} (max_world_memory)"
        return None


def cost_of(scene: Path) -> WorldCost:
    """Count what a scene's files say, without reading them as XML; they have been looked through.

    Raises:
        OSError: a file cannot be read.
    """
    pieces = hulls = points = meshes = 0
    todo, seen = [scene], set[Path]()
    while todo:
        path = todo.pop()
        if path in seen:
            continue
        seen.add(path)
        text = read_regular(path)
        pieces += len(_GEOM.findall(text))
        for numbers in _HULL_POINTS.findall(text):
            hulls += 1
            points += (numbers.count(b" ") + 1) // 3
        found = (path.parent / name.decode("utf-8", "replace") for name in _FILE.findall(text))
        todo += [one for one in found if one.is_file()]
        for name in _MESH_FILE.findall(text):
            mesh = path.parent / name.decode("utf-8", "replace")
            meshes += mesh.stat().st_size if mesh.is_file() else 0
    return WorldCost(pieces, hulls, points, meshes)


def check_cost(
    cost: WorldCost, limits: WorldLimits, source: Path, most: str, error: type[UsarsimError]
) -> None:
    """Refuse a world that is beyond a bound.

    Args:
        cost, limits: of it.
        source: the file that is to blame.
        most: what has most of the pieces, for people; may be empty.
        error: what is raised.
    """
    excess = cost.excess(limits)
    if excess is None:
        return
    problem = f"{excess}; {most}" if most else excess
    cure = (
        'leave them out or make them coarse with a sidecar (`exclude = true`, `collision = "hull"`)'
        ", or raise the bound with --max-pieces or --max-world-memory"
    )
    raise error(at(source, problem, cure))
