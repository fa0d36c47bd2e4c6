"""The intermediate scene: what a map holds, as plain values that every reader fills in.

Everything here is in the simulation frame (x forward, y left, z up) and in metres; readers convert
with `units.py` and never again afterwards. Triangles and polygons run counter-clockwise seen from
outside. Arrays belong to whoever reads the scene: nobody writes into them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from usarsim_server.fields import field as declared
from usarsim_server.simulation.frames import IDENTITY, Pose, Vector
from usarsim_server.worlds.description import PathNode, Smoke, StartPose, Victim

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int32]
Color: TypeAlias = tuple[float, float, float, float]
"""Red, green, blue, opacity, each from 0 to 1."""

NEUTRAL: Color = (0.62, 0.62, 0.60, 1.0)
"""Colour of what has no material."""


# ---- looks -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Material:
    """How a surface looks.

    Attributes:
        name: unique in the scene, as the map has it (`Package.Group.Name`).
        color: multiplies the texture.
        texture: image file, or None. Formats: whatever Pillow reads.
        image: the bytes of an image file that lies inside another file (USDZ, GLB, packages);
            has precedence over `texture`.
        repeat: texture coordinates outside 0..1 repeat the picture.
    """

    name: str
    color: Color = (0.7, 0.7, 0.7, 1.0)
    texture: Path | None = None
    image: bytes | None = field(default=None, repr=False)
    repeat: bool = True


# ---- shapes ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle mesh, an asset that parts share; in its own local frame.

    Attributes:
        name: for the report and for files, for example `Package.Group.Name`.
        vertices: (n, 3) float64.
        triangles: (m, 3) int32, counter-clockwise from outside.
        uvs: (m, 3, 2) texture coordinates per corner, v upwards (OpenGL, MuJoCo); None if there
            are none.
        slots: (m,) int32, index into `materials` of every triangle; None: all of them 0.
        materials: names of materials by slot; empty: neutral grey.
        hulls: convex collision pieces made by the artist, each (k, 3) points in the same frame
            whose convex hull is solid. Where there are some, nothing else collides.
    """

    name: str
    vertices: Array
    triangles: Indices
    uvs: Array | None = None
    slots: Indices | None = None
    materials: tuple[str, ...] = ()
    hulls: tuple[Array, ...] = ()


@dataclass(frozen=True, slots=True)
class Box:
    """Full extents along x, y, z, m; centred."""

    size: Vector


@dataclass(frozen=True, slots=True)
class Sphere:
    """A ball; radius in m."""

    radius: float


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder along z, centred; radius and full length in m."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Capsule:
    """A cylinder along z with half balls at its ends, centred; `length` is the cylinder's."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Plane:
    """An endless plane through the origin, solid below z = 0; `size` is what is drawn of it."""

    size: tuple[float, float] = (100.0, 100.0)


Shape: TypeAlias = Mesh | Box | Sphere | Cylinder | Capsule | Plane


class Collision(StrEnum):
    """How a part becomes solid (worlds reference 9.4)."""

    AUTO = "auto"
    """Hulls of the artist if there are some, else whatever fits shape and size best."""
    NONE = "none"
    """Not solid."""
    HULL = "hull"
    """One convex hull."""
    HULLS = "hulls"
    """A convex hull per connected component."""
    BOX = "box"
    """The bounding box in the part's frame."""
    SPHERE = "sphere"
    """The bounding sphere."""
    SURFACE = "surface"
    """The true surface, as thin convex slabs."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One shape of an object.

    Attributes:
        shape: of meshes, the same `Mesh` instance for every copy: that is how copies share memory.
        matrix: (4, 4) from the shape's frame into the object's; may scale and mirror. Shapes other
            than meshes only turn and move.
        visible: rays and cameras meet it.
        collision: whether and how it is solid. A part that is solid and not visible is collision
            geometry of the map's author.
        materials: replacements by slot number (meshes) or for slot 0 (other shapes).
    """

    shape: Shape
    matrix: Array = field(default_factory=lambda: np.eye(4))
    visible: bool = True
    collision: Collision = Collision.AUTO
    materials: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """A thing with a name: an actor, a model, a node.

    Attributes:
        name: as in the map; need not be unique.
        parts: its shapes, in the frame of `pose`.
        pose: of its frame in the world. A thing that is pushed turns about its centre of mass,
            wherever this origin is.
        tag: as in the map, empty if there is none.
        kind: class in the map, for example `StaticMeshActor`.
        movable: it is a rigid body that can be pushed.
        mass: kg, of movable things; None: from volume and a density.
        friction: sliding friction; None: the builder's default.
    """

    name: str
    parts: tuple[Part, ...]
    pose: Pose = IDENTITY
    tag: str = ""
    kind: str = ""
    movable: bool = False
    mass: float | None = None
    friction: float | None = None


# ---- constructive solid geometry -------------------------------------------------------------


class BrushOperation(StrEnum):
    """What a brush does to the space it covers."""

    ADD = "add"
    SUBTRACT = "subtract"


