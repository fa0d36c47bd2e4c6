"""What a glTF file shows beyond plain nodes: figures, colours of vertices, levels, extensions."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import meshopt
import numpy as np
import pytest
from gltf_samples import GLTF_BLOB, GLTF_INDICES, GLTF_POINTS, glb, gltf
from hypothesis import given
from hypothesis import strategies as st
from mesh_samples import (
    FACES,
    FUZZ,
    WEDGE,
    WEDGE_PLACES,
    places,
    read,
    refused,
    survives,
    told,
    upright,
    volume,
    whole,
    writer,
)

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.gltf_support import EXTENSIONS, support_of
from usarsim_maps.support import Support

write = writer("map.gltf")

SEVEN = np.array([7.0, 0.0, 0.0])

UBYTE, USHORT, UINT, FLOAT = 5121, 5123, 5125, 5126
KINDS = {"<u1": UBYTE, "<u2": USHORT, "<u4": UINT, "<f4": FLOAT, "<f8": 5130}


class GltfParts:
    """The wedge as glTF with more accessors, all in one buffer."""

    def __init__(self, **changes: Any) -> None:
        self.value = gltf(**changes)
        self._blob = GLTF_BLOB

    @property
    def primitive(self) -> dict[str, Any]:
        """The only one."""
        found: dict[str, Any] = self.value["meshes"][0]["primitives"][0]
        return found

    def accessor(self, values: Any, kind: str = "<f4", **facts: Any) -> int:
        """The number of a new accessor with some values (n, width)."""
        rows = np.asarray(values, dtype=kind).reshape(len(values), -1)
        width = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[rows.shape[1]]
        view = self.view(rows.tobytes())
        self.value["accessors"].append(
            {"bufferView": view, "componentType": KINDS[kind], "count": len(rows), "type": width}
            | facts
        )
        return len(self.value["accessors"]) - 1

    def view(self, content: bytes, **facts: Any) -> int:
        """The number of a new buffer view."""
        self._blob += bytes(-len(self._blob) % 8)
        place = {"buffer": 0, "byteOffset": len(self._blob), "byteLength": len(content)}
        self.value["bufferViews"].append(place | facts)
        self._blob += content
        return len(self.value["bufferViews"]) - 1

    def file(self, folder: Path) -> Path:
        """As GLB."""
        return write(folder, glb(self.value, self._blob), "map.glb")


class TestMorphs:
    """Shapes that morph into others."""

    def parts(self) -> GltfParts:
        """A wedge whose first target lifts it by 3 m, and whose second one moves one corner."""
        parts = GltfParts()
        lift = parts.accessor([[0.0, 3.0, 0.0]] * 4)
        where, what = parts.view(b"\3\0"), parts.view(np.array([1.0, 0, 0], "<f4").tobytes())
        parts.value["accessors"].append(
            {"componentType": FLOAT, "count": 4, "type": "VEC3", "sparse": {
                "count": 1, "indices": {"bufferView": where, "componentType": USHORT},
                "values": {"bufferView": what}}}
        )  # fmt: skip
        parts.primitive["targets"] = [{"POSITION": lift}, {"POSITION": lift + 1}, {}]
        return parts

    @pytest.mark.parametrize(
        ("mesh", "node", "height", "shift"),
        [
            (None, None, 0.0, 0.0),
            ([1.0, 0.0], None, 3.0, 0.0),
            ([1.0, 0.0], [0.5, 2.0], 1.5, 2.0),
            ([0.0, -1.0], [], 0.0, -1.0),
            (None, ["x", True, None], 0.0, 0.0),
        ],
    )
    def test_weights(
        self, tmp_path: Path, mesh: Any, node: Any, height: float, shift: float
    ) -> None:
        """Those of the node stand for those of the mesh; sparse targets move few vertices."""
        parts = self.parts()
        if mesh is not None:
            parts.value["meshes"][0]["weights"] = mesh
        if node is not None:
            parts.value["nodes"][0]["weights"] = node
        found = whole(read(parts.file(tmp_path)))
        expected = WEDGE + np.array([0.0, 0.0, height])
        expected[3, 0] += shift
        assert places(found) == sorted(expected.tolist())

    def test_two_nodes_of_one_mesh(self, tmp_path: Path) -> None:
        """Each has its own weights; equal ones share their mesh."""
        parts = self.parts()
        nodes = [{"mesh": 0, "weights": [w]} for w in (0.0, 1.0, 1.0)]
        parts.value |= {"nodes": nodes, "scenes": [{"nodes": [0, 1, 2]}]}
        a, b, c = (thing.parts[0].shape for thing in read(parts.file(tmp_path)).objects)
        assert a is not b
        assert b is c
        assert b.vertices[:, 1].min() == pytest.approx(3.0)

    def test_other_vertices(self, tmp_path: Path) -> None:
        """A target of fewer vertices is refused, with its place."""
        parts = self.parts()
        parts.primitive["targets"] = [{"POSITION": parts.accessor([[0.0, 0.0, 0.0]])}]
        parts.value["meshes"][0]["weights"] = [1.0]
        assert "targets[0]" in refused(parts.file(tmp_path))


def turned(angle: float, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
    """Matrix of a turn about x and a move, in the file's frame."""
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.eye(4)
    matrix[1:3, 1:3] = [[c, -s], [s, c]]
    matrix[:3, 3] = place
    return matrix


