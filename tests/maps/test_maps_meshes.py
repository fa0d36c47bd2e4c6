"""What holds for every format of meshes (worlds reference 2.4 and 13, items 9, 10, 41, 42, 73)."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from gltf_samples import glb, gltf
from hypothesis import given
from hypothesis import strategies as st
from mesh_samples import (
    ASE,
    FUZZ,
    OFF,
    VRML_WEDGE,
    WEDGE,
    WEDGE_PLACES,
    X3D_WEDGE,
    dae,
    dae_textured,
    dae_wedge,
    damages,
    obj,
    places,
    ply_binary,
    ply_text,
    read,
    refused,
    stl_binary,
    stl_text,
    survives,
    threemf,
    volume,
    whole,
    write,
    xaml,
)
from sdf_samples import BOX, PLUGIN, model, shape, world

STATED = {
    "map.gltf": gltf(),
    "map.glb": glb(gltf()),
    "map.dae": dae(dae_wedge()),
    "map.x3d": X3D_WEDGE,
    "map.wrl": VRML_WEDGE,
}
"""Formats that say what their units are."""

Z_UP = {
    "binary.stl": stl_binary(),
    "solid.stl": stl_binary(b"solid but binary"),
    "text.stl": stl_text(),
    "crlf.stl": stl_text(new_line="\r\n"),
    "text.ply": ply_text(),
    "crlf.ply": ply_text().replace(b"\n", b"\r\n"),
    "little.ply": ply_binary("<"),
    "big.ply": ply_binary(">"),
    "map.off": OFF,
    "map.xaml": xaml(),
}
"""Formats that know neither units nor axes."""

FORMS = {**STATED, **Z_UP, "map.obj": obj()}


@pytest.mark.parametrize("name", FORMS)
def test_the_wedge(tmp_path: Path, name: str) -> None:
    """All forms give the same mesh: upright, unmirrored, faces outwards, in metres.

    Whether the unit was assumed is stated; with a scale of the user's nothing is.
    """
    path = write(tmp_path, FORMS[name], name)
    scene = read(path)
    mesh = whole(scene)
    assert places(mesh) == WEDGE_PLACES
    assert len(mesh.triangles) == 4
    assert volume(mesh) == pytest.approx(1.0)
    assert scene.source.assumed == (name not in STATED)
    scaled = read(path, scale=2.0)
    assert volume(whole(scaled)) == pytest.approx(1 / 8)
    assert scaled.source.units_per_metre == 2.0
    assert not scaled.source.assumed


@pytest.mark.parametrize("name", Z_UP)
def test_millimetres_and_another_axis(tmp_path: Path, name: str) -> None:
    """On request."""
    scene = read(write(tmp_path, FORMS[name], name), scale=1000.0, up="Y")
    expected = sorted((np.round(WEDGE[:, [0, 2, 1]] * [1, -1, 1] / 1000.0, 6) + 0.0).tolist())
    assert places(whole(scene)) == expected


@pytest.mark.parametrize("name", ["map.wrl", "map.x3d", "map.off", "map.glb", "map.dae"])
def test_found_without_extension(tmp_path: Path, name: str) -> None:
    """The first bytes say what it is."""
    assert places(whole(read(write(tmp_path, FORMS[name], "map")))) == WEDGE_PLACES


LAMP = '<light type="point" name="l"><pose>0 0 1 0 0 0</pose></light>'
MESH = shape("<mesh><uri>w.dae</uri><scale>1 2 3</scale></mesh>")
DAMAGED = {
    **FORMS,
    "map.ase": ASE,
    "looks.obj": "o a\nusemtl b\nvt 0 1\n" + obj() + "f 1/1 2/1 3/1 4/1\n",
    "looks.dae": dae_textured("a.png"),
    "map.3mf": threemf(),
    "map.world": world(model("m", BOX, static=False) + PLUGIN + LAMP + model("n", MESH)),
}


@pytest.mark.parametrize("name", DAMAGED)
@FUZZ
@given(data=st.data())
def test_damaged_files(tmp_path: Path, name: str, data: st.DataObject) -> None:
    """Whatever is wrong with a file, it is read or refused in one line."""
    write(tmp_path, dae(dae_wedge()), "w.dae")
    content = write(tmp_path, DAMAGED[name], name).read_bytes()
    survives(tmp_path, name, data.draw(damages(content)))


def swapped(content: str | bytes, old: str, new: str) -> str:
    """The text with its first `old` exchanged."""
    text = content.decode() if isinstance(content, bytes) else content
    assert old in text
    return text.replace(old, new, 1)


DAE, PLY, STL = dae(dae_wedge()), ply_text(), stl_text()
FOUR_THOUSAND_MILLIONS = b" " * 80 + struct.pack("<I", 0xFFFFFFFF) + b"\0" * 500


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("map.obj", "v 0 0 0\nv 1 x 0\n", "map.obj: line 2:"),
        ("map.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2 9\n", "map.obj: line 5:"),
        ("map.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "map.obj: line 4:"),
        ("map.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/x 2/1 3/1\n", "map.obj: line 4:"),
        ("map.obj", "v 0 0\n", "map.obj: line 1:"),
        ("map.stl", FOUR_THOUSAND_MILLIONS, "4294967295 triangles are announced, 10 are there"),
        ("map.stl", STL[: STL.index("endsolid")], "the file ends"),
        ("map.stl", swapped(STL, "vertex 2 0 0", "vertex 2 zero 0"), "map.stl: line 6:"),
        ("map.stl", swapped(STL, "vertex 2 0 0\n", ""), "map.stl: line 7:"),
        ("map.stl", "", "map.stl"),
        ("map.stl", "solid", "map.stl"),
        ("map.stl", "solid x\nendsolid x\n", "map.stl"),
        ("map.stl", "hello", "map.stl"),
        ("map.ply", swapped(PLY, "element face 4", "element face 0"), "points alone are not solid"),
        ("map.ply", swapped(PLY, "format ascii", "format utf8"), "line 2"),
        ("map.ply", swapped(PLY, "property float x", "property quad x"), "line 5"),
        ("map.ply", swapped(PLY, "property float x\n", ""), "no vertices with x, y and z"),
        ("map.ply", swapped(PLY, "3 0 2 1", "3 0 2 9"), "none of the 4 vertices"),
        ("map.ply", swapped(PLY, "3 0 2 1", "3 0 2 one"), "face"),
        ("map.ply", swapped(PLY, "end_header", ""), "no header"),
        ("map.dae", swapped(DAE, "</library_geometries>", ""), "map.dae: line 8:"),
        ("map.dae", swapped(DAE, " 3</p>", " 9</p>"), "index 9 of 4 entries"),
        ("map.dae", swapped(DAE, 'source="#g-p"', 'source="#gone"'), "source '#gone' is missing"),
        ("map.dae", swapped(DAE, " 3</p>", " three</p>"), "map.dae: line 5:"),
        ("map.dae", swapped(DAE, 'count="4" s', 'count="4000000000" s'), "count='4000000000'"),
        ("map.dae", swapped(DAE, 'count="4" s', 'count="1000000000" s'), "1000000000 entries"),
        ("map.dae", swapped(DAE, "<COLL", "<!DOCTYPE x [<!ENTITY a 'b'>]><COLL"), "entities"),
        ("map.x3d", swapped(X3D_WEDGE, "0 2 1 -1", "0 2 9 -1"), "line 4: IndexedFaceSet: index 9"),
        ("map.x3d", swapped(X3D_WEDGE, "0 2 1 -1", "0 x 1 -1"), "line 4"),
        ("map.x3d", swapped(X3D_WEDGE, "<Shape>", '<Shape><Box size="1 2"/>'), "rows of 3"),
        ("map.wrl", VRML_WEDGE[:300], "line"),
        ("map.wrl", "#VRML V1.0 ascii\nSeparator {}", "VRML 1"),
        ("map.wrl", "#VRML V2.0 utf8\nGroup }", "line 2"),
        ("map.off", OFF[:40], "map.off"),
        ("map.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "triangles"),
        ("map.3mf", "no archive", "map.3mf"),
        ("map.3mf", threemf()[:-30], "damaged archive"),
        ("map.xaml", "<broken", "map.xaml"),
        ("map.ase", swapped(ASE, "250.0 0.0 0.0", "250.0"), "fewer than 4 numbers"),
        ("map.ase", swapped(ASE, "*MESH_VERTEX 1", "*MESH_VERTEX 2e99"), "number without meaning"),
        ("map.ase", swapped(ASE, "A: 0 B: 2 C: 1", "A: 0 B: x C: 1"), "is no face"),
        (
            "map.ase",
            swapped(ASE, "B: 2 C: 1", "B: 2 C: 9"),
            "vertex 9, which is not there",
        ),
        ("map.ase", ASE[:700], "ends inside a block"),
    ],
)
def test_what_is_wrong(tmp_path: Path, name: str, content: str | bytes, told: str) -> None:
    """Errors name file and place, in one line (worlds 73)."""
    assert told in refused(write(tmp_path, content, name))