class Solidity(StrEnum):
    """How a brush takes part."""

    SOLID = "solid"
    SEMISOLID = "semisolid"
    """Solid, but later subtractions do not cut it."""
    NONSOLID = "nonsolid"
    """Seen, not felt, and not cut."""


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    """A flat face.

    Attributes:
        vertices: (k, 3), k >= 3, counter-clockwise from outside; need not be convex.
        material: name of a material, empty for neutral grey.
        uvs: (k, 2), v upwards; None if unknown. A CSG result interpolates them over the plane.
        solid: False: a face that is seen and not felt.
    """

    vertices: Array
    material: str = ""
    uvs: Array | None = None
    solid: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Brush:
    """A polyhedron of the level, in world coordinates; neither convex nor quite closed for sure.

    The order of a scene's brushes is a program: each one fills or empties space in its turn.
    """

    name: str
    polygons: tuple[Polygon, ...]
    operation: BrushOperation = BrushOperation.ADD
    solidity: Solidity = Solidity.SOLID
    tag: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Heightfield:
    """Terrain on a grid.

    Attributes:
        name: as in the map.
        heights: (rows, columns) m above the origin of `pose`; rows along +y, columns along +x.
        spacing: m between columns and between rows.
        pose: of the corner [0, 0].
        material: name of a material, empty for neutral grey.
        texture_size: m of ground that one picture covers.
        tag: as in the map.
    """

    name: str
    heights: Array
    spacing: tuple[float, float]
    pose: Pose = IDENTITY
    material: str = ""
    texture_size: float = 4.0
    tag: str = ""


# ---- what else a map holds -------------------------------------------------------------------


class LightKind(StrEnum):
    """Shapes of light sources."""

    POINT = "point"
    SPOT = "spot"
    DIRECTIONAL = "directional"
    AMBIENT = "ambient"


@dataclass(frozen=True, slots=True)
class Light:
    """A lamp."""

    name: str = declared(help="as in the map")
    kind: LightKind = declared(default=LightKind.POINT, help="its shape")
    position: Vector = declared(default=(0.0, 0.0, 0.0), help="m; of point and spot light")
    direction: Vector = declared(default=(0.0, 0.0, -1.0), help="of spot and directional light")
    color: Vector = declared(default=(1.0, 1.0, 1.0), help="red, green, blue from 0 to 1")
    brightness: float = declared(default=1.0, low=0.0, high=1000.0, help="1: an ordinary lamp")
    reach: float = declared(default=0.0, low=0.0, high=1e5, help="m; where it ends, 0: nowhere")
    cone: float = declared(default=45.0, low=1.0, high=90.0, help="degrees; half angle of a spot")
    shadows: bool = declared(default=False, help="it casts some")


def map_victim(
    name: str,
    pose: Pose,
    figure: str = "male",
    posture: str = "",
    scale: Vector = (1.0, 1.0, 1.0),
    status: str = "Alive",
    properties: Mapping[str, object] | None = None,
) -> Victim:
    """A person as a map has it.

    Args:
        name: as in the map.
        pose: of the actor or model in the map: feet or middle, the builder finds the floor.
        figure: `male` or `female`.
        posture: `standing`, `sitting` or `lying`; empty: the builder decides by the room there is.
        scale: of the figure along x, y, z.
        status: as victim sensors tell it.
        properties: as in `world.toml`.
    """
    size = float(np.prod(np.abs(scale))) ** (1.0 / 3.0)
    return Victim(
        name=name,
        pose=pose,
        posture=posture,
        status=status,
        properties={"figure": figure, **(properties or {})},
        scale=min(10.0, max(0.1, size or 1.0)),
    )


@dataclass(frozen=True, slots=True)
class Source:
    """Where a scene comes from and how it was read.

    Attributes:
        path: the file that the user named.
        format: for people, for example `Unreal T3D`.
        units_per_metre: what lengths were divided by.
        up: axis of the file that points up.
        mirrored: a reflection was applied, as Unreal's left-handed frame needs.
        assumed: scale or axis were assumed, not stated by file or user.
        whole_map: files of this kind hold whole maps; others may be single things, and small.
        files: all files that were read, this one included; the cache watches them.
        licence: what a licence or read-me file beside the map says about copying, in one line.
    """

    path: Path
    format: str
    units_per_metre: float = 1.0
    up: str = "Z"
    mirrored: bool = False
    assumed: bool = False
    whole_map: bool = False
    files: tuple[Path, ...] = ()
    licence: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A whole map.

    Attributes:
        source: where it comes from.
        objects: things with shapes.
        brushes: in the order in which they act.
        filled: space is solid before the first brush; None: decide by that brush (worlds
            reference 4.2).
        heightfields: terrain.
        materials: by name; names that parts use and that are missing here become neutral grey.
        starts, path_nodes: in the order of the file; poses exactly as in the map, the builder finds
            the floor below. Tags are what clients are told: the map's Tag unless it is the class
            default, then the actor's name (worlds reference 3).
        victims, lights: in the order of the file; victims are made by `map_victim`.
        smoke: fog and smoke.
        kill_z: height below which nothing lives, m; None: unknown.
        title: for the world's sheet; empty: made from the file's name.
    """

    source: Source
    objects: tuple[SceneObject, ...] = ()
    brushes: tuple[Brush, ...] = ()
    filled: bool | None = None
    heightfields: tuple[Heightfield, ...] = ()
    materials: Mapping[str, Material] = field(default_factory=dict)
    starts: tuple[StartPose, ...] = ()
    path_nodes: tuple[PathNode, ...] = ()
    victims: tuple[Victim, ...] = ()
    lights: tuple[Light, ...] = ()
    smoke: Smoke = field(default_factory=Smoke)
    kill_z: float | None = None
    title: str = ""
