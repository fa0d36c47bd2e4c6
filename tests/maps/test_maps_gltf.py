"""glTF and GLB (worlds reference 2.4 and 13, item 41)."""

from __future__ import annotations

import base64
import copy
import io
import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_samples import (
    FACES,
    WEDGE,
    WEDGE_PLACES,
    damages,
    places,
    read,
    refusal,
    refused,
    survives,
    upright,
    volume,
    whole,
)
from PIL import Image

from usarsim_maps.findings import Findings
from usarsim_maps.scene import LightKind, Mesh
from usarsim_server.simulation.frames import rpy_from_quaternion

POINTS = upright(WEDGE).astype("<f4").tobytes()
UVS = np.array([[0, 0], [1, 0], [0, 1], [0.25, 0.5]]).astype("<f4").tobytes()
INDICES = FACES.astype("<u2").tobytes()
BLOB = POINTS + UVS + INDICES


def picture() -> bytes:
    """A red PNG."""
    stream = io.BytesIO()
    Image.new("RGB", (2, 2), (255, 0, 0)).save(stream, "PNG")
    return stream.getvalue()


def document(**changes: Any) -> dict[str, Any]:
    """The wedge as glTF; keywords replace or add members of the outermost object."""
    base = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "Wedge", "mesh": 0}],
        "meshes": [{"name": "wedge", "primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 48, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 80},
            {"buffer": 0, "byteOffset": 80, "byteLength": 24},
        ],
        "buffers": [{"byteLength": len(BLOB),
            "uri": "data:application/octet-stream;base64," + base64.b64encode(BLOB).decode()}],
    }  # fmt: skip
    return copy.deepcopy(base) | changes


def glb(value: dict[str, Any], blob: bytes = BLOB) -> bytes:
    """The binary form."""
    value = copy.deepcopy(value)
    value["buffers"] = [{"byteLength": len(blob)}]
    text = json.dumps(value).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    body += struct.pack("<II", len(blob), 0x004E4942) + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def write(folder: Path, value: dict[str, Any] | bytes, name: str = "map.gltf") -> Path:
    """A file."""
    path = folder / name
    path.write_bytes(value if isinstance(value, bytes) else json.dumps(value).encode())
    return path


