"""Writes the geometry of a world folder: `scene.xml`, `meshes/`, `solids/`.

Solid pieces are the bulk. MuJoCo adds geoms to one specification in quadratic time, so they go
into files that the scene attaches to the world body (worlds reference 9.1). To attach one, MuJoCo
goes through all that is there, so files are few.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from usarsim_maps.build.cut_outs import Finish
from usarsim_maps.build.looks import Look, msh
from usarsim_maps.build.pieces import (
    BoxPiece,
    Convex,
    FieldPiece,
    HullPiece,
    Piece,
    Pushed,
    RoundPiece,
)
from usarsim_maps.build.sheet import safe
from usarsim_maps.scene import Array
from usarsim_server.base.errors import plain
from usarsim_server.simulation.frames import IDENTITY, Pose
from usarsim_server.world_cost import SOLID, WorldCost, most_pieces, owners_in

CHUNK = 4000
"""Solid geoms per file. 20,001 of them, and as many that are seen, are read in 1.6 s; in files of
400 in 7.3 s, in one in 2.7 s."""

SEEN = {"group": 2, "contype": 0, "conaffinity": 0}
"""Of geoms that are only seen."""

FELT = {"group": 3, "rgba": "0.5 0.6 0.7 1"}
"""Of geoms that only collide."""

BASE = 1.0
"""m of solid ground below the lowest point of a height field."""

NEAR = 0.02
"""m before a camera where nothing is drawn."""


def attributes(values: Mapping[str, object]) -> str:
    """XML attributes with a blank before each; numbers short, None left out."""
    return "".join(
        f" {key}={quoteattr(_text(value))}" for key, value in values.items() if value is not None
    )


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float | np.floating):
        return _number(float(value))
    if isinstance(value, tuple | list | np.ndarray):
        return " ".join(_text(item) for item in np.asarray(value, dtype=float).ravel().tolist())
    return str(value)


def _number(value: float) -> str:
    text = f"{value:.9g}"
    return "0" if text == "-0" else text


def place(pose: Pose) -> dict[str, object]:
    """`pos` and `quat` of a pose, left out where they change nothing."""
    found: dict[str, object] = {}
    if pose.position != IDENTITY.position:
        found["pos"] = pose.position
    if pose.quaternion != IDENTITY.quaternion:
        found["quat"] = pose.quaternion
    return found


@dataclass(slots=True)
class Emitter:
    """Collects a scene and writes it."""

    folder: Path  # the world folder; exists
    finishes: Mapping[str, Finish]  # materials by the map's names
    _assets: list[str] = field(default_factory=list)
    _world: list[str] = field(default_factory=list)
    _solids: list[tuple[Convex, Pose, dict[str, object]]] = field(default_factory=list)
    _meshes: dict[int, list[tuple[str, Array, str]]] = field(default_factory=dict)
    _faces: dict[str, int] = field(default_factory=dict)  # triangles of these
    _keep: list[object] = field(default_factory=list)
    _fields: dict[int, str] = field(default_factory=dict)
    _lines: int = 0  # geoms in those for the world body
    _triangles: int = 0  # seen, those of every copy counted
    _files: int = 0
    _hulls: int = 0

    # ---- what is seen ----------------------------------------------------------------------

    def mesh_files(self, owner: object, label: str, looks: Iterable[Look]) -> None:
        """Write the mesh files, one per look, of something that several things may share.

        `show` names it by the owner; the label is for file names.
        """
        entries = []
        for look in looks:
            corners = look.corners.reshape(-1, 3)
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
            self._files += 1
            file = f"meshes/{self._files:05d}_{safe(label)[:48]}.msh"
            (self.folder / "meshes").mkdir(exist_ok=True)
            (self.folder / file).write_bytes(msh(look, middle))
            name = f"m{self._files}"
            self._assets.append(f'<mesh name="{name}" file="{file}" inertia="shell"/>')
            entries.append((name, middle, look.material))
            self._faces[name] = len(look.corners)
        self._meshes[id(owner)] = entries
        self._keep.append(owner)

    def shown(self, owner: object) -> int:
        """How many meshes `mesh_files` wrote for something."""
        return len(self._meshes.get(id(owner), ()))

    def show(
        self,
        owner: object,
        pose: Pose,
        names: Sequence[str | None],
        materials: Mapping[int, str] | None = None,
        massless: bool = False,
    ) -> list[str]:
        """Geoms for all meshes of something, at a pose; one name each."""
        lines = []
        for number, (mesh, middle, material) in enumerate(self._meshes[id(owner)]):
            material = (materials or {}).get(number, material)
            x, y, z = middle.tolist()
            values = {
                "name": names[number],
                "type": "mesh",
                "mesh": mesh,
                "material": self.finishes[material].name,
                **place(pose @ Pose((x, y, z))),
                **SEEN,
                "mass": 0 if massless else None,
            }
            lines.append(f"<geom{attributes(values)}/>")
            self._triangles += self._faces[mesh]
        return lines

    def add_world(self, lines: Iterable[str]) -> None:
        """Lines for the world body."""
        for line in lines:
            self._world.append(line)
            self._lines += line.count("<geom")

    # ---- what is felt ----------------------------------------------------------------------

    def add_solid(self, piece: Piece, pose: Pose, friction: float, name: str | None) -> None:
        """A fixed piece; `pose` is that of its frame in the world."""
        values = {"name": name, "friction": friction, **FELT}
        if isinstance(piece, FieldPiece):
            self.add_world([self._field_geom(piece, pose, values)])
        else:
            self._solids.append((piece, pose, values))

    def _field_geom(self, piece: FieldPiece, pose: Pose, values: Mapping[str, object]) -> str:
        """A height field; copies share its heights."""
        rows, columns = piece.heights.shape
        low, high = float(piece.heights.min()), float(piece.heights.max())
        span = max(high - low, 1e-3)
        x, y = (columns - 1) * piece.spacing[0] / 2.0, (rows - 1) * piece.spacing[1] / 2.0
        name = self._fields.get(id(piece))
        if name is None:
            name = self._fields[id(piece)] = f"field{len(self._fields) + 1}"
            self._keep.append(piece)
            (self.folder / "meshes").mkdir(exist_ok=True)
            file = f"meshes/{name}.hfield"
            data = ((piece.heights - low) / span).astype("<f4")
            head = struct.pack("<2i", rows, columns)
            (self.folder / file).write_bytes(head + data.tobytes())
            size = (x, y, span, BASE)
            self._assets.append(
                f"<hfield{attributes({'name': name, 'file': file, 'size': size})}/>"
            )
        middle = pose @ piece.pose @ Pose((x, y, low))
        return f"<geom{attributes({'type': 'hfield', 'hfield': name, **place(middle), **values})}/>"

    def body_piece(self, piece: Pushed, friction: float, mass: float) -> str:
        """A geom of a movable body, in the frame of the body."""
        values: dict[str, object] = {"friction": friction, "mass": mass, **FELT}
        if isinstance(piece, RoundPiece):
            head = {"type": piece.kind, "size": piece.size, **place(piece.pose)}
            return f"<geom{attributes({**head, **values})}/>"
        if isinstance(piece, HullPiece):
            self._hulls += 1
            name = f"hull{self._hulls}"
            self._assets.append(_hull_asset(name, piece))
            return f"<geom{attributes({'type': 'mesh', 'mesh': name, **values})}/>"
        return _box_geom(piece, IDENTITY, values)

    @property
    def pieces(self) -> int:
        """Geoms so far."""
        return len(self._solids) + self._lines

    def cost(self) -> WorldCost:
        """What will be written, as far as it is known."""
        hulls = {id(piece): piece for piece, _, _ in self._solids if isinstance(piece, HullPiece)}
        points = sum(len(hull.points) for hull in hulls.values())
        files = (self.folder / "meshes").glob("*")
        size = sum(file.stat().st_size for file in files)
        return WorldCost(self.pieces, len(hulls), points, size, self._triangles)

    def largest(self) -> str:
        """What has most of the pieces, for people."""
        owners = owners_in("".join(self._world).encode())
        owners.update(
            str(values["name"] or "").rsplit(SOLID, 1)[0] for _, _, values in self._solids
        )
        return most_pieces(owners)

    # ---- writing ---------------------------------------------------------------------------

    def write(
        self, name: str, lamps: Sequence[Mapping[str, object]], extent: float, middle: Array
    ) -> None:
        """Write `scene.xml` and the files beside it.

        The extent, m, and the middle are those of the playable part: cameras and shadows are scaled
        by it.
        """
        parts = self._write_solids()
        lines = [
            f"<mujoco{attributes({'model': name})}>",
            '<compiler meshdir="." texturedir="."/>',
            f"<statistic{attributes({'extent': extent, 'center': middle})}/>",
            "<visual>",
            '<headlight ambient="0.35 0.35 0.35" diffuse="0.35 0.35 0.35" specular="0 0 0"/>',
            f"<map{attributes({'znear': NEAR / extent, 'zfar': max(50.0, 4000.0 / extent)})}/>",
            "</visual>",
            "<asset>",
            *self._finish_lines(),
            *self._assets,
            *(f'<model name="{part}" file="solids/{part}.xml"/>' for part in parts),
            "</asset>",
            "<worldbody>",
            *(f"<light{attributes(lamp)}/>" for lamp in lamps),
            *self._world,
            *(f'<frame><attach model="{part}" prefix="{part}:"/></frame>' for part in parts),
            "</worldbody>",
            "</mujoco>",
        ]
        (self.folder / "scene.xml").write_text(plain("\n".join(lines)) + "\n", encoding="utf-8")

    def _finish_lines(self) -> Iterable[str]:
        pictures = sorted({f.picture for f in self.finishes.values() if f.picture})
        for picture in pictures:
            yield f'<texture name="{picture}" type="2d" file="textures/{picture}"/>'
        for finish in self.finishes.values():
            values = {
                "name": finish.name,
                "texture": finish.picture,
                "rgba": finish.color,
                "specular": 0.1,
                "shininess": 0.1,
            }
            yield f"<material{attributes(values)}/>"

    def _write_solids(self) -> list[str]:
        """Files of at most `CHUNK` pieces; a hull that several pieces of a file share is written
        once. Where there are several files, pieces that share one follow on one another."""
        names = []
        if len(self._solids) > CHUNK:
            first: dict[int, int] = {}
            for number, (piece, _, _) in enumerate(self._solids):
                first.setdefault(id(piece), number)
            self._solids.sort(key=lambda solid: first[id(solid[0])])
        for start in range(0, len(self._solids), CHUNK):
            name = f"s{start // CHUNK:04d}"
            assets: list[str] = []
            hulls: dict[int, str] = {}
            geoms = []
            for piece, pose, values in self._solids[start : start + CHUNK]:
                if isinstance(piece, BoxPiece):
                    geoms.append(_box_geom(piece, pose, values))
                    continue
                hull = hulls.get(id(piece))
                if hull is None:
                    hull = hulls[id(piece)] = f"h{len(hulls)}"
                    assets.append(_hull_asset(hull, piece))
                geoms.append(
                    f"<geom{attributes({'type': 'mesh', 'mesh': hull, **place(pose), **values})}/>"
                )
            (self.folder / "solids").mkdir(exist_ok=True)
            head, end = f'<mujoco model="{name}">\n<asset>', "</worldbody>\n</mujoco>\n"
            text = "\n".join([head, *assets, "</asset>\n<worldbody>", *geoms, end])
            (self.folder / "solids" / f"{name}.xml").write_text(plain(text), encoding="utf-8")
            names.append(name)
        return names


def _hull_asset(name: str, piece: HullPiece) -> str:
    return f"<mesh{attributes({'name': name, 'vertex': piece.points})}/>"


def _box_geom(piece: BoxPiece, pose: Pose, values: Mapping[str, object]) -> str:
    where = {"type": "box", "size": piece.half, **place(pose @ piece.pose)}
    return f"<geom{attributes({**where, **values})}/>"
