"""A small mesh in every format, what is true of it, and files of several formats."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.polygons import merge_meshes
from usarsim_maps.reader import Context, ImportOptions, read_scene
from usarsim_maps.scene import Mesh, Scene
from usarsim_server.base.errors import MapImportError

Array = NDArray[np.float64]

WEDGE = np.array(
    [[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 3]],
    dtype=float,
)
"""A corner of different lengths along x, y and z: shows any exchange or reflection of axes."""

FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int64)
"""Anticlockwise from outside; the volume is 1."""


def volume(mesh: Mesh) -> float:
    """Enclosed volume; negative if the faces look inwards (worlds 10)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def area(mesh: Mesh) -> float:
    """Of all triangles."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def whole(scene: Scene) -> Mesh:
    """Everything in a scene as one mesh in the world's frame."""
    mesh = merge_meshes(scene, "all")
    assert mesh is not None
    return mesh


def places(mesh: Mesh) -> list[list[float]]:
    """Used vertices, rounded and sorted."""
    used = np.unique(np.round(mesh.vertices[np.unique(mesh.triangles)], 6) + 0.0, axis=0)
    found: list[list[float]] = used.tolist()
    return found


WEDGE_PLACES = sorted(WEDGE.tolist())


def read(source: Path, findings: Findings | None = None, **options: object) -> Scene:
    """Read a file with options."""
    chosen = ImportOptions(**options)  # type: ignore[arg-type]
    return read_scene(source, Context(chosen, findings or Findings()))


def told(findings: Findings) -> str:
    """All notes."""
    return "\n".join(f"{note.subject}: {note.text}" for note in findings.warnings())


def faces_out(mesh: Mesh) -> bool:
    """Whether all faces look away from the middle."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    away = (a + b + c) / 3.0 - mesh.vertices.mean(axis=0)
    return bool((np.einsum("ij,ij->i", np.cross(b - a, c - a), away) > -1e-9).all())


def upright(points: Array) -> Array:
    """Points of the simulation frame in a file whose y is up: x, z, -y."""
    answer: Array = points[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])
    return answer


def damages(content: bytes) -> st.SearchStrategy[bytes]:
    """The same file cut off, with bytes exchanged, or with a piece doubled."""
    size = len(content)
    place = st.integers(0, size - 1)

    def change(spots: list[tuple[int, int]]) -> bytes:
        data = bytearray(content)
        for where, value in spots:
            data[where] = value
        return bytes(data)

    def double(spot: tuple[int, int]) -> bytes:
        a, b = sorted(spot)
        return content[:b] + content[a:b] + content[b:]

    return st.one_of(
        place.map(lambda end: content[:end]),
        st.lists(st.tuples(place, st.integers(0, 255)), min_size=1, max_size=6).map(change),
        st.tuples(place, place).map(double),
    )


def survives(folder: Path, name: str, content: bytes) -> None:
    """A damaged file is read, or refused with one line that names it; nothing else happens."""
    try:
        scene = read(write(folder, content, name))
    except MapImportError as error:
        text = str(error)
        assert name.partition(".")[0] in text
        assert "\n" not in text
        return
    for thing in scene.objects:
        for part in thing.parts:
            assert np.isfinite(part.matrix).all()
            if isinstance(part.shape, Mesh):
                triangles = part.shape.triangles
                assert not len(triangles) or triangles.max() < len(part.shape.vertices)


def refused(source: Path) -> str:
    """The message with which a file is refused: one line that begins with its name (worlds 73)."""
    message = refusal(lambda: read(source))
    assert message.startswith(str(source))
    assert "\n" not in message
    return message


def refusal(run: Callable[[], object]) -> str:
    """The message with which something is refused."""
    try:
        run()
    except MapImportError as error:
        return str(error)
    raise AssertionError("nothing was refused")


def write(folder: Path, content: str | bytes | dict[str, Any], name: str) -> Path:
    """A file of bytes, of text in UTF-8 or of JSON, with the folders above it."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, dict):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def writer(name: str) -> Callable[..., Path]:
    """`write` with a name for files that get no other."""
    return lambda folder, content, name=name: write(folder, content, name)


FUZZ = settings(max_examples=40, suppress_health_check=list(HealthCheck), deadline=None)
"""For tests that draw what is wrong with a file, which they write into a folder of their own."""


# ---- the wedge in every format -----------------------------------------------------------------


def obj(points: str = "", head: str = "") -> str:
    """The wedge as OBJ, y up as most programs write it."""
    rows = [f"v {x:g} {y:g} {z:g}" for x, y, z in upright(WEDGE)]
    faces = ["f " + " ".join(str(i + 1) for i in face) for face in FACES]
    return "\n".join([head, *rows, points, *faces, ""])


def stl_binary(title: bytes = b"made by hand") -> bytes:
    """The wedge."""
    facets = b"".join(
        np.concatenate([np.zeros(3), WEDGE[face].ravel()]).astype("<f4").tobytes() + b"\0\0"
        for face in FACES
    )
    return title.ljust(80, b" ") + struct.pack("<I", len(FACES)) + facets


