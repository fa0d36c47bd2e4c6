"""What holds for every format of meshes (worlds reference 2.4 and 13, items 9, 10, 41, 42, 73)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_samples import (
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
    glb,
    gltf,
    obj,
    places,
    ply_binary,
    ply_text,
    read,
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
