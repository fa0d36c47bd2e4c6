"""ASE meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_samples import ASE, faces_out, read, whole, writer

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Collision

write = writer("map.ase")


def test_a_mesh_is_read(tmp_path: Path) -> None:
    """Vertices in metres, faces outwards, texture coordinates per corner, picture by name."""
    (tmp_path / "stone.TGA").write_bytes(b"x")
    scene = read(write(tmp_path, ASE))
    mesh = whole(scene)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), (1, 2, 1))
    assert faces_out(mesh)
    assert mesh.uvs[0].tolist() == [[0, 0], [0, 0], [1, 0.5]]
    assert mesh.materials == ("Stone",)
    assert scene.materials["Stone"].texture == tmp_path / "stone.TGA"


def test_scale_axis_and_mirror_are_obeyed(tmp_path: Path) -> None:
    """Options win; a mirrored mesh still looks outwards."""
    mesh = whole(read(write(tmp_path, ASE), scale=125.0, mirror=True))
    np.testing.assert_allclose(mesh.vertices.min(axis=0), (0, -4, 0))
    assert faces_out(mesh)
    upright = whole(read(write(tmp_path, ASE), up="Y"))
    np.testing.assert_allclose(upright.vertices.max(axis=0), (1, 0, 2))
    assert faces_out(upright)


def test_collision_pieces_are_recognised(tmp_path: Path) -> None:
    """Objects named MCDCX or UCX_ are only felt, as hulls."""
    both = ASE + ASE[ASE.index("*GEOMOBJECT") :].replace("Pyramid", "MCDCX_1")
    seen, felt = read(write(tmp_path, both)).objects
    assert seen.parts[0].visible
    assert not felt.parts[0].visible
    assert felt.parts[0].collision is Collision.HULL


OTHER = """*{word} {{
\t*NODE_NAME "Other"
\t*NODE_TM {{
\t\t*NODE_NAME "Other"
\t}}
\t*LIGHT_MAP {{
\t\t*BITMAP "C:\\\\art\\\\Cone.tga"
\t}}
\t*MATERIAL_REF 7
\t*SHAPE_LINECOUNT 1
\t*MESH {{
\t\t*MESH_VERTEX_LIST {{
\t\t\t*MESH_VERTEX 0 9000.0 9000.0 9000.0
\t\t}}
\t}}
}}
"""
"""An object that is no mesh, with all that could be taken for a mesh's."""


@pytest.mark.parametrize(
    "word",
    ["LIGHTOBJECT", "CAMERAOBJECT", "HELPEROBJECT", "SHAPEOBJECT", "BONEOBJECT", "NEWOBJECT"],
)
@pytest.mark.parametrize("first", [False, True])
def test_other_objects(tmp_path: Path, findings: Findings, word: str, first: bool) -> None:
    """Names, materials and places belong to the block in which they stand, wherever that is."""
    other = OTHER.format(word=word)
    place = ASE.index("*GEOMOBJECT")
    text = ASE[:place] + other + ASE[place:] if first else ASE + other
    scene = read(write(tmp_path, text), findings)
    (thing,) = scene.objects
    assert thing.name == "Pyramid"
    mesh = thing.parts[0].shape
    assert mesh.materials == ("Stone",)
    assert scene.materials["Stone"].texture.name == "Stone.tga"
    np.testing.assert_allclose(mesh.vertices.max(axis=0), (1, 2, 1))
    assert findings.skipped_names == {word: ["Other"]}


def test_groups(tmp_path: Path, findings: Findings) -> None:
    """Their meshes are there under their own names, not under the group's or its helper's."""
    place = ASE.index("*GEOMOBJECT")
    inside = OTHER.format(word="HELPEROBJECT") + ASE[place:]
    text = ASE[:place] + '*GROUP "A {group}" {\n' + inside + "}\n"
    assert [thing.name for thing in read(write(tmp_path, text), findings).objects] == ["Pyramid"]
    assert findings.skipped_names == {"HELPEROBJECT": ["Other"]}