def stl_text(name: str = "wedge", new_line: str = "\n") -> str:
    """The wedge."""
    lines = [f"solid {name}"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {:g} {:g} {:g}".format(*WEDGE[i]) for i in face]
        lines += ["endloop", "endfacet"]
    return new_line.join([*lines, f"endsolid {name}", ""])


PLY_HEAD = (
    "ply\nformat {order} 1.0\ncomment by hand\nelement vertex 4\nproperty float x\n"
    "property float y\nproperty double z\nelement face 4\nproperty uchar material\n"
    "property list uchar int vertex_indices\nend_header\n"
)


def ply_text() -> bytes:
    """The wedge as text."""
    rows = ["{:g} {:g} {:g}".format(*point) for point in WEDGE]
    rows += ["7 3 {} {} {}".format(*face) for face in FACES]
    return (PLY_HEAD.format(order="ascii") + "\n".join(rows) + "\n").encode()


def ply_binary(order: str) -> bytes:
    """The wedge as bytes, `<` or `>`."""
    word = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    content = PLY_HEAD.format(order=word).encode()
    for x, y, z in WEDGE.tolist():
        content += struct.pack(order + "ffd", x, y, z)
    for face in FACES.tolist():
        content += struct.pack(order + "BB3i", 7, 3, *face)
    return content


SQUARE = "0 0 0 1 0 0 1 1 0 0 1 0"


def dae_source(name: str, numbers: str, stride: int = 3) -> str:
    """An array with its accessor."""
    count = len(numbers.split())
    return (
        f'<source id="{name}"><float_array id="{name}-a" count="{count}">{numbers}</float_array>'
        f'<technique_common><accessor source="#{name}-a" count="{count // stride}" '
        f'stride="{stride}"/></technique_common></source>'
    )


def dae_geometry(primitives: str, points: str = SQUARE, more: str = "", name: str = "g") -> str:
    """A geometry whose vertices are called `v`."""
    return (
        f'<geometry id="{name}"><mesh>{dae_source(name + "-p", points)}{more}'
        f'<vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/></vertices>'
        f"{primitives}</mesh></geometry>"
    )


def dae(
    geometries: str,
    nodes: str = '<node name="n"><instance_geometry url="#g"/></node>',
    asset: str = "<up_axis>Z_UP</up_axis>",
    more: str = "",
) -> str:
    """A whole file."""
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">\n'
        f"<asset>{asset}</asset>\n{more}\n<library_geometries>{geometries}</library_geometries>\n"
        f'<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene>'
        "</library_visual_scenes>\n"
        '<scene><instance_visual_scene url="#s"/></scene>\n</COLLADA>\n'
    )


VERTEX = '<input semantic="VERTEX" source="#g-v" offset="0"/>'
TRIANGLES = f'<triangles count="4">{VERTEX}<p>{" ".join(map(str, FACES.ravel()))}</p></triangles>'


def dae_wedge(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]] = WEDGE) -> str:
    """The wedge as a geometry."""
    return dae_geometry(TRIANGLES, " ".join(f"{value:g}" for value in points.ravel()))


DAE_LOOKS = (
    '<library_images><image id="img"><init_from>{file}</init_from></image></library_images>'
    '<library_effects><effect id="fx"><profile_COMMON>'
    '<newparam sid="surf"><surface type="2D"><init_from>img</init_from></surface></newparam>'
    '<newparam sid="samp"><sampler2D><source>surf</source></sampler2D></newparam>'
    '<technique sid="common"><phong><diffuse><texture texture="samp" texcoord="UV"/></diffuse>'
    "</phong></technique></profile_COMMON></effect>"
    '<effect id="fx2"><profile_COMMON><technique sid="common"><lambert><diffuse>'
    "<color>0.1 0.2 0.3 1</color></diffuse></lambert></technique></profile_COMMON></effect>"
    '</library_effects><library_materials><material id="brick"><instance_effect url="#fx"/>'
    '</material><material id="paint"><instance_effect url="#fx2"/></material>'
    "</library_materials>"
)
"""Materials: `brick` has a picture, `paint` a colour."""


def dae_bound(material: str) -> str:
    """A node that shows the wedge with a material for its symbol `sym`."""
    return (
        '<node name="n"><instance_geometry url="#g"><bind_material><technique_common>'
        f'<instance_material symbol="sym" target="#{material}"/></technique_common>'
        "</bind_material></instance_geometry></node>"
    )


def dae_textured(file: str, material: str = "brick") -> str:
    """The wedge with a bound material."""
    shape = dae_wedge().replace("<triangles ", '<triangles material="sym" ')
    return dae(shape, dae_bound(material), more=DAE_LOOKS.format(file=file))


X3D_POINTS = ", ".join("{:g} {:g} {:g}".format(*point) for point in upright(WEDGE))
X3D_INDEX = " ".join("{} {} {} -1".format(*face) for face in FACES)


def x3d(body: str, head: str = "") -> str:
    """A file in XML."""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<X3D profile="Interchange" version="3.3"><head>{head}</head>\n'
        f"<Scene>\n{body}\n</Scene></X3D>\n"
    )


