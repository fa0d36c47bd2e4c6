"""glTF whose meshes are compressed by Draco (KHR_draco_mesh_compression)."""

from __future__ import annotations

import copy
import sys
from pathlib import Path
from typing import Any

import DracoPy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_samples import FACES, WEDGE, refused, survives, upright, volume, whole
from test_maps_gltf import document, glb, read, write

EXTENSION = "KHR_draco_mesh_compression"
UVS = np.array([[0, 0], [1, 0], [0, 1], [0.25, 0.5]])
BLOB = DracoPy.encode(upright(WEDGE), FACES.astype(np.uint32), quantization_bits=16, tex_coord=UVS)


def packed(content: bytes = BLOB, **attributes: int) -> dict[str, Any]:
    """The wedge as glTF with a compressed primitive; its accessors hold no data."""
    found = {item["attribute_type"]: item["unique_id"] for item in DracoPy.decode(BLOB).attributes}
    ids = {"POSITION": found[0], "TEXCOORD_0": found[3]} | attributes
    value = copy.deepcopy(document())
    primitive = value["meshes"][0]["primitives"][0]
    primitive["extensions"] = {EXTENSION: {"bufferView": 0, "attributes": ids}}
    value["accessors"] = [
        {"componentType": 5126, "count": 4, "type": "VEC3"},
        {"componentType": 5126, "count": 4, "type": "VEC2"},
        {"componentType": 5125, "count": 12, "type": "SCALAR"},
    ]
    value["bufferViews"] = [{"buffer": 0, "byteLength": len(content)}]
    value["extensionsUsed"] = value["extensionsRequired"] = [EXTENSION]
    return value


def test_wedge(tmp_path: Path) -> None:
    """Places, sides and material are those of the plain file, to the quantization."""
    scene = read(write(tmp_path, glb(packed(), BLOB), "map.glb"))
    mesh = whole(scene)
    assert volume(mesh) == pytest.approx(1.0, rel=1e-3)
    assert mesh.vertices.max(axis=0) == pytest.approx(WEDGE.max(axis=0), abs=1e-3)
    assert list(scene.materials) == ["red"]


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says how to get it."""
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    message = refused(write(tmp_path, glb(packed(), BLOB), "map.glb"))
    assert "meshes compressed by Draco need the Python package 'DracoPy'" in message
    assert "usarsim-server[meshes]" in message


@pytest.mark.parametrize(
    ("value", "blob", "told"),
    [
        (packed(), BLOB[:30] + bytes(len(BLOB) - 30), "Draco cannot decompress it"),
        (packed(POSITION=77), BLOB, "attribute 77 (POSITION)"),
    ],
)
def test_what_is_wrong(tmp_path: Path, value: dict[str, Any], blob: bytes, told: str) -> None:
    """One line that names file and place (item 73)."""
    message = refused(write(tmp_path, glb(value, blob), "map.glb"))
    assert told in message
    assert "meshes[0].primitives[0]" in message
    assert "\n" not in message


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.integers(0, len(BLOB) - 1), st.integers(0, 255)), max_size=4))
def test_damaged_buffers(
    tmp_path_factory: pytest.TempPathFactory, spots: list[tuple[int, int]]
) -> None:
    """Are read or refused, nothing else (item 73)."""
    blob = bytearray(BLOB)
    for place, value in spots:
        blob[place] = value
    survives(tmp_path_factory.mktemp("draco"), "map.glb", glb(packed(), bytes(blob)))