class TestSkins:
    """Figures on joints."""

    def parts(self, node: dict[str, Any] | None = None, **skin: Any) -> GltfParts:
        """A figure that was modelled lying, as programs with z up write it.

        Its joints stand it up and put it at x = 7; the matrix of its node, which would lay it down
        again and throw it far away, must not count.
        """
        laid = turned(-math.pi / 2.0)
        lying = upright(WEDGE) @ np.linalg.inv(laid)[:3, :3].T
        parts = GltfParts()
        attributes = parts.primitive["attributes"]
        attributes["POSITION"] = parts.accessor(lying)
        attributes["JOINTS_0"] = parts.accessor([[0, 1, 0, 0]] * 4, "<u1")
        attributes["WEIGHTS_0"] = parts.accessor(
            [[255, 0, 0, 0], [128, 127, 0, 0], [0, 255, 0, 0], [0, 0, 0, 0]], "<u1", normalized=True
        )
        binds = [laid.T.ravel(), (turned(0.0, (0.0, -1.0, 0.0)) @ laid).T.ravel()]
        parts.value["skins"] = [
            {"joints": [1, 2], "inverseBindMatrices": parts.accessor(binds)} | skin
        ]
        figure = {"name": "Figure", "mesh": 0, "skin": 0, "translation": [500, 0, 0]}
        parts.value["nodes"] = [
            figure | (node or {}),
            {"name": "Hips", "children": [2], "translation": [7, 0, 0]},
            {"name": "Head", "translation": [0, 1, 0]},
        ]
        parts.value["scenes"] = [{"nodes": [0, 1]}]
        return parts

    def test_a_figure_stands(self, tmp_path: Path, findings: Findings) -> None:
        """Joint times inverse bind matrix; weights as bytes, one vertex without any."""
        scene = read(self.parts().file(tmp_path), findings)
        expected = sorted((WEDGE + SEVEN).tolist())
        assert places(whole(scene)) == expected
        assert volume(whole(scene)) == pytest.approx(1.0)
        (thing,) = scene.objects
        assert thing.name == "Figure"
        assert thing.pose.position == pytest.approx((7.0, 0.0, 0.0))
        assert told(findings) == ""

    def test_joints_outside_of_the_scene(self, tmp_path: Path) -> None:
        """Count all the same."""
        parts = self.parts()
        parts.value["scenes"] = [{"nodes": [0]}]
        assert places(whole(read(parts.file(tmp_path)))) == sorted((WEDGE + SEVEN).tolist())

    def test_without_inverse_bind_matrices(self, tmp_path: Path) -> None:
        """The joints move the vertices as they are."""
        parts = self.parts()
        del parts.value["skins"][0]["inverseBindMatrices"]
        mesh = whole(read(parts.file(tmp_path)))
        assert mesh.vertices[:, 0].min() == pytest.approx(7.0)

    @pytest.mark.parametrize(
        "skin",
        [{"joints": []}, {"joints": [1]}, {"joints": [1, 77]}, {"inverseBindMatrices": 0}],
    )
    def test_what_cannot_be_had(
        self, tmp_path: Path, findings: Findings, skin: dict[str, Any]
    ) -> None:
        """The figure stands as it was modelled, by its node, and the report says so."""
        scene = read(self.parts(**skin).file(tmp_path), findings)
        assert scene.objects[0].pose.position[0] == pytest.approx(500.0)
        assert "Figure stands as it was modelled" in told(findings)

    @FUZZ
    @given(st.data())
    def test_wrong_values(self, tmp_path: Path, data: st.DataObject) -> None:
        """Any value of skin, joints and weights replaced by another is read or refused."""
        parts = self.parts()
        accessors = parts.value["accessors"][-4:]
        owner = data.draw(st.sampled_from([*accessors, *parts.value["skins"]]))
        key = data.draw(st.sampled_from(sorted(owner)))
        owner[key] = data.draw(st.one_of(st.integers(-2, 10**6), st.none(), st.just([5, 1])))
        survives(tmp_path, "map.glb", parts.file(tmp_path).read_bytes())


