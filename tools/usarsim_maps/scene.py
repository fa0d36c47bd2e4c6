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

from usarsim_server.base.fields import field as declared
from usarsim_server.simulation.frames import IDENTITY, Pose, Vector
from usarsim_server.worlds.description import PathNode, Smoke, StartPose, Victim

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int32]
Integers: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]
Color: TypeAlias = tuple[float, float, float, float]
"""Red, green, blue, opacity, each from 0 to 1."""

NEUTRAL: Color = (0.62, 0.62, 0.60, 1.0)
"""Colour of what has no material."""


# ---- looks -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Opacity:
    """Opacity that comes from a picture: parts of a surface are not there.

    Attributes:
        picture: image file, or its bytes; None: the material's own picture.
        cutoff: below this opacity, from 0 to 1, there is nothing.
        blend: what is partly clear is drawn so; else all that is there is opaque.
        bright: brightness is the opacity, also of a picture with an alpha channel.
        inverse: what is black, or has no alpha, is opaque.
    """

    picture: Path | bytes | None = field(default=None, repr=False)
    cutoff: float = 0.5
    blend: bool = False
    bright: bool = False
    inverse: bool = False


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
        opacity: where the surface has holes; None: nowhere.
        meant: the map says of the thing itself, not only of its material, how clear it is, so that
            even no opacity at all is meant; else a solid thing is opaque then.
    """

    name: str
    color: Color = (0.7, 0.7, 0.7, 1.0)
    texture: Path | None = None
    image: bytes | None = field(default=None, repr=False)
    repeat: bool = True
    opacity: Opacity | None = None
    meant: bool = False


# ---- shapes ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle mesh, an asset that parts share; in its own local frame."""

    name: str  # for the report and for files, for example `Package.Group.Name`
    vertices: Array  # (n, 3) float64
    triangles: Indices  # (m, 3) int32, counter-clockwise from outside
    uvs: Array | None = None
    """(m, 3, 2) texture coordinates per corner, v upwards (OpenGL, MuJoCo); None if there are none.
    """
    slots: Indices | None = None
    """(m,) int32, index into `materials` of every triangle; None: all of them 0."""
    materials: tuple[str, ...] = ()  # names of materials by slot; empty: neutral grey
    hulls: tuple[Array, ...] = ()
    """Convex collision pieces made by the artist, each (k, 3) points in the same frame whose convex
    hull is solid. Where there are some, nothing else collides."""


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
    """One shape of an object."""

    shape: Shape
    """Of meshes, the same `Mesh` instance for every copy: that is how copies share memory."""
    matrix: Array = field(default_factory=lambda: np.eye(4))
    """(4, 4) from the shape's frame into the object's; may scale and mirror. Shapes other than
    meshes only turn and move."""
    visible: bool = True  # rays and cameras meet it
    collision: Collision = Collision.AUTO
    """Whether and how it is solid. A part that is solid and not visible is collision geometry of
    the map's author."""
    materials: Mapping[int, str] = field(default_factory=dict)
    """Replacements by slot number (meshes) or for slot 0 (other shapes)."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """A thing with a name: an actor, a model, a node."""

    name: str  # as in the map; need not be unique
    parts: tuple[Part, ...]  # its shapes, in the frame of `pose`
    pose: Pose = IDENTITY
    """Of its frame in the world. A thing that is pushed turns about its centre of mass, wherever
    this origin is."""
    tag: str = ""  # as in the map, empty if there is none
    kind: str = ""  # class in the map, for example `StaticMeshActor`
    movable: bool = False  # it is a rigid body that can be pushed
    mass: float | None = None  # kg, of movable things; None: from volume and a density
    friction: float | None = None  # sliding friction; None: the builder's default


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
    """A flat face."""

    vertices: Array  # (k, 3), k >= 3, counter-clockwise from outside; need not be convex
    material: str = ""  # name of a material, empty for neutral grey
    uvs: Array | None = None
    """(k, 2), v upwards; None if unknown. A CSG result interpolates them over the plane."""
    solid: bool = True  # False: a face that is seen and not felt


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
    """Terrain on a grid."""

    name: str  # as in the map
    heights: Array  # (rows, columns) m above the origin of `pose`; rows along +y, columns along +x
    spacing: tuple[float, float]  # m between columns and between rows
    pose: Pose = IDENTITY  # of the corner [0, 0]
    material: str = ""  # name of a material, empty for neutral grey
    texture_size: float = 4.0  # m of ground that one picture covers
    tag: str = ""  # as in the map


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
    """Where a scene comes from and how it was read."""

    path: Path  # the file that the user named
    format: str  # for people, for example `Unreal T3D`
    units_per_metre: float = 1.0  # what lengths were divided by
    up: str = "Z"  # axis of the file that points up
    mirrored: bool = False  # a reflection was applied, as Unreal's left-handed frame needs
    assumed: bool = False  # scale or axis were assumed, not stated by file or user
    stated: bool = False
    """The format or the file says what its unit is, and the user did not replace it: a map of any
    size is believed."""
    unit: str = ""
    """What the file says its unit is, for people, where files are often wrong about it."""
    whole_map: bool = False
    """Files of this kind hold whole maps; others may be single things, and small."""
    files: tuple[Path, ...] = ()
    """All files that were read, this one included; the cache watches them."""
    licence: str = ""
    """What a licence or read-me file beside the map says about copying, in one line."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A whole map."""

    source: Source  # where it comes from
    objects: tuple[SceneObject, ...] = ()  # things with shapes
    brushes: tuple[Brush, ...] = ()  # in the order in which they act
    filled: bool | None = None
    """Space is solid before the first brush; None: decide by that brush (worlds reference 4.2)."""
    heightfields: tuple[Heightfield, ...] = ()  # terrain
    materials: Mapping[str, Material] = field(default_factory=dict)
    """By name; names that parts use and that are missing here become neutral grey."""
    starts: tuple[StartPose, ...] = ()
    """In the order of the file; poses exactly as in the map, the builder finds the floor below.
    Tags are what clients are told: the map's Tag unless it is the class default, then the actor's
    name (worlds reference 3)."""
    starts_made: bool = False
    """The reader chose the starts, no map did: the builder turns each to the longest free way."""
    path_nodes: tuple[PathNode, ...] = ()
    victims: tuple[Victim, ...] = ()  # in the order of the file; victims are made by `map_victim`
    lights: tuple[Light, ...] = ()
    smoke: Smoke = field(default_factory=Smoke)  # fog and smoke
    kill_z: float | None = None  # height below which nothing lives, m; None: unknown
    title: str = ""  # for the world's sheet; empty: made from the file's name
