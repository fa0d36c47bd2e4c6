"""glTF and GLB (worlds reference 2.4 and 13, item 41), also compressed by Draco."""

from __future__ import annotations

import base64
import json
import math
import struct
import sys
from pathlib import Path
from typing import Any

import DracoPy
import numpy as np
import pytest
from gltf_samples import GLTF_BLOB, GLTF_INDICES, GLTF_POINTS, GLTF_UVS, glb, gltf, png
from hypothesis import given
from hypothesis import strategies as st
from mesh_samples import (
    FACES,
    FUZZ,
    WEDGE,
    WEDGE_PLACES,
    places,
    read,
    refusal,
    refused,
    survives,
    upright,
    volume,
    whole,
    writer,
)

from usarsim_maps.findings import Findings
from usarsim_maps.scene import LightKind, Mesh
from usarsim_server.simulation.frames import rpy_from_quaternion

write = writer("map.gltf")


class TestForms:
    """Text and binary, three places for buffers."""

    def test_binary_and_file_of_its_own(self, tmp_path: Path) -> None:
        """GLB, and a buffer in a file with a blank in its name, give the same."""
        assert places(whole(read(write(tmp_path, glb(gltf()), "a.glb")))) == WEDGE_PLACES
        (tmp_path / "my data.bin").write_bytes(GLTF_BLOB)
        apart = gltf(buffers=[{"byteLength": len(GLTF_BLOB), "uri": "my%20data.bin"}])
        scene = read(write(tmp_path, apart))
        assert places(whole(scene)) == WEDGE_PLACES
        assert tmp_path / "my data.bin" in scene.source.files

    def test_scale_of_the_user(self, tmp_path: Path) -> None:
        """A scale replaces the metre, for nodes and vertices alike."""
        nodes = [{"mesh": 0, "translation": [10, 0, 0]}]
        mesh = whole(read(write(tmp_path, gltf(nodes=nodes)), scale=10.0))
        assert mesh.vertices.min(axis=0) == pytest.approx([1.0, 0.0, 0.0])
        assert volume(mesh) == pytest.approx(0.001)