class TestColors:
    """COLOR_0."""

    @pytest.mark.parametrize(
        ("kind", "scale", "facts"),
        [
            ("<f4", 1.0, {}),
            ("<u1", 255.0, {"normalized": True}),
            ("<u2", 65535.0, {"normalized": True}),
            ("<u1", 255.0, {}),
            ("<u2", 65535.0, {}),
        ],
    )
    @pytest.mark.parametrize("width", [3, 4])
    def test_kinds(
        self, tmp_path: Path, kind: str, scale: float, facts: dict[str, Any], width: int
    ) -> None:
        """Linear colours of vertices multiply the base colour; white ones change nothing."""
        parts = GltfParts()
        rows = np.array([[1, 0.2140, 0, 1]] * 3 + [[1, 1, 1, 1]]) * scale
        parts.primitive["attributes"]["COLOR_0"] = parts.accessor(rows[:, :width], kind, **facts)
        parts.value["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 1, 1, 0.3]
        scene = read(parts.file(tmp_path))
        (thing,) = scene.objects
        mesh = thing.parts[0].shape
        names = [mesh.materials[slot] for slot in mesh.slots]
        red, green, blue, alpha = scene.materials[names[0]].color
        assert (red, green, blue) == pytest.approx((0.735, 0.5, 0.0), abs=0.01)
        assert alpha == 1.0
        assert scene.materials[names[1]].color[2] == pytest.approx(1.0 / 3.0, abs=0.01)
        assert names[1:] == [names[1]] * 3

    def test_white_is_the_material_itself(self, tmp_path: Path) -> None:
        """Most files have them without a meaning."""
        parts = GltfParts()
        parts.primitive["attributes"]["COLOR_0"] = parts.accessor([[1.0, 1.0, 1.0]] * 4)
        scene = read(parts.file(tmp_path))
        assert scene.objects[0].parts[0].shape.materials == ("red",)
        assert list(scene.materials) == ["red"]

    def test_opacity(self, tmp_path: Path) -> None:
        """The fourth column counts where the material blends."""
        parts = GltfParts()
        parts.primitive["attributes"]["COLOR_0"] = parts.accessor([[1.0, 1.0, 1.0, 0.2]] * 4)
        parts.value["materials"][0]["alphaMode"] = "BLEND"
        scene = read(parts.file(tmp_path))
        (name,) = scene.objects[0].parts[0].shape.materials
        assert scene.materials[name].color == pytest.approx((1.0, 0.0, 0.0, 0.2), abs=0.01)

    def test_too_few(self, tmp_path: Path, findings: Findings) -> None:
        """A surface without its colours is a surface."""
        parts = GltfParts()
        parts.primitive["attributes"]["COLOR_0"] = parts.accessor([[1.0, 1.0, 1.0]])
        assert places(whole(read(parts.file(tmp_path), findings))) == WEDGE_PLACES
        assert "colours of vertices were left out" in told(findings)


class TestNodes:
    """Levels of detail, hidden nodes, what nodes hold beside a mesh."""

    def test_finest_level(self, tmp_path: Path) -> None:
        """Coarser levels are not there, though they stand in the scene or in none."""
        levels = {"MSFT_lod": {"ids": [1, 2]}}
        nodes = [{"name": "fine", "mesh": 0, "extensions": levels}, {"mesh": 0}, {"mesh": 0}]
        for scenes in ([{"nodes": [0, 1]}], []):
            value = gltf(nodes=nodes, scenes=scenes, extensionsUsed=["MSFT_lod"])
            assert [t.name for t in read(write(tmp_path, value)).objects] == ["fine"]

    def test_hidden_nodes(self, tmp_path: Path, findings: Findings) -> None:
        """With all below them, visible or not; they are counted, and starts stay."""
        hidden = {"KHR_node_visibility": {"visible": False}}
        seen = {"KHR_node_visibility": {"visible": True}}
        nodes = [
            {"mesh": 0},
            {"children": [2, 3], "extensions": hidden},
            {"name": "Ghost", "mesh": 0, "extensions": seen},
            {"name": "PlayerStart"},
        ]
        value = gltf(nodes=nodes, scenes=[{"nodes": [0, 1]}])
        scene = read(write(tmp_path, value), findings)
        assert len(scene.objects) == 1
        assert findings.skipped_names == {"hidden node": ["Ghost"]}
        assert len(scene.starts) == 1

    def test_lamp_with_a_mesh(self, tmp_path: Path, findings: Findings) -> None:
        """Both are there; cameras, animations and other scenes are counted."""
        lights = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
        lamp = {"KHR_lights_punctual": {"light": 0}}
        value = gltf(
            nodes=[{"name": "Lamp", "mesh": 0, "extensions": lamp}, {"name": "Eye", "camera": 0}],
            scenes=[{"nodes": [0, 1]}, {"name": "Other", "nodes": []}],
            extensions=lights,
            cameras=[{"type": "perspective"}],
            animations=[{"name": "Walk", "channels": [], "samplers": []}],
        )
        scene = read(write(tmp_path, value), findings)
        assert len(scene.objects) == len(scene.lights) == 1
        assert findings.skipped_names == {
            "scene": ["Other"], "camera": ["Eye"], "animation": ["Walk"],
        }  # fmt: skip
        assert "empty node" not in findings.classes

    def test_instances_without_places(self, tmp_path: Path) -> None:
        """A node whose instances have identities only is there once."""
        parts = GltfParts()
        instancing = {"attributes": {"_ID": parts.accessor([[1.0], [2.0]])}}
        parts.value["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": instancing}
        assert len(read(parts.file(tmp_path)).objects) == 1


class TestPrimitives:
    """Kinds of numbers and of primitives."""

    def test_restarted_strips(self, tmp_path: Path) -> None:
        """The greatest index ends a strip; other files have none."""
        parts = GltfParts(extensionsRequired=["KHR_mesh_primitive_restart"])
        rows = [row for face in FACES.tolist() for row in (*face, 65535)]
        parts.primitive.update(
            {"mode": 5, "indices": parts.accessor(np.array(rows)[:, None], "<u2")}
        )
        assert volume(whole(read(parts.file(tmp_path)))) == pytest.approx(1.0)

    def test_double_numbers(self, tmp_path: Path) -> None:
        """KHR_accessor_float64."""
        parts = GltfParts(extensionsRequired=["KHR_accessor_float64"])
        parts.primitive["attributes"]["POSITION"] = parts.accessor(upright(WEDGE), "<f8")
        assert places(whole(read(parts.file(tmp_path)))) == WEDGE_PLACES

    def test_lines_are_counted(self, tmp_path: Path, findings: Findings) -> None:
        """By their kind, with the mesh that they belong to."""
        value = gltf()
        primitives = value["meshes"][0]["primitives"]
        primitives += [{"attributes": {"POSITION": 0}, "mode": mode} for mode in (0, 3, 9)]
        read(write(tmp_path, value), findings)
        assert findings.skipped_names == {
            "POINTS": ["wedge"], "LINE_STRIP": ["wedge"], "primitive of mode 9": ["wedge"],
        }  # fmt: skip


class TestExtensions:
    """By the table."""

    @pytest.mark.parametrize("name", [*EXTENSIONS, "ACME_materials_fur", "ACME_mesh_folded"])
    def test_required(self, tmp_path: Path, findings: Findings, name: str) -> None:
        """What is read passes, what is for looks is counted, the rest is refused with a cure."""
        path = write(tmp_path, gltf(extensionsRequired=[name], extensionsUsed=[name]))
        if support_of(name) is Support.REFUSED:
            assert name in refused(path)
            return
        assert places(whole(read(path, findings))) == WEDGE_PLACES
        left_out = support_of(name) is Support.LEFT_OUT
        assert findings.skipped_names == ({"extension": [name]} if left_out else {})

    def test_used(self, tmp_path: Path, findings: Findings) -> None:
        """What a file can be shown without is counted once, whatever it is."""
        used = ["KHR_materials_variants", "ACME_mesh_folded", "MSFT_lod", "ACME_mesh_folded"]
        read(write(tmp_path, gltf(extensionsUsed=used)), findings)
        assert findings.skipped_names == {"extension": used[:2]}
        assert findings.skipped == {"extension": 2}

    def test_pictures_that_cannot_be_read(self, tmp_path: Path, findings: Findings) -> None:
        """Their plain picture counts where there is one; else they are counted."""
        basisu = {"KHR_texture_basisu": {"source": 1}}
        value = gltf(
            images=[{"uri": "a.png"}, {"uri": "a.ktx2"}],
            textures=[{"extensions": basisu}, {"source": 0, "extensions": basisu}],
        )
        looks = value["materials"][0]["pbrMetallicRoughness"]
        looks["baseColorTexture"] = {"index": 0}
        scene = read(write(tmp_path, value), findings)
        assert scene.materials["red"].texture is None
        assert findings.skipped_names == {"picture of an unknown kind": ["a.ktx2"]}
        looks["baseColorTexture"] = {"index": 1}
        assert read(write(tmp_path, value)).materials["red"].texture == tmp_path / "a.png"

    def test_maps_of_looks(self, tmp_path: Path, findings: Findings) -> None:
        """Pictures other than the colour are counted by their kind."""
        looks = {"metallicRoughnessTexture": {"index": 0}}
        material = {"name": "m", "normalTexture": {"index": 0}, "pbrMetallicRoughness": looks}
        value = gltf(materials=[material])
        read(write(tmp_path, value), findings)
        assert findings.skipped_names == {"normalTexture": ["m"], "metallicRoughnessTexture": ["m"]}


def squeezed(name: str, *, plain: bool = False, **changes: Any) -> tuple[dict[str, Any], bytes]:
    """The wedge compressed by meshoptimizer, with or without its plain bytes."""
    points = np.frombuffer(GLTF_POINTS, "<f4").reshape(4, 3)
    pieces = [
        (meshopt.encode_gltf_buffer(points, "ATTRIBUTES"), 4, 12, "ATTRIBUTES"),
        (meshopt.encode_gltf_buffer(FACES.astype(np.uint32).ravel(), "TRIANGLES"), 12, 2,
         "TRIANGLES"),
    ]  # fmt: skip
    blob = GLTF_POINTS + GLTF_INDICES if plain else b""
    views, start = [], 0
    for content, count, stride, mode in pieces:
        packed = {"buffer": 0, "byteOffset": len(blob), "byteLength": len(content),
                  "byteStride": stride, "count": count, "mode": mode}  # fmt: skip
        blob += content
        extension = {name: packed | changes}
        size = count * stride
        views.append({"buffer": 0 if plain else 1, "byteOffset": start, "byteLength": size,
                      "extensions": extension})  # fmt: skip
        start += size
    value = gltf(bufferViews=views)
    value["accessors"] = [value["accessors"][0], value["accessors"][2]]
    value["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0}, "indices": 1}]
    value["extensionsUsed"] = [name]
    if not plain:
        value["extensionsRequired"] = [name]
    return value, blob


def squeezed_file(folder: Path, value: dict[str, Any], blob: bytes) -> Path:
    """With a second buffer that holds nothing."""
    (folder / "map.bin").write_bytes(blob)
    value["buffers"] = [{"uri": "map.bin", "byteLength": len(blob)}]
    for name in value["extensionsUsed"]:
        value["buffers"].append({"byteLength": 72, "extensions": {name: {"fallback": True}}})
    return write(folder, value)


MESHOPT = ["EXT_meshopt_compression", "KHR_meshopt_compression"]


class TestMeshopt:
    """Buffers compressed by meshoptimizer."""

    @pytest.mark.parametrize("name", MESHOPT)
    @pytest.mark.parametrize("plain", [False, True])
    def test_the_wedge(self, tmp_path: Path, name: str, plain: bool) -> None:
        """Vertices and triangles are those of the plain file."""
        mesh = whole(read(squeezed_file(tmp_path, *squeezed(name, plain=plain))))
        assert places(mesh) == WEDGE_PLACES
        assert volume(mesh) == pytest.approx(1.0)

    @pytest.mark.parametrize("plain", [False, True])
    def test_without_the_library(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plain: bool
    ) -> None:
        """The plain bytes stand in; without them the error says how to get it."""
        monkeypatch.setitem(sys.modules, "meshopt", None)
        path = squeezed_file(tmp_path, *squeezed(MESHOPT[0], plain=plain))
        if plain:
            assert places(whole(read(path))) == WEDGE_PLACES
        else:
            assert 'pip install "usarsim-server[meshes]"' in refused(path)

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"count": 10**9}, "too many"),
            ({"count": 5}, "cannot decompress it"),
            ({"mode": "FOLDED"}, "cannot decompress it"),
            ({"filter": "FOLDED"}, "cannot decompress it"),
            ({"byteLength": 10**9}, "bytes 0 to 1000000000"),
        ],
    )
    def test_what_is_wrong(self, tmp_path: Path, changes: dict[str, Any], words: str) -> None:
        """One line that names file and place."""
        message = refused(squeezed_file(tmp_path, *squeezed(MESHOPT[0], **changes)))
        assert words in message
        assert "bufferViews[" in message

    @FUZZ
    @given(st.data())
    def test_damaged(self, tmp_path: Path, data: st.DataObject) -> None:
        """Bytes that were exchanged are read or refused, nothing else."""
        value, blob = squeezed(MESHOPT[0])
        spots = st.tuples(st.integers(0, len(blob) - 1), st.integers(0, 255))
        content = bytearray(blob)
        for place, byte in data.draw(st.lists(spots, min_size=1, max_size=5)):
            content[place] = byte
        path = squeezed_file(tmp_path, value, bytes(content))
        survives(tmp_path, "map.gltf", path.read_bytes())


def test_draco_beside_plain_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that does not require Draco is read without its library."""
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    value = gltf(extensionsUsed=["KHR_draco_mesh_compression"])
    packed = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    value["meshes"][0]["primitives"][0]["extensions"] = packed
    assert places(whole(read(write(tmp_path, value)))) == WEDGE_PLACES