def test_frames_of_an_animation(tmp_path: Path, findings: Findings) -> None:
    """Later frames of a mesh do not exchange its vertices, nor add their faces."""
    mesh = ASE[ASE.index("\t*MESH {") : ASE.index("\t*MATERIAL_REF")]
    frame = "\t*MESH_ANIMATION {\n" + mesh.replace("250.0", "9.0") + "\t}\n"
    name = '\t*TM_ANIMATION {\n\t\t*NODE_NAME "Wrong"\n\t}\n'
    text = ASE.replace("\t*MATERIAL_REF", frame + name + "\t*MATERIAL_REF")
    (thing,) = read(write(tmp_path, text), findings).objects
    assert thing.name == "Pyramid"
    assert len(thing.parts[0].shape.triangles) == 4
    np.testing.assert_allclose(thing.parts[0].shape.vertices.max(axis=0), (1, 2, 1))
    assert findings.skipped == {"MESH_ANIMATION": 1, "TM_ANIMATION": 1}


def test_maps_of_a_material(tmp_path: Path, findings: Findings) -> None:
    """The diffuse one is the picture, whatever stands behind it; it may be made of others."""
    bump = '\t\t*MAP_BUMP {\n\t\t\t*BITMAP "Bumps.tga"\n\t\t}\n'
    text = ASE.replace("\t\t*MAP_DIFFUSE", bump + "\t\t*MAP_DIFFUSE")
    text = text.replace('*BITMAP "C', '*MAP_GENERIC {\n*BITMAP "C').replace(
        'Stone.tga"', 'Stone.tga"\n}', 1
    )
    text = text.replace("\t}\n}\n*GEOM", bump + "\t}\n}\n*GEOM")
    scene = read(write(tmp_path, text), findings)
    assert scene.materials["Stone"].texture.name == "Stone.tga"
    assert findings.skipped == {"MAP_BUMP": 2}


def test_sub_materials(tmp_path: Path) -> None:
    """Faces choose among those of a material; the material itself is none of them."""
    subs = "".join(
        f'\t\t*SUBMATERIAL {k} {{\n\t\t\t*MATERIAL_NAME "{name}"\n\t\t\t*MAP_DIFFUSE {{\n'
        f'\t\t\t\t*BITMAP "{name}.png"\n\t\t\t}}\n\t\t}}\n'
        for k, name in enumerate(["Wood", "Glass"])
    )
    text = ASE.replace("\t}\n}\n*GEOM", subs + "\t}\n}\n*GEOM").replace("MTLID 0", "MTLID 1", 1)
    scene = read(write(tmp_path, text))
    mesh = scene.objects[0].parts[0].shape
    assert mesh.materials == ("Wood", "Glass")
    assert mesh.slots.tolist() == [1, 0, 0, 0]
    assert {name: m.texture.name for name, m in scene.materials.items()} == {
        "Wood": "Wood.png", "Glass": "Glass.png",
    }  # fmt: skip


def test_brackets_in_names(tmp_path: Path, findings: Findings) -> None:
    """Are no blocks."""
    text = ASE.replace('"Pyramid"', '"Pyramid {1"').replace('"Stone"', '"}{Stone}"')
    scene = read(write(tmp_path, text + OTHER.format(word="LIGHTOBJECT")), findings)
    assert [thing.name for thing in scene.objects] == ["Pyramid {1"]
    assert list(scene.materials) == ["}{Stone}"]
    assert findings.skipped_names == {"LIGHTOBJECT": ["Other"]}


def test_sub_materials_without_names(tmp_path: Path) -> None:
    """Each counts."""
    subs = "\t\t*SUBMATERIAL 0 {\n\t\t}\n\t\t*SUBMATERIAL 1 {\n\t\t}\n"
    text = ASE.replace("\t}\n}\n*GEOM", subs + "\t}\n}\n*GEOM").replace('"Stone"', '""')
    scene = read(write(tmp_path, text.replace("MTLID 0", "MTLID 1", 1)))
    assert scene.objects[0].parts[0].shape.slots.tolist() == [1, 0, 0, 0]
