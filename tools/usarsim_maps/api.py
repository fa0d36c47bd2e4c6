"""What an author of a reader of maps needs, from one place; see docs/import.md.

A reader is a class that yields a `Scene`. It is found in a folder of this package, or announced in
the entry point group `usarsim_maps.readers` of another one:

    @register("blocks")
    class BlocksReader(Reader):
        title = "Blocks"
        extensions = (".blocks",)

        def read(self, source: Path, context: Context) -> Scene:
            things = []
            for line, text in enumerate(read_text(source).splitlines(), start=1):
                try:
                    name, *numbers = text.split()
                    x, y, z, width, depth, height = map(float, numbers)
                except ValueError:
                    cure = "write a name, a place and a size, such as: wall 0 0 1 4 0.2 2"
                    raise MapImportError(at(source, "no block", cure, where=f"line {line}"))
                size = Box((width, depth, height))
                things.append(SceneObject(name, (Part(size),), Pose((x, y, z))))
                context.findings.count("block")
            start = StartPose("Here", Pose((0.0, 0.0, 0.3)))
            return Scene(Source(source, self.title), tuple(things), starts=(start,))

Lengths are metres in the simulation frame (x forward, y left, z up): `axis_matrix`,
`unreal_points` and `unreal_pose` take them there, `take_apart` parts a matrix into a pose and a
scale. Files that the map names are found by `context.index(source).find(name)`, and only where they
may be read. What is left out is a finding, what cannot be used a `MapImportError`. A package that
may be missing is imported by `need` within `read`.
"""

from usarsim_maps.files import open_picture, read_bytes, read_text
from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context, ImportOptions, Reader, need, read_scene, register
from usarsim_maps.scene import (
    Box,
    Brush,
    BrushOperation,
    Capsule,
    Collision,
    Cylinder,
    Heightfield,
    Light,
    LightKind,
    Material,
    Mesh,
    Part,
    Plane,
    Polygon,
    Scene,
    SceneObject,
    Solidity,
    Source,
    Sphere,
    map_victim,
)
from usarsim_maps.units import (
    axis_matrix,
    matrix_of_pose,
    pose_of_matrix,
    reflect,
    take_apart,
    unreal_points,
    unreal_pose,
)
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import PathNode, Smoke, StartPose, Victim

__all__ = [
    "Box",
    "Brush",
    "BrushOperation",
    "Capsule",
    "Collision",
    "Context",
    "Cylinder",
    "Findings",
    "Heightfield",
    "ImportOptions",
    "Light",
    "LightKind",
    "MapImportError",
    "Material",
    "Mesh",
    "Part",
    "PathNode",
    "Plane",
    "Polygon",
    "Pose",
    "Reader",
    "Scene",
    "SceneObject",
    "Smoke",
    "Solidity",
    "Source",
    "Sphere",
    "StartPose",
    "Victim",
    "at",
    "axis_matrix",
    "map_victim",
    "matrix_of_pose",
    "need",
    "open_picture",
    "pose_of_matrix",
    "read_bytes",
    "read_scene",
    "read_text",
    "reflect",
    "register",
    "take_apart",
    "unreal_points",
    "unreal_pose",
]