class TestForms:
    """Text and binary, three places for buffers."""

    def test_it_stands_upright(self, tmp_path: Path) -> None:
        """+Y of the file is up, unmirrored, faces outwards, metres (items 9, 10, 41)."""
        scene = read(write(tmp_path, document()))
        assert places(whole(scene)) == WEDGE_PLACES
        assert volume(whole(scene)) == pytest.approx(1.0)
        assert not scene.source.assumed

    def test_binary_and_file_of_its_own(self, tmp_path: Path) -> None:
        """GLB, and a buffer in a file with a blank in its name, give the same."""
        assert places(whole(read(write(tmp_path, glb(document()), "a.glb")))) == WEDGE_PLACES
        (tmp_path / "my data.bin").write_bytes(BLOB)
        apart = document(buffers=[{"byteLength": len(BLOB), "uri": "my%20data.bin"}])
        scene = read(write(tmp_path, apart))
        assert places(whole(scene)) == WEDGE_PLACES
        assert tmp_path / "my data.bin" in scene.source.files

    def test_scale_of_the_user(self, tmp_path: Path) -> None:
        """A scale replaces the metre, for nodes and vertices alike."""
        nodes = [{"mesh": 0, "translation": [10, 0, 0]}]
        mesh = whole(read(write(tmp_path, document(nodes=nodes)), scale=10.0))
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
        a, b = read(write(tmp_path, document(nodes=nodes))).objects
        assert a.parts[0].shape is b.parts[0].shape
        assert a.pose.position == pytest.approx((0.0, -5.0, 0.0))
        _, _, yaw = rpy_from_quaternion(b.pose.quaternion)
        assert yaw == pytest.approx(math.pi / 2)
        assert isinstance(a.parts[0].shape, Mesh)
        tall = a.parts[0].shape.vertices @ a.parts[0].matrix[:3, :3].T
        assert np.ptp(tall, axis=0) == pytest.approx([2.0, 1.0, 6.0])

    def test_matrix_and_reflection(self, tmp_path: Path) -> None:
        """A matrix is stored by columns; a reflecting one keeps faces outwards."""
        matrix = [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]
        mesh = whole(read(write(tmp_path, document(nodes=[{"mesh": 0, "matrix": matrix}]))))
        assert mesh.vertices[:, 0].min() == pytest.approx(1.0)
        assert volume(mesh) == pytest.approx(1.0)

    def test_instances(self, tmp_path: Path) -> None:
        """EXT_mesh_gpu_instancing gives an object for every instance."""
        where = np.array([[0, 0, 0], [0, 0, -4]]).astype("<f4").tobytes()
        value = document(
            nodes=[{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {
                "attributes": {"TRANSLATION": 3}}}}],
        )  # fmt: skip
        value["bufferViews"].append({"buffer": 0, "byteOffset": len(BLOB), "byteLength": 24})
        value["accessors"].append(
            {"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"}
        )
        scene = read(write(tmp_path, glb(value, BLOB + where), "a.glb"))
        assert [t.pose.position[1] for t in scene.objects] == pytest.approx([0.0, 4.0])

    def test_markers(self, tmp_path: Path) -> None:
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
        value = document(nodes=nodes, scenes=[{"nodes": [0, 1, 2, 3, 4, 5]}])
        findings = Findings()
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
        """Tag, movable and mass come from extras (items 29, 69)."""
        extras = {"tag": "Box", "movable": 1, "mass": 2.5}
        (thing,) = read(write(tmp_path, document(nodes=[{"mesh": 0, "extras": extras}]))).objects
        assert (thing.tag, thing.movable, thing.mass) == ("Box", True, 2.5)

    def test_lights(self, tmp_path: Path) -> None:
        """A spot shines along -z of its node; ambient colour and cone are kept (item 76)."""
        lights = [{"type": "spot", "color": [1, 0.5, 0], "intensity": 20,
                   "spot": {"outerConeAngle": 0.5}}]  # fmt: skip
        value = document(extensions={"KHR_lights_punctual": {"lights": lights}})
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
        blob = POINTS + UVS + np.array(chain).astype("<u2").tobytes()
        value = document()
        value["meshes"][0]["primitives"][0]["mode"] = mode
        value["accessors"][2]["count"] = len(chain)
        value["bufferViews"][1]["byteLength"] = 2 * len(chain)
        scene = read(write(tmp_path, glb(value, blob), "a.glb"))
        shapes = [thing.parts[0].shape for thing in scene.objects]
        assert sum(len(s.triangles) for s in shapes if isinstance(s, Mesh)) == count

    def test_quantized_positions(self, tmp_path: Path) -> None:
        """Normalized short integers are parts of one (KHR_mesh_quantization)."""
        short = np.round(upright(WEDGE) / 3.0 * 32767).astype("<i2").tobytes()
        value = document(
            extensionsRequired=["KHR_mesh_quantization"],
            nodes=[{"mesh": 0, "scale": [3, 3, 3]}],
            bufferViews=[
                {"buffer": 0, "byteLength": 24},
                {"buffer": 0, "byteOffset": 24, "byteLength": 24},
            ],
        )
        value["accessors"][0] |= {"componentType": 5122, "normalized": True}
        value["meshes"][0]["primitives"][0]["attributes"] = {"POSITION": 0}
        mesh = whole(read(write(tmp_path, glb(value, short + INDICES), "a.glb")))
        assert volume(mesh) == pytest.approx(1.0, abs=1e-3)

    def test_sparse_accessor(self, tmp_path: Path) -> None:
        """Sparse values replace those of the buffer."""
        more = struct.pack("<H2x3f", 3, 0.0, 6.0, 0.0)
        value = document()
        value["bufferViews"] += [
            {"buffer": 0, "byteOffset": len(BLOB), "byteLength": 2},
            {"buffer": 0, "byteOffset": len(BLOB) + 4, "byteLength": 12},
        ]
        value["accessors"][0]["sparse"] = {
            "count": 1,
            "indices": {"bufferView": 2, "componentType": 5123},
            "values": {"bufferView": 3},
        }
        mesh = whole(read(write(tmp_path, glb(value, BLOB + more), "a.glb")))
        assert mesh.vertices[:, 2].max() == pytest.approx(6.0)