class TestNodes:
    """Transformations."""

    def test_nested_nodes_share_meshes(self, tmp_path: Path) -> None:
        """Two nodes of one mesh share it; their matrices multiply from parent to child."""
        nodes = [
            {"children": [1, 2], "translation": [0, 0, 5]},
            {"name": "A", "mesh": 0, "scale": [1, 2, 1]},
            {"name": "B", "mesh": 0, "rotation": [0, math.sqrt(0.5), 0, math.sqrt(0.5)]},
        ]
        a, b = read(write(tmp_path, gltf(nodes=nodes))).objects
        assert a.parts[0].shape is b.parts[0].shape
        assert a.pose.position == pytest.approx((0.0, -5.0, 0.0))
        _, _, yaw = rpy_from_quaternion(b.pose.quaternion)
        assert yaw == pytest.approx(math.pi / 2)
        tall = a.parts[0].shape.vertices @ a.parts[0].matrix[:3, :3].T
        assert np.ptp(tall, axis=0) == pytest.approx([2.0, 1.0, 6.0])

    def test_matrix_and_reflection(self, tmp_path: Path) -> None:
        """A matrix is stored by columns; a reflecting one keeps faces outwards."""
        matrix = [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]
        mesh = whole(read(write(tmp_path, gltf(nodes=[{"mesh": 0, "matrix": matrix}]))))
        assert mesh.vertices[:, 0].min() == pytest.approx(1.0)
        assert volume(mesh) == pytest.approx(1.0)

    def test_instances(self, tmp_path: Path) -> None:
        """EXT_mesh_gpu_instancing gives an object for every instance."""
        where = np.array([[0, 0, 0], [0, 0, -4]]).astype("<f4").tobytes()
        value = gltf(
            nodes=[{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {
                "attributes": {"TRANSLATION": 3}}}}],
        )  # fmt: skip
        value["bufferViews"].append({"buffer": 0, "byteOffset": len(GLTF_BLOB), "byteLength": 24})
        value["accessors"].append(
            {"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"}
        )
        scene = read(write(tmp_path, glb(value, GLTF_BLOB + where), "a.glb"))
        assert [t.pose.position[1] for t in scene.objects] == pytest.approx([0.0, 4.0])

    def test_markers(self, tmp_path: Path, findings: Findings) -> None:
        """Empty nodes with telling names become starts, victims and path nodes; x is forward."""
        turn = [0, math.sqrt(0.5), 0, math.sqrt(0.5)]
        nodes = [
            {"mesh": 0},
            {"name": "PlayerStart.001", "translation": [1, 2, -3], "rotation": turn},
            {"name": "RobotStart", "extras": {"tag": "Gate"}},
            {"name": "FemaleVictim_0"},
            {"name": "PathNode_4"},
            {"name": "Empty"},
        ]
        value = gltf(nodes=nodes, scenes=[{"nodes": [0, 1, 2, 3, 4, 5]}])
        scene = read(write(tmp_path, value), findings)
        assert [start.tag for start in scene.starts] == ["PlayerStart.001", "Gate"]
        assert scene.starts[0].pose.position == pytest.approx((1.0, 3.0, 2.0))
        assert rpy_from_quaternion(scene.starts[0].pose.quaternion) == pytest.approx(
            (0.0, 0.0, math.pi / 2)
        )
        assert scene.victims[0].properties["figure"] == "female"
        assert scene.path_nodes[0].tag == "PathNode_4"
        assert findings.classes["empty node"] == 1

    def test_custom_properties(self, tmp_path: Path) -> None:
        """Tag, movable and mass come from extras (worlds 29, 69)."""
        extras = {"tag": "Box", "movable": 1, "mass": 2.5}
        (thing,) = read(write(tmp_path, gltf(nodes=[{"mesh": 0, "extras": extras}]))).objects
        assert (thing.tag, thing.movable, thing.mass) == ("Box", True, 2.5)

    def test_lights(self, tmp_path: Path) -> None:
        """A spot shines along -z of its node; ambient colour and cone are kept (worlds 76)."""
        lights = [{"type": "spot", "color": [1, 0.5, 0], "intensity": 20,
                   "spot": {"outerConeAngle": 0.5}}]  # fmt: skip
        value = gltf(extensions={"KHR_lights_punctual": {"lights": lights}})
        value["nodes"].append(
            {"name": "Lamp", "translation": [0, 3, 0],
             "extensions": {"KHR_lights_punctual": {"light": 0}}}
        )  # fmt: skip
        value["scenes"] = [{"nodes": [0, 1]}]
        (light,) = read(write(tmp_path, value)).lights
        assert light.kind is LightKind.SPOT
        assert light.position == pytest.approx((0.0, 0.0, 3.0))
        assert light.direction == pytest.approx((0.0, 1.0, 0.0))
        assert light.color == (1.0, 0.5, 0.0)
        assert light.cone == pytest.approx(math.degrees(0.5))


class TestPrimitives:
    """Kinds of faces and numbers."""

    @pytest.mark.parametrize(
        ("mode", "chain", "count"), [(5, [0, 2, 1, 3], 2), (6, [0, 2, 1, 3], 2), (1, [0, 1], 0)]
    )
    def test_modes(self, tmp_path: Path, mode: int, chain: list[int], count: int) -> None:
        """Strips and fans give their triangles; lines give none."""
        blob = GLTF_POINTS + GLTF_UVS + np.array(chain).astype("<u2").tobytes()
        value = gltf()
        value["meshes"][0]["primitives"][0]["mode"] = mode
        value["accessors"][2]["count"] = len(chain)
        value["bufferViews"][1]["byteLength"] = 2 * len(chain)
        scene = read(write(tmp_path, glb(value, blob), "a.glb"))
        shapes = [thing.parts[0].shape for thing in scene.objects]
        assert sum(len(s.triangles) for s in shapes if isinstance(s, Mesh)) == count

    def test_quantized_positions(self, tmp_path: Path) -> None:
        """Normalized short integers are parts of one (KHR_mesh_quantization)."""
        short = np.round(upright(WEDGE) / 3.0 * 32767).astype("<i2").tobytes()
        value = gltf(
            extensionsRequired=["KHR_mesh_quantization"],
            nodes=[{"mesh": 0, "scale": [3, 3, 3]}],
            bufferViews=[
                {"buffer": 0, "byteLength": 24},
                {"buffer": 0, "byteOffset": 24, "byteLength": 24},
            ],
        )
        value["accessors"][0] |= {"componentType": 5122, "normalized": True}
        value["meshes"][0]["primitives"][0]["attributes"] = {"POSITION": 0}
        mesh = whole(read(write(tmp_path, glb(value, short + GLTF_INDICES), "a.glb")))
        assert volume(mesh) == pytest.approx(1.0, abs=1e-3)

    def test_sparse_accessor(self, tmp_path: Path) -> None:
        """Sparse values replace those of the buffer."""
        more = struct.pack("<H2x3f", 3, 0.0, 6.0, 0.0)
        value = gltf()
        value["bufferViews"] += [
            {"buffer": 0, "byteOffset": len(GLTF_BLOB), "byteLength": 2},
            {"buffer": 0, "byteOffset": len(GLTF_BLOB) + 4, "byteLength": 12},
        ]
        value["accessors"][0]["sparse"] = {
            "count": 1,
            "indices": {"bufferView": 2, "componentType": 5123},
            "values": {"bufferView": 3},
        }
        mesh = whole(read(write(tmp_path, glb(value, GLTF_BLOB + more), "a.glb")))
        assert mesh.vertices[:, 2].max() == pytest.approx(6.0)