def x3d_shape(geometry: str, look: str = "") -> str:
    """A shape in XML."""
    return f"<Shape>{look}{geometry}</Shape>"


X3D_FACE_SET = (
    f'<IndexedFaceSet coordIndex="{X3D_INDEX}"><Coordinate point="{X3D_POINTS}"/></IndexedFaceSet>'
)
X3D_WEDGE = x3d(f'<Transform DEF="Wedge">{x3d_shape(X3D_FACE_SET)}</Transform>')


VRML_WEDGE = f"""#VRML V2.0 utf8
# a comment with {{ brackets }} in it
WorldInfo {{ title "a }} that is text" info [ "one" "two" ] }}
PROTO Lamp [ field SFColor color 1 1 1 ] {{ PointLight {{ color IS color }} }}
DEF Wedge Transform {{ translation 0 0 0
  children [ Shape {{
    appearance Appearance {{ material DEF Red Material {{ diffuseColor 1, 0, 0 }} }}
    geometry IndexedFaceSet {{ solid TRUE coord Coordinate {{ point [ {X3D_POINTS} ] }}
      coordIndex [ {X3D_INDEX} ] }}
  }} ]
}}
DEF Script1 Script {{ field SFTime start 0 eventIn SFBool go url "javascript: x()" }}
ROUTE Script1.go TO Wedge.translation
"""


OFF = "OFF\n# by hand\n4 4 6\n" + "".join(
    [*("{:g} {:g} {:g}\n".format(*point) for point in WEDGE),
     *("3 {} {} {}\n".format(*face) for face in FACES)]
)  # fmt: skip


def threemf(unit: str = "millimeter") -> bytes:
    """The wedge and its copy 5 units further, as slicers write it."""
    vertices = "".join('<vertex x="{:g}" y="{:g}" z="{:g}"/>'.format(*p) for p in WEDGE)
    triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*f) for f in FACES)
    model = (
        '<?xml version="1.0" encoding="UTF-8"?>'
        f'<model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f'<resources><object id="1" name="Wedge" type="model"><mesh><vertices>{vertices}</vertices>'
        f"<triangles>{triangles}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/>'
        '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 0"/></build></model>'
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", model)
    return stream.getvalue()


def xaml() -> str:
    """The wedge as SolidWorks writes it."""
    positions = " ".join(f"{value:g}" for value in WEDGE[FACES.ravel()].ravel())
    normals = " ".join("0 0 1" for _ in range(12))
    indices = " ".join(str(number) for number in range(12))
    return (
        '<ModelVisual3D xmlns="http://schemas.microsoft.com/winfx/2006/xaml/presentation">'
        "<ModelVisual3D.Content><GeometryModel3D><GeometryModel3D.Geometry>"
        f'<MeshGeometry3D Positions="{positions}" Normals="{normals}" TriangleIndices="{indices}"/>'
        "</GeometryModel3D.Geometry><GeometryModel3D.Material><DiffuseMaterial>"
        '<DiffuseMaterial.Brush><SolidColorBrush Color="#FF0000" Opacity="1.0"/>'
        "</DiffuseMaterial.Brush></DiffuseMaterial></GeometryModel3D.Material></GeometryModel3D>"
        "</ModelVisual3D.Content></ModelVisual3D>"
    )


ASE = """*3DSMAX_ASCIIEXPORT\t200
*MATERIAL_LIST {
\t*MATERIAL_COUNT 1
\t*MATERIAL 0 {
\t\t*MATERIAL_NAME "Stone"
\t\t*MAP_DIFFUSE {
\t\t\t*BITMAP "C:\\\\art\\\\Stone.tga"
\t\t}
\t}
}
*GEOMOBJECT {
\t*NODE_NAME "Pyramid"
\t*MESH {
\t\t*MESH_NUMVERTEX 4
\t\t*MESH_VERTEX_LIST {
\t\t\t*MESH_VERTEX 0 0.0 0.0 0.0
\t\t\t*MESH_VERTEX 1 250.0 0.0 0.0
\t\t\t*MESH_VERTEX 2 0.0 500.0 0.0
\t\t\t*MESH_VERTEX 3 0.0 0.0 250.0
\t\t}
\t\t*MESH_FACE_LIST {
\t\t\t*MESH_FACE 0: A: 0 B: 2 C: 1 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0
\t\t\t*MESH_FACE 1: A: 0 B: 1 C: 3 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0
\t\t\t*MESH_FACE 2: A: 0 B: 3 C: 2 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0
\t\t\t*MESH_FACE 3: A: 1 B: 2 C: 3 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0
\t\t}
\t\t*MESH_TVERTLIST {
\t\t\t*MESH_TVERT 0 0.0 0.0 0.0
\t\t\t*MESH_TVERT 1 1.0 0.5 0.0
\t\t}
\t\t*MESH_TFACELIST {
\t\t\t*MESH_TFACE 0 0 0 1
\t\t\t*MESH_TFACE 1 0 1 0
\t\t\t*MESH_TFACE 2 0 0 0
\t\t\t*MESH_TFACE 3 1 1 1
\t\t}
\t}
\t*MATERIAL_REF 0
}
"""
"""A pyramid of 250 and 500 Unreal units."""