class TestMaterials:
    """Colours and pictures."""

    def test_colour_factor(self, tmp_path: Path) -> None:
        """Linear factors become the colours that screens show; opacity counts where it is on."""
        value = document()
        value["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0.214, 0, 0.3]
        assert read(write(tmp_path, value)).materials["red"].color == pytest.approx(
            (1.0, 0.5, 0.0, 1.0), abs=0.01
        )
        value["materials"][0]["alphaMode"] = "BLEND"
        assert read(write(tmp_path, value)).materials["red"].color[3] == 0.3

    @pytest.mark.parametrize("how", ["view", "data", "file"])
    def test_pictures(self, tmp_path: Path, how: str) -> None:
        """Pictures inside the file, in a URI, or beside it; v upwards with transformation."""
        image = picture()
        value = document()
        value["bufferViews"].append({"buffer": 0, "byteOffset": len(BLOB),
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
        scene = read(write(tmp_path, glb(value, BLOB + image), "a.glb"))
        material = scene.materials["red"]
        if how == "file":
            assert material.texture == tmp_path / "red.PNG"
        else:
            assert material.image == image
        mesh = whole(scene)
        assert mesh.uvs is not None
        corner = mesh.uvs[mesh.triangles == 1][0]
        assert corner == pytest.approx([2.5, 1.0])

    def test_equal_names(self, tmp_path: Path) -> None:
        """Two materials of one name stay two."""
        value = document(materials=[{"name": "red"}, {"name": "red"}])
        assert len(read(write(tmp_path, value)).materials) == 2


class TestBadFiles:
    """Errors."""

    @pytest.mark.parametrize(
        ("changes", "told"),
        [
            ({"asset": {"version": "1.0"}}, "version 1.0"),
            ({"extensionsRequired": ["EXT_meshopt_compression"]}, "EXT_meshopt"),
            ({"nodes": [{"mesh": 5}]}, "nodes[0]"),
            ({"nodes": [{"children": [0]}]}, "nodes[0]"),
            ({"nodes": 7}, "nodes"),
            ({"scenes": [{"nodes": [-1]}]}, "scenes[0]"),
            ({"buffers": [{"uri": "gone.bin", "byteLength": 9}]}, "gone.bin"),
            ({"bufferViews": [{"buffer": 0, "byteLength": 10**11}]}, "bufferViews[0]"),
        ],
    )
    def test_what_is_wrong(self, tmp_path: Path, changes: dict[str, Any], told: str) -> None:
        """Errors name file and place (item 73)."""
        message = refusal(lambda: read(write(tmp_path, document(**changes))))
        assert "map.gltf" in message
        assert told in message

    def test_absurd_accessor(self, tmp_path: Path) -> None:
        """Accessors of billions of values are refused before memory is taken."""
        for change in ({"count": 10**10}, {"count": 10**10, "bufferView": None}):
            value = document()
            value["accessors"][0] |= change
            if "bufferView" in change:
                del value["accessors"][0]["bufferView"]
            assert "accessors[0]" in refused(write(tmp_path, value))

    def test_broken_json(self, tmp_path: Path) -> None:
        """The line of a syntax error is named; deep nesting is refused."""
        text = json.dumps(document(), indent=1).replace('"scene": 0,', '"scene" 0,')
        assert "line 5" in refusal(lambda: read(write(tmp_path, text.encode())))
        deep = b'{"asset":' + b"[" * 100_000
        assert "map.gltf" in refusal(lambda: read(write(tmp_path, deep)))

    @settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture],
              deadline=None)  # fmt: skip
    @given(st.data())
    def test_damaged_files(self, tmp_path: Path, data: st.DataObject) -> None:
        """Whatever is wrong with a file, it is read or refused in one line."""
        content = data.draw(st.sampled_from([json.dumps(document()).encode(), glb(document())]))
        name = "map.glb" if content.startswith(b"glTF") else "map.gltf"
        survives(tmp_path, name, data.draw(damages(content)))

    @settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture],
              deadline=None)  # fmt: skip
    @given(st.data())
    def test_wrong_values(self, tmp_path: Path, data: st.DataObject) -> None:
        """Any value replaced by any other is read or refused in one line."""
        value = document()
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