class TestMaterials:
    """Colours and pictures."""

    def test_colour_factor(self, tmp_path: Path) -> None:
        """Linear factors become the colours that screens show; opacity counts where it is on."""
        value = gltf()
        value["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0.214, 0, 0.3]
        assert read(write(tmp_path, value)).materials["red"].color == pytest.approx(
            (1.0, 0.5, 0.0, 1.0), abs=0.01
        )
        value["materials"][0]["alphaMode"] = "BLEND"
        assert read(write(tmp_path, value)).materials["red"].color[3] == 0.3

    @pytest.mark.parametrize("how", ["view", "data", "file"])
    def test_pictures(self, tmp_path: Path, how: str) -> None:
        """Pictures inside the file, in a URI, or beside it; v upwards with transformation."""
        image = png()
        value = gltf()
        value["bufferViews"].append({"buffer": 0, "byteOffset": len(GLTF_BLOB),
                                     "byteLength": len(image)})  # fmt: skip
        data = "data:image/png;base64," + base64.b64encode(image).decode()
        entry = {"view": {"bufferView": 2}, "data": {"uri": data}, "file": {"uri": "Red.png"}}
        (tmp_path / "red.PNG").write_bytes(image)
        transform = {"KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 1]}}
        value["images"] = [entry[how]]
        value["textures"] = [{"source": 0}]
        value["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {
            "index": 0,
            "extensions": transform,
        }
        scene = read(write(tmp_path, glb(value, GLTF_BLOB + image), "a.glb"))
        material = scene.materials["red"]
        if how == "file":
            assert material.texture == tmp_path / "red.PNG"
        else:
            assert material.image == image
        mesh = whole(scene)
        corner = mesh.uvs[mesh.triangles == 1][0]
        assert corner == pytest.approx([2.5, 1.0])

    def test_equal_names(self, tmp_path: Path) -> None:
        """Two materials of one name stay two."""
        value = gltf(materials=[{"name": "red"}, {"name": "red"}])
        assert len(read(write(tmp_path, value)).materials) == 2


class TestBadFiles:
    """Errors."""

    @pytest.mark.parametrize(
        ("changes", "told"),
        [
            ({"asset": {"version": "1.0"}}, "version 1.0"),
            ({"extensionsRequired": ["EXT_primitive_voxels"]}, "EXT_primitive_voxels"),
            ({"nodes": [{"mesh": 5}]}, "nodes[0]"),
            ({"nodes": [{"children": [0]}]}, "nodes[0]"),
            ({"nodes": 7}, "nodes"),
            ({"scenes": [{"nodes": [-1]}]}, "scenes[0]"),
            ({"buffers": [{"uri": "gone.bin", "byteLength": 9}]}, "gone.bin"),
            ({"bufferViews": [{"buffer": 0, "byteLength": 10**11}]}, "bufferViews[0]"),
        ],
    )
    def test_what_is_wrong(self, tmp_path: Path, changes: dict[str, Any], told: str) -> None:
        """Errors name file and place (worlds 73)."""
        assert told in refused(write(tmp_path, gltf(**changes)))

    def test_absurd_accessor(self, tmp_path: Path) -> None:
        """Accessors of billions of values are refused before memory is taken."""
        for change in ({"count": 10**10}, {"count": 10**10, "bufferView": None}):
            value = gltf()
            value["accessors"][0] |= change
            if "bufferView" in change:
                del value["accessors"][0]["bufferView"]
            assert "accessors[0]" in refused(write(tmp_path, value))

    def test_broken_json(self, tmp_path: Path) -> None:
        """The line of a syntax error is named; deep nesting is refused."""
        text = json.dumps(gltf(), indent=1).replace('"scene": 0,', '"scene" 0,')
        assert "line 5" in refusal(lambda: read(write(tmp_path, text.encode())))
        deep = b'{"asset":' + b"[" * 100_000
        assert "map.gltf" in refusal(lambda: read(write(tmp_path, deep)))

    @FUZZ
    @given(st.data())
    def test_wrong_values(self, tmp_path: Path, data: st.DataObject) -> None:
        """Any value replaced by any other is read or refused in one line."""
        value = gltf()
        spots: list[tuple[Any, Any]] = []

        def collect(inner: Any) -> None:
            keys = inner.keys() if isinstance(inner, dict) else range(len(inner))
            for key in list(keys):
                spots.append((inner, key))
                if isinstance(inner[key], dict | list):
                    collect(inner[key])

        collect(value)
        owner, key = data.draw(st.sampled_from(spots))
        owner[key] = data.draw(
            st.one_of(st.none(), st.booleans(), st.integers(-5, 10**12), st.floats(),
                      st.text(max_size=5), st.just([]), st.just({}), st.just([1, 2, 3]))
        )  # fmt: skip
        survives(tmp_path, "map.gltf", json.dumps(value).encode())


EXTENSION = "KHR_draco_mesh_compression"
PLACES = np.array([[0, 0], [1, 0], [0, 1], [0.25, 0.5]])
DRACO = DracoPy.encode(
    upright(WEDGE), FACES.astype(np.uint32), quantization_bits=16, tex_coord=PLACES
)


def packed(content: bytes = DRACO, **attributes: int) -> dict[str, Any]:
    """The wedge as glTF with a compressed primitive; its accessors hold no data."""
    found = {item["attribute_type"]: item["unique_id"] for item in DracoPy.decode(DRACO).attributes}
    ids = {"POSITION": found[0], "TEXCOORD_0": found[3]} | attributes
    value = gltf()
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


def test_draco(tmp_path: Path) -> None:
    """Places, sides and material are those of the plain file, to the quantization."""
    scene = read(write(tmp_path, glb(packed(), DRACO), "map.glb"))
    mesh = whole(scene)
    assert volume(mesh) == pytest.approx(1.0, rel=1e-3)
    assert mesh.vertices.max(axis=0) == pytest.approx(WEDGE.max(axis=0), abs=1e-3)
    assert list(scene.materials) == ["red"]


def test_without_draco(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says how to get it."""
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    message = refused(write(tmp_path, glb(packed(), DRACO), "map.glb"))
    assert "meshes compressed by Draco need the Python package 'DracoPy'" in message
    assert "usarsim-server[meshes]" in message


@pytest.mark.parametrize(
    ("value", "blob", "told"),
    [
        (packed(), DRACO[:30] + bytes(len(DRACO) - 30), "Draco cannot decompress it"),
        (packed(POSITION=77), DRACO, "attribute 77 (POSITION)"),
    ],
)
def test_what_is_wrong_with_draco(
    tmp_path: Path, value: dict[str, Any], blob: bytes, told: str
) -> None:
    """One line that names file and place (worlds 73)."""
    message = refused(write(tmp_path, glb(value, blob), "map.glb"))
    assert told in message
    assert "meshes[0].primitives[0]" in message


@FUZZ
@given(st.lists(st.tuples(st.integers(0, len(DRACO) - 1), st.integers(0, 255)), max_size=4))
def test_damaged_draco(tmp_path: Path, spots: list[tuple[int, int]]) -> None:
    """Are read or refused, nothing else (worlds 73)."""
    blob = bytearray(DRACO)
    for place, value in spots:
        blob[place] = value
    survives(tmp_path, "map.glb", glb(packed(), bytes(blob)))
