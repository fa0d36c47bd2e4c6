"""What readers of mesh files share: axes and units, pictures beside the file, names with a meaning.

Names: objects called `UCX_Chair_01`, `UBX_...`, `USP_...`, `UCP_...` are collision hulls, boxes,
balls and capsules of the object after the prefix (Unreal's rule for FBX, worlds reference 6). Empty
nodes called `PlayerStart...`, `RobotStart...`, `PathNode...`, `MaleVictim...` and
`FemaleVictim...` are what they say; their x axis points forward.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PureWindowsPath
from typing import Any
from urllib.parse import unquote

from usarsim_maps.files import AssetIndex
from usarsim_maps.meshes.polygons import check_count
from usarsim_maps.reader import Context, ImportOptions
from usarsim_maps.scene import (
    Array,
    Collision,
    Light,
    LightKind,
    Material,
    Mesh,
    Scene,
    SceneObject,
    Source,
    map_victim,
)
from usarsim_maps.units import MIRROR, affine, axis_matrix, matrix_of_pose, pose_of_matrix
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.files import is_regular
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import PathNode, StartPose, Victim

CURE = "the file is damaged or cut off; export it again"

PICTURES = (".png", ".tga", ".dds", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".gif")
"""Extensions of pictures, in the order of preference."""


NEARBY = ("", "textures", "materials/textures", "images", "maps", "texture")
"""Folders in which exporters leave pictures, relative to the mesh or to a folder above it."""


# ---- axes ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """The way from a file's frame into the simulation's."""

    linear: Array  # (3, 3) turns, scales to metres, and reflects if the user wants it
    units_per_metre: float  # for `Source`
    up: str
    mirrored: bool
    assumed: bool
    stated: bool  # the unit is, see `Source`

    def source(self, path: Path, title: str, files: Iterable[Path] = ()) -> Source:
        """What the scene says about its origin."""
        return Source(
            path,
            title,
            units_per_metre=self.units_per_metre,
            up=self.up,
            mirrored=self.mirrored,
            assumed=self.assumed,
            stated=self.stated,
            files=tuple(dict.fromkeys([path, *files])),
        )

    def place(self, node: Array, shape: Array | None = None) -> tuple[Pose, Array]:
        """Pose of a node in the world, and the matrix from its mesh into the frame of that pose.

        The mesh stands where the node's matrix puts it, or another one (4, 4), `shape`.

        The pose is that of the node's matrix (4, 4) in the file with the axes exchanged: an upright
        thing has no rotation.
        """
        pose = self.pose(node)
        placed = node if shape is None else shape
        return pose, matrix_of_pose(pose.inverse()) @ affine(self.linear) @ placed

    def pose(self, node: Array) -> Pose:
        """Pose of a node in the world; its x axis stays its x axis."""
        turn = self.linear * self.units_per_metre
        return pose_of_matrix(affine(turn @ node[:3, :3] @ turn.T, self.linear @ node[:3, 3]))


def axes_of(
    options: ImportOptions,
    up: str,
    unit: float = 1.0,
    *,
    stated: bool = True,
    turn: Array | None = None,
) -> Axes:
    """Axes of a file, whose user has the last word.

    `up` is the axis that the file, or its format's custom, has upwards, `unit` is in metres;
    `stated`: file or format say what the units are; `turn` (3, 3) takes the file's axes into the
    world's where the file says more about them than which one is upwards.
    """
    scale = options.scale or 1.0 / unit
    linear = (axis_matrix(options.up or up) if turn is None or options.up else turn) / scale
    up = options.up or up
    if options.mirror:
        linear = MIRROR @ linear
    own = options.scale is None
    return Axes(
        linear, scale, up, options.mirror, assumed=own and not stated, stated=own and stated
    )


def broken(source: Path, problem: str, where: int | str | None = None) -> MapImportError:
    """The error for a damaged file: file, line or other place, problem, and the usual cure."""
    place = f"line {where}" if isinstance(where, int) else where
    return MapImportError(at(source, problem, CURE, where=place))


# ---- pictures --------------------------------------------------------------------------------


@dataclass(slots=True)
class Pictures:
    """Finds the pictures that a mesh file names."""

    source: Path  # the mesh file
    context: Context  # of the import
    files: list[Path] = field(default_factory=list)  # pictures found so far
    _index: AssetIndex | None = None
    _folders: dict[Path, dict[str, Path]] = field(default_factory=dict)

    def find(self, name: str) -> Path | None:
        """A picture by the name in the file; what is not found keeps that name.

        Searched are the place that the name says, then the usual folders beside the mesh and up
        to two levels above it, then the asset folders, without regard to case or extension.
        """
        plain = _plain(name)
        if not plain:
            return None
        found = self._beside(plain)
        if found is None:
            if self._index is None:
                self._index = self.context.index(self.source)
            found = self._index.find(plain, PICTURES)
        if found is None or found.suffix.lower() not in PICTURES:
            return self.source.parent / PureWindowsPath(plain).name
        self.files.append(found)
        return found

    def _beside(self, plain: str) -> Path | None:
        last = PureWindowsPath(plain).name
        here = self.source.parent
        direct = here / plain
        if direct.suffix.lower() in PICTURES and is_regular(direct):
            return direct if self.context.admit(direct, self.source) else None
        for base in (here, here.parent, here.parent.parent):
            for folder in NEARBY if base is here else NEARBY[1:]:
                found = self._inside(base / folder, last)
                if found is not None:
                    return found if self.context.admit(found, self.source) else None
        return None

    def _inside(self, folder: Path, name: str) -> Path | None:
        """A picture in a folder, without regard to case; another extension will do."""
        if folder not in self._folders:
            try:
                names = sorted(folder.iterdir()) if folder.is_dir() else []
            except OSError:
                names = []
            pictures = [path for path in names[:20_000] if path.suffix.lower() in PICTURES]
            table = {path.stem.lower(): path for path in reversed(pictures)}
            table |= {path.name.lower(): path for path in pictures}
            self._folders[folder] = table
        table = self._folders[folder]
        name = name.lower()
        found = table.get(name)
        if found is None and name.endswith(PICTURES):
            found = table.get(name.rpartition(".")[0])
        return found


def _plain(name: str) -> str:
    """A path as written in a file, with forward slashes and without scheme."""
    name = name.strip().strip('"').replace("\0", "")
    lower = name.lower()
    if lower.startswith("file://"):
        name = name[7:]
        if re.match(r"/[A-Za-z]:", name):
            name = name[1:]
    if "%" in name:
        name = unquote(name)
    return name.replace("\\", "/")[:1000]


# ---- names -----------------------------------------------------------------------------------

_NUMBER = re.compile(r"(?:\.\d{3,}|_\d+)$")

_PREFIXES = {
    "ucx_": Collision.HULL,
    "mcdcx_": Collision.HULL,
    "ubx_": Collision.BOX,
    "usp_": Collision.SPHERE,
    "ucp_": Collision.HULL,  # a capsule, whose mesh is convex
}


def collision_of(name: str) -> Collision | None:
    """The kind of collision piece that a name announces; None for ordinary names."""
    lower = name.lower()
    return next((kind for word, kind in _PREFIXES.items() if lower.startswith(word)), None)


def with_hulls(objects: Sequence[SceneObject]) -> tuple[SceneObject, ...]:
    """Objects whose collision pieces do their work: unseen, and alone in being solid."""
    owners: set[str] = set()
    for thing in objects:
        if collision_of(thing.name) is not None:
            rest = thing.name.partition("_")[2].lower()
            owners |= {rest, _NUMBER.sub("", rest), _NUMBER.sub("", _NUMBER.sub("", rest))}
    if not owners:
        return tuple(objects)
    answer = []
    for thing in objects:
        kind = collision_of(thing.name)
        if kind is not None:
            parts = tuple(replace(part, visible=False, collision=kind) for part in thing.parts)
        elif thing.name.lower() in owners:
            parts = tuple(replace(part, collision=Collision.NONE) for part in thing.parts)
        else:
            parts = thing.parts
        answer.append(replace(thing, parts=parts))
    return tuple(answer)


class SceneBuilder:
    """A scene being filled from a file of nodes."""

    def __init__(self, path: Path, context: Context, axes: Axes) -> None:
        self.path = path
        self.axes = axes
        self.findings = context.findings
        self.pictures = Pictures(path, context)
        self.starts: list[StartPose] = []
        self.path_nodes: list[PathNode] = []
        self.victims: list[Victim] = []
        self.objects: list[SceneObject] = []
        self.lights: list[Light] = []
        self._meshes: dict[object, Mesh | None] = {}
        self._triangles = 0

    def mesh(self, key: object, make: Callable[[], Mesh | None]) -> Mesh | None:
        """A mesh, made once for all nodes that show it."""
        if key not in self._meshes:
            self._meshes[key] = found = make()
            self._triangles += 0 if found is None else len(found.triangles)
            check_count(self.path, self._triangles)
        return self._meshes[key]

    def mark(self, name: str, matrix: Array, tag: str = "") -> bool:
        """Take a node without geometry for the start, path node or victim that its name says it is.

        Clients are told the tag instead of the name. Whether it is one.
        """
        plain, word = re.sub(r"[^a-z]", "", name.lower()), tag or name
        kind, pose = "empty node", self.axes.pose(matrix)
        if plain.startswith(("playerstart", "robotstart", "startpose", "startpoint")):
            kind = "start"
            self.starts.append(StartPose(word, pose))
        elif plain.startswith("pathnode"):
            kind = "path node"
            self.path_nodes.append(PathNode(word, pose.position))
        elif plain.startswith(("malevictim", "femalevictim", "victim")):
            kind = "victim"
            self.victims.append(map_victim(word, pose, "female" if "female" in plain else "male"))
        self.findings.count(kind)
        return kind != "empty node"

    def light(
        self, name: str, kind: LightKind, matrix: Array, color: Iterable[float], **facts: Any
    ) -> None:
        """A light that shines along -z of its node."""
        x, y, z = (self.axes.linear @ matrix[:3, 3]).tolist()
        dx, dy, dz = (self.axes.linear @ -matrix[:3, 2]).tolist()
        r, g, b = color
        self.findings.count("light")
        self.lights.append(Light(name, kind, (x, y, z), (dx, dy, dz), (r, g, b), **facts))

    def scene(
        self, title: str, materials: Mapping[str, Material], files: Iterable[Path] = ()
    ) -> Scene:
        """All of it; the title is that of the format."""
        return Scene(
            source=self.axes.source(self.path, title, [*files, *self.pictures.files]),
            objects=with_hulls(self.objects),
            materials=dict(materials),
            starts=tuple(self.starts),
            path_nodes=tuple(self.path_nodes),
            victims=tuple(self.victims),
            lights=tuple(self.lights),
        )
