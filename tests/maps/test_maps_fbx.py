"""FBX: text 6.1 and 7.x, binary 7.x; what is in it, what is wrong with it, who names it."""

from __future__ import annotations

import importlib.util
import io
import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fbx_samples import CUBE_FACES, CUBE_POINTS, Fbx, FbxFile, X, Y, Z, dom, prop
from lanes import slow_but
from mesh_samples import faces_out, places, read, refusal, refused, told, volume, whole, write
from PIL import Image
from sdf_samples import load as load_world
from sdf_samples import model, shape
from t3d_maps import actor, level, read_level, room

from usarsim_maps import apart
from usarsim_maps.convert import Request, import_map
from usarsim_maps.fbx.library import answer
from usarsim_maps.fbx.library.text import check_text, plain_text
from usarsim_maps.findings import Findings
from usarsim_maps.reader import find_reader
from usarsim_maps.scene import Array, Collision, LightKind, Mesh, Opacity, Scene
from usarsim_server.base.errors import MapImportError

Bounds = dict[str, tuple[list[float], list[float]]]

CM = 100.0
"""Units per metre of most files."""


@pytest.fixture
def file() -> FbxFile:
    """An empty file, z up, in centimetres."""
    return FbxFile()


def bounds(scene: Scene) -> Bounds:
    """Corners of all objects in the world, m."""
    answer: Bounds = {}
    for thing in scene.objects:
        for part in thing.parts:
            assert isinstance(part.shape, Mesh)
            local = part.shape.vertices @ part.matrix[:3, :3].T + part.matrix[:3, 3]
            points = np.round(local @ thing.pose.matrix().T + thing.pose.position, 6) + 0.0
            answer[thing.name] = (points.min(axis=0).tolist(), points.max(axis=0).tolist())
    return answer


def loaded(
    folder: Path, content: bytes, findings: Findings | None = None, **options: object
) -> Scene:
    """A file that is written and read."""
    return read(write(folder, content, "thing.fbx"), findings, **options)


def one_line(error: MapImportError) -> None:
    """A refusal is a line that can be printed and ends with a cure."""
    assert re.fullmatch(r"\S+\.fbx: .+ \(.+\)", str(error))


def pixels(color: tuple[int, int, int] = (255, 0, 0)) -> bytes:
    """A small picture."""
    content = io.BytesIO()
    Image.new("RGB", (4, 4), color).save(content, "PNG")
    return content.getvalue()


CORNERS = [(0.1 * k, 0.2) for k in range(24)]
"""Texture coordinates for a cube."""


# ---- the same in every way it is written -----------------------------------------------------


def yard() -> FbxFile:
    """A crate of 1 m with a hull and two materials at (2, 0, 0), and a start that looks along y."""
    file = FbxFile()
    red, blue = file.material("Red", (1.0, 0.0, 0.0)), file.material("Blue", (0.0, 0.0, 1.0))
    slots = [0, 0, 0, 1, 1, 1]
    file.mesh("Crate", size=CM, at=(200.0, 0.0, 0.0), materials=[red, blue], slots=slots)
    file.mesh("UCX_Crate", size=CM, at=(200.0, 0.0, 0.0))
    turn = prop("Lcl Rotation", 0.0, 0.0, 90.0, kind="Lcl Rotation")
    file.model("PlayerStart_1", "Null", place(CM, 0.0, 25.0), turn)
    return file


def place(x: float, y: float, z: float) -> tuple[str, str, tuple[float, ...]]:
    """Where a node is."""
    return prop("Lcl Translation", x, y, z, kind="Lcl Translation")


@pytest.mark.parametrize("way", sorted(yard().all()))
def test_every_way(tmp_path: Path, way: str) -> None:
    """Names, places, faces, hulls, materials by face, starts, unit."""
    findings = Findings()
    scene = loaded(tmp_path, yard().all()[way], findings)
    assert bounds(scene) == dict.fromkeys(("Crate", "UCX_Crate"), ([2, 0, 0], [3, 1, 1]))
    crate, hull = (thing.parts[0] for thing in scene.objects)
    assert (crate.visible, crate.collision) == (True, Collision.NONE)
    assert (hull.visible, hull.collision) == (False, Collision.HULL)
    assert isinstance(crate.shape, Mesh)
    assert crate.shape.materials == ("Red", "Blue")
    assert crate.shape.slots is not None
    assert crate.shape.slots.tolist() == [0] * 6 + [1] * 6
    assert scene.materials["Blue"].color == (0.0, 0.0, 1.0, 1.0)
    assert volume(whole(scene)) == pytest.approx(1.0)
    (start,) = scene.starts
    assert start.tag == "PlayerStart_1"
    assert start.pose.position == pytest.approx((1.0, 0.0, 0.25))
    assert start.pose.matrix()[:, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert scene.source.units_per_metre == CM
    assert scene.source.unit == "a unit is 1 cm, as the file says"
    assert not scene.source.assumed
    assert findings.classes == {"mesh node": 2, "start": 1}
    assert not findings.skipped
    assert not findings.warnings()


def test_recognised_by_content(tmp_path: Path) -> None:
    """Files under other names; those of other formats are refused."""
    for number, content in enumerate((yard().text6(), yard().text7(), yard().binary())):
        assert find_reader(write(tmp_path, content, f"thing{number}")).title == "FBX"
    assert "line 1" in refused(write(tmp_path, '{"asset": 1}', "a.fbx"))
    assert "FBX library" in refused(write(tmp_path, "Kaydara FBX Binary", "b.fbx"))
    assert "Truncated" in refused(write(tmp_path, "; FBX 7.4.0 project file\n", "c.fbx"))


@pytest.mark.parametrize("change", ["crlf", "cr", "mark", "utf-16", "latin-1"])
def test_text_as_programs_save_it(tmp_path: Path, change: str, file: FbxFile) -> None:
    """Line ends, marks and encodings."""
    file.mesh("W\N{LATIN SMALL LETTER A WITH DIAERESIS}nd", size=CM)
    text = file.text7().decode()
    content = {
        "crlf": text.replace("\n", "\r\n").encode(),
        "cr": text.replace("\n", "\r").encode(),
        "mark": text.encode("utf-8-sig"),
        "utf-16": text.encode("utf-16"),
        "latin-1": text.encode("latin-1"),
    }[change]
    assert bounds(loaded(tmp_path, content)) == {"W\xe4nd": ([0, 0, 0], [1, 1, 1])}


# ---- units and axes --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "lower", "upper"),
    [
        ({"up": Z}, [2.0, 0.0, 3.0], [3.0, 1.0, 4.0]),
        ({"up": Y}, [2.0, -4.0, 0.0], [3.0, -3.0, 1.0]),
        ({"up": Z, "unit": 100.0}, [200.0, 0.0, 300.0], [300.0, 100.0, 400.0]),
        ({"up": Z, "unit": 2.54}, [5.08, 0.0, 7.62], [7.62, 2.54, 10.16]),
        ({"up": Z, "UpAxisSign": -1, "FrontAxisSign": 1}, [2.0, -1.0, -4.0], [3.0, 0.0, -3.0]),
        (
            {"up": X, "FrontAxis": Z, "FrontAxisSign": 1, "CoordAxis": Y, "CoordAxisSign": -1},
            [-1.0, -4.0, 2.0],
            [0.0, -3.0, 3.0],
        ),
        # Left-handed: a mirror image, whose faces still look outwards.
        ({"up": Z, "CoordAxisSign": -1}, [-3.0, 0.0, 3.0], [-2.0, 1.0, 4.0]),
    ],
)
def test_axes_and_unit(
    tmp_path: Path, settings: dict[str, int], lower: list[float], upper: list[float]
) -> None:
    """A cube of 100 units at (200, 0, 300), by the axes and the unit of the file."""
    file = FbxFile(**settings)  # type: ignore[arg-type]
    file.mesh("Cube", size=CM, at=(200.0, 0.0, 300.0))
    scene = loaded(tmp_path, file.binary())
    assert bounds(scene)["Cube"] == (pytest.approx(lower), pytest.approx(upper))
    assert faces_out(whole(scene))


def test_the_user_has_the_last_word(tmp_path: Path) -> None:
    """Options replace unit and axes."""
    file = FbxFile(up=Y, unit=100.0)
    file.mesh("Cube", at=(0.0, 0.0, 5.0))
    scene = loaded(tmp_path, file.text6(), scale=250.0)
    assert bounds(scene)["Cube"] == ([0.0, -0.024, 0.0], [0.004, -0.02, 0.004])
    assert scene.source.unit == ""
    scene = loaded(tmp_path, file.text6(), up="Z")
    assert bounds(scene)["Cube"] == ([0, 0, 5], [1, 1, 6])
    scene = loaded(tmp_path, file.text6(), mirror=True)
    assert bounds(scene)["Cube"] == ([0, 5, 0], [1, 6, 1])


@pytest.mark.parametrize("way", ["text6", "text7", "binary"])
def test_bad_units_and_axes(tmp_path: Path, way: str) -> None:
    """What the file does not say is assumed and told; what cannot be is refused."""
    file = FbxFile(unit=None)
    file.mesh("Cube", size=CM)
    scene = loaded(tmp_path, getattr(file, way)())
    assert scene.source.assumed
    assert bounds(scene)["Cube"][1] == [1, 1, 1]
    for unit in (0.0, -1.0, float("nan"), 1e300):
        file = FbxFile(unit=unit)
        file.mesh("Cube", size=CM)
        path = write(tmp_path, getattr(file, way)(), "bad.fbx")
        assert "UnitScaleFactor" in refused(path)
        assert "--scale" in refused(path)
        assert bounds(read(path, scale=CM))["Cube"][1] == [1, 1, 1]
    file = FbxFile(CoordAxis=Z)
    file.mesh("Cube", size=CM)
    findings = Findings()
    assert loaded(tmp_path, getattr(file, way)(), findings).source.assumed
    assert "axes make no sense" in told(findings)


def test_the_report_tells_the_unit(tmp_path: Path) -> None:
    """Alone, with the size and how to change it; a remembered import, too."""
    source = write(tmp_path, yard().text6(), "yard.fbx")
    for _ in range(2):
        report = import_map(Request(source, cache=tmp_path / "cache")).report
        text = report.text()
        assert "100 units per metre (a unit is 1 cm, as the file says" in text
        assert "--scale" in text
        assert report.extents == pytest.approx((1.0, 1.0, 1.0))


# ---- nodes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["text6", "binary"])
def test_transformations(tmp_path: Path, file: FbxFile, way: str) -> None:
    """Geometric ones, pivots, negative scales, parents."""
    file.mesh(
        "Geometric", CUBE_POINTS, CUBE_FACES,
        prop("GeometricTranslation", 0.0, 0.0, 50.0), prop("GeometricScaling", 2.0, 2.0, 2.0),
        size=CM, at=(CM, 0.0, 0.0),
    )  # fmt: skip
    turn = prop("Lcl Rotation", 0.0, 0.0, 90.0, kind="Lcl Rotation")
    file.mesh("Pivot", CUBE_POINTS, CUBE_FACES, prop("RotationPivot", CM, 0.0, 0.0), turn, size=CM)
    mirrored = prop("Lcl Scaling", -1.0, 1.0, 1.0, kind="Lcl Scaling")
    file.mesh("Mirrored", CUBE_POINTS, CUBE_FACES, mirrored, size=CM)
    group = file.model("Group", "Null", place(0.0, 0.0, CM), turn)
    file.mesh("Child", CUBE_POINTS, CUBE_FACES, size=CM, at=(CM, 0.0, 0.0), to=group)
    scene = loaded(tmp_path, getattr(file, way)())
    assert bounds(scene) == {
        "Geometric": ([1, 0, 0.5], [3, 2, 2.5]),
        "Pivot": ([0, -1, 0], [1, 0, 1]),
        "Mirrored": ([-1, 0, 0], [0, 1, 1]),
        "Child": ([-1, 1, 1], [0, 2, 2]),
    }
    for thing in scene.objects:
        matrix = thing.parts[0].matrix
        assert isinstance(thing.parts[0].shape, Mesh)
        sign = float(np.sign(np.linalg.det(matrix[:3, :3])))
        assert volume(thing.parts[0].shape) > 0.0
        assert sign == (-1.0 if thing.name == "Mirrored" else 1.0)


@pytest.mark.parametrize("way", ["text6", "binary"])
def test_custom_properties(tmp_path: Path, file: FbxFile, way: str) -> None:
    """Tag, movable, mass and friction, as Blender writes them."""
    facts = [prop("tag", "hello"), prop("movable", 1), prop("mass", 4.5), prop("friction", 0.5)]
    file.mesh("Crate", CUBE_POINTS, CUBE_FACES, *facts, size=CM)
    (thing,) = loaded(tmp_path, getattr(file, way)()).objects
    assert (thing.tag, thing.movable, thing.mass, thing.friction) == ("hello", True, 4.5, 0.5)


@pytest.mark.parametrize("way", ["text6", "binary"])
def test_collision_pieces(tmp_path: Path, file: FbxFile, way: str) -> None:
    """UCX_, UBX_, USP_ and UCP_ are felt and not seen, also when they are hidden."""
    file.mesh("Chair", size=CM)
    unseen = prop("Visibility", 0.0, kind="Visibility")
    for prefix in ("UCX", "UBX", "USP", "UCP"):
        file.mesh(f"{prefix}_Chair_01", CUBE_POINTS, CUBE_FACES, unseen, size=CM)
    scene = loaded(tmp_path, getattr(file, way)())
    kinds = {thing.name[:3]: thing.parts[0].collision for thing in scene.objects}
    assert kinds == {
        "Cha": Collision.NONE, "UCX": Collision.HULL, "UBX": Collision.BOX,
        "USP": Collision.SPHERE, "UCP": Collision.HULL,
    }  # fmt: skip
    assert [thing.parts[0].visible for thing in scene.objects] == [True] + [False] * 4


@pytest.mark.parametrize("way", ["text6", "binary"])
def test_hidden_nodes(tmp_path: Path, file: FbxFile, way: str) -> None:
    """Nodes that are hidden, and what hangs on them, are counted."""
    unseen = prop("Visibility", 0.0, kind="Visibility")
    file.mesh("Seen", size=CM)
    file.mesh("Unseen", CUBE_POINTS, CUBE_FACES, unseen, size=CM)
    group = file.model("Group", "Null", unseen)
    file.mesh("Inner", size=CM, to=group)
    free = prop("Visibility Inheritance", 0, kind="Visibility Inheritance")
    file.mesh("Free", CUBE_POINTS, CUBE_FACES, free, size=CM, to=group)
    findings = Findings()
    assert set(bounds(loaded(tmp_path, getattr(file, way)(), findings))) == {"Seen", "Free"}
    assert findings.skipped_names == {"hidden node": ["Unseen", "Group", "Inner"]}


def test_hidden_layers(tmp_path: Path, file: FbxFile) -> None:
    """Nodes of a display layer that is switched off."""
    file.mesh("Seen", size=CM)
    file.mesh("Unseen", size=CM)
    unseen = next(thing for thing in file.objects if thing.name == "Unseen")
    layer = file.add("CollectionExclusive", "Away", "DisplayLayer", prop("Show", 0, kind="bool"))
    file.links.append((unseen, layer, ""))
    findings = Findings()
    assert set(bounds(loaded(tmp_path, file.binary(), findings))) == {"Seen"}
    assert findings.skipped_names == {"hidden node": ["Unseen"]}


@pytest.mark.parametrize("way", ["text6", "binary"])
@pytest.mark.parametrize("names", [("Chair_LOD1", "Chair_LOD0"), ("Fine", "Coarse")])
def test_levels_of_detail(tmp_path: Path, file: FbxFile, way: str, names: tuple[str, str]) -> None:
    """The finest of a group: by its name, else the first; its hulls stay."""
    group = file.model("Levels", "LodGroup")
    for name in names:
        file.mesh(name, size=CM, to=group)
    finest = "Fine" if "Fine" in names else "Chair_LOD0"
    file.mesh(f"UCX_{finest}", size=CM, to=group)
    findings = Findings()
    scene = loaded(tmp_path, getattr(file, way)(), findings)
    assert set(bounds(scene)) == {finest, f"UCX_{finest}"}
    (coarse,) = set(names) - {finest}
    assert findings.skipped_names == {"coarser level of detail": [coarse]}


def test_copies_share_a_mesh(tmp_path: Path, file: FbxFile) -> None:
    """With materials of their own."""
    red, green = file.material("Red", (1.0, 0.0, 0.0)), file.material("Green", (0.0, 1.0, 0.0))
    file.mesh("One", size=CM, materials=[red], slots=[0] * 6)
    shown = file.objects[-1]
    two = file.add("Model", "Two", "Mesh", place(300.0, 0.0, 0.0))
    file.links += [(shown, two, ""), (green, two, "")]
    scene = loaded(tmp_path, file.binary())
    assert bounds(scene) == {"One": ([0, 0, 0], [1, 1, 1]), "Two": ([3, 0, 0], [4, 1, 1])}
    first, second = (thing.parts[0] for thing in scene.objects)
    assert first.shape is second.shape
    assert dict(second.materials) == {0: "Green"}


@pytest.mark.parametrize(
    ("settings", "turn"),
    [
        ({"up": Z}, (0.0, 0.0, 30.0)),
        ({"up": Y}, (0.0, 30.0, 0.0)),  # Maya
        ({"up": Y}, (-90.0, 30.0, 0.0)),  # Blender turns every node
    ],
)
@pytest.mark.parametrize("mirror", [False, True])
def test_starts_stand_upright(
    tmp_path: Path, settings: dict[str, int], turn: tuple[float, float, float], mirror: bool
) -> None:
    """Whichever of the node's axes points upwards, x is forward."""
    file = FbxFile(**settings)  # type: ignore[arg-type]
    file.mesh("Floor", size=CM)
    rotation = prop("Lcl Rotation", *turn, kind="Lcl Rotation")
    scale = prop("Lcl Scaling", CM, CM, CM, kind="Lcl Scaling")
    file.model("RobotStart_1", "Null", rotation, scale)
    file.model("PathNode_1", "Null", place(CM, 0.0, 0.0))
    file.model("FemaleVictim_0", "Null")
    scene = loaded(tmp_path, file.binary(), mirror=mirror)
    (start,) = scene.starts
    matrix = start.pose.matrix()
    side = -0.5 if mirror else 0.5
    assert matrix[:, 0] == pytest.approx([np.cos(np.pi / 6.0), side, 0.0])
    assert matrix[:, 2] == pytest.approx([0.0, 0.0, 1.0])
    assert [node.tag for node in scene.path_nodes] == ["PathNode_1"]
    assert [victim.name for victim in scene.victims] == ["FemaleVictim_0"]


def lamp(file: FbxFile, name: str, *facts: tuple[str, str, tuple[object, ...]]) -> None:
    """A light 3 m up."""
    node = file.add("Model", name, "Light", place(0.0, 0.0, 300.0))
    file.add("NodeAttribute", name, "Light", *facts, to=node, inside=[dom("TypeFlags", "Light")])


@pytest.mark.parametrize("way", ["text6", "binary"])
def test_lights(tmp_path: Path, file: FbxFile, way: str) -> None:
    """They shine along -y of their nodes; those that are off are counted."""
    file.mesh("Floor", size=CM)
    color = prop("Color", 1.0, 0.5, 0.0, kind="Color")
    spot = [prop("LightType", 2, kind="enum"), prop("Intensity", 50.0, kind="Number")]
    lamp(file, "Spot", color, *spot, prop("OuterAngle", 60.0, kind="Number"))
    lamp(file, "Sun", prop("LightType", 1, kind="enum"), prop("Intensity", 900.0, kind="Number"))
    lamp(file, "Off", prop("CastLight", 0, kind="bool"))
    findings = Findings()
    scene = loaded(tmp_path, getattr(file, way)(), findings)
    first, second = scene.lights
    assert (first.name, first.kind, first.cone) == ("Spot", LightKind.SPOT, 30.0)
    assert (first.color, first.brightness) == ((1.0, 0.5, 0.0), 0.5)
    assert first.position == pytest.approx((0.0, 0.0, 3.0))
    direction = np.array(first.direction) / np.linalg.norm(first.direction)
    assert direction == pytest.approx([0.0, -1.0, 0.0])
    assert (second.kind, second.brightness) == (LightKind.DIRECTIONAL, 1.0)
    assert findings.skipped_names == {"Light that is switched off": ["Off"]}


@pytest.mark.parametrize("way", ["text6", "binary"])
def test_what_is_left_out_is_counted(tmp_path: Path, file: FbxFile, way: str) -> None:
    """Cameras, animations and the like, by kind and name; bones and groups are no things."""
    file.mesh("Floor", size=CM)
    for kind in ("Camera", "CameraSwitcher", "CameraStereo", "LimbNode", "Null"):
        file.model(f"A{kind}", kind)
    file.add("AnimationStack", "Take 001")
    file.add("Constraint", "Aim", "Position From Positions")
    file.add("Audio", "Bang", "Clip")
    file.add("Character", "Man")
    findings = Findings()
    loaded(tmp_path, getattr(file, way)(), findings)
    assert findings.skipped_names == {
        "Camera": ["ACamera"], "CameraSwitcher": ["ACameraSwitcher"],
        "CameraStereo": ["ACameraStereo"], "AnimationStack": ["Take 001"],
        "Constraint": ["Aim"], "Audio": ["Bang"], "Character": ["Man"],
    }  # fmt: skip


def test_lines_and_nothing(tmp_path: Path, file: FbxFile) -> None:
    """A file without any mesh is refused, with what there is in it."""
    file.mesh("Line", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [(0, 1)])
    file.model("Eye", "Camera")
    message = refused(write(tmp_path, file.binary(), "line.fbx"))
    assert "no mesh in this file, but 1 Camera, 1 points and lines" in message
    file.mesh("Floor", size=CM)
    findings = Findings()
    loaded(tmp_path, file.binary(), findings)
    assert findings.skipped_names["points and lines"] == ["Line"]


def test_places_that_are_none(tmp_path: Path, file: FbxFile) -> None:
    """A node whose place is no number, with all in it; a corner that is none, with its faces."""
    nowhere = prop("Lcl Scaling", float("nan"), 1.0, 1.0, kind="Lcl Scaling")
    lost = file.mesh("Lost", CUBE_POINTS, CUBE_FACES, nowhere, size=CM)
    file.mesh("Child", size=CM, to=lost)
    points = [*CUBE_POINTS, (float("nan"), 0.0, 0.0)]
    file.mesh("Floor", points, [*CUBE_FACES, (0, 1, 8)], size=CM)
    for content in (file.text7(), file.binary()):
        findings = Findings()
        scene = loaded(tmp_path, content, findings)
        assert [thing.name for thing in scene.objects] == ["Floor"]
        assert "has no place" in told(findings)
    report = import_map(Request(tmp_path / "thing.fbx", cache=tmp_path / "cache")).report
    assert report.extents == pytest.approx((1.0, 1.0, 1.0))


# ---- meshes ----------------------------------------------------------------------------------


def test_polygons_with_inward_corners(tmp_path: Path, file: FbxFile) -> None:
    """Ears are clipped."""
    outline = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 2.0, 0.0), (1.0, 0.5, 0.0), (0.0, 2.0, 0.0)]
    file.mesh("Notched", outline, [(0, 1, 2, 3, 4)], size=CM)
    mesh = whole(loaded(tmp_path, file.text6()))
    assert len(mesh.triangles) == 3
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 2].sum() / 2.0 == pytest.approx(2.5)
    assert len(places(mesh)) == 5


EYE = np.eye(4).reshape(-1).tolist()


def skinned(file: FbxFile) -> FbxFile:
    """A figure whose bone stands 3 m up, though its mesh was made 1 m below that."""
    file.mesh("Figure", size=CM, at=(0.0, 500.0, 0.0))
    bone = file.model("Bone", "LimbNode", place(0.0, 0.0, 300.0))
    skin = file.add("Deformer", "Skin", "Skin", to=file.objects[2 - 1])
    cluster = file.add(
        "Deformer", "Cluster", "Cluster", to=skin,
        inside=[
            dom("Indexes", list(range(8))), dom("Weights", [1.0] * 8),
            dom("Transform", EYE), dom("TransformLink", EYE),
        ],
    )  # fmt: skip
    file.links.append((bone, cluster, ""))
    return file


@pytest.mark.parametrize("way", ["text7", "binary"])
def test_bones(tmp_path: Path, file: FbxFile, way: str) -> None:
    """A figure stands where its bones are, not where its node is."""
    scene = loaded(tmp_path, getattr(skinned(file), way)())
    assert bounds(scene)["Figure"] == ([0, 0, 3], [1, 1, 4])


def test_blend_shapes(tmp_path: Path, file: FbxFile) -> None:
    """By their weights; those that have none are counted."""
    file.mesh("Face", size=CM)
    blend = file.add("Deformer", "Blend", "BlendShape", to=file.objects[-1])
    for name, percent in (("Smile", 50.0), ("Frown", 0.0)):
        channel = file.add(
            "Deformer", name, "BlendShapeChannel", prop("DeformPercent", percent, kind="Number"),
            to=blend, inside=[dom("DeformPercent", percent), dom("FullWeights", [100.0])],
        )  # fmt: skip
        file.add(
            "Geometry", name, "Shape", to=channel,
            inside=[dom("Indexes", [4, 5, 6, 7]), dom("Vertices", [0.0, 0.0, 100.0] * 4)],
        )  # fmt: skip
    findings = Findings()
    scene = loaded(tmp_path, file.binary(), findings)
    assert bounds(scene)["Face"][1] == [1, 1, 1.5]
    assert findings.skipped_names == {"BlendShape of no weight": ["Frown"]}


# ---- looks -----------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["text6", "binary"])
def test_colors(tmp_path: Path, file: FbxFile, way: str) -> None:
    """Colour times factor; opacity by any of three properties."""
    white = prop("TransparentColor", 1.0, 1.0, 1.0, kind="Color")
    made = {
        "Half": [prop("DiffuseFactor", 0.5)],
        "Glass": [prop("TransparencyFactor", 0.25), white],
        "Opacity": [prop("Opacity", 0.5), prop("TransparencyFactor", 0.9), white],
        "Maya": [prop("TransparencyFactor", 1.0), prop("TransparentColor", 0.0, 0.0, 0.0)],
        "Clear": [prop("Opacity", 0.0)],
    }
    used = [file.material(name, (1.0, 0.0, 0.5), *facts) for name, facts in made.items()]
    file.mesh("Cube", size=CM, materials=used, slots=[0, 1, 2, 3, 4, 4])
    scene = loaded(tmp_path, getattr(file, way)())
    assert {name: material.color for name, material in scene.materials.items()} == {
        "Half": (0.5, 0.0, 0.25, 1.0),
        "Glass": (1.0, 0.0, 0.5, 0.75),
        "Opacity": (1.0, 0.0, 0.5, 0.5),
        "Maya": (1.0, 0.0, 0.5, 1.0),
        "Clear": (1.0, 0.0, 0.5, 0.0),  # which the builder shows as opaque
    }


def test_materials_of_one_name(tmp_path: Path, file: FbxFile) -> None:
    """They stay apart."""
    used = [file.material("Red", (1.0, 0.0, 0.0)), file.material("Red", (0.5, 0.0, 0.0))]
    file.mesh("Cube", size=CM, materials=used, slots=[0, 0, 0, 1, 1, 1])
    scene = loaded(tmp_path, file.binary())
    assert [material.color[0] for material in scene.materials.values()] == [1.0, 0.5]


@pytest.mark.parametrize("way", ["text6", "text7", "binary"])
@pytest.mark.parametrize("name", [r"C:\Users\me\Wood.tga", "/home/me/wood.png", "..\\x\\WOOD.png"])
def test_pictures_by_name(tmp_path: Path, file: FbxFile, way: str, name: str) -> None:
    """Paths are of other computers; texture coordinates count upwards."""
    material = file.material("Wood", (0.1, 0.1, 0.1))
    file.picture(material, name)
    file.mesh("Cube", size=CM, materials=[material], slots=[0] * 6, uvs=CORNERS)
    picture = write(tmp_path, pixels(), "textures/wood.png")
    scene = loaded(tmp_path, getattr(file, way)())
    assert scene.materials["Wood"].texture == picture
    assert scene.materials["Wood"].color == (1.0, 1.0, 1.0, 1.0)
    assert picture in scene.source.files
    mesh = whole(scene)
    assert mesh.uvs is not None
    assert mesh.uvs[0, :2] == pytest.approx(np.array(CORNERS[:2]))


@pytest.mark.parametrize("way", ["text6", "text7", "binary"])
def test_pictures_inside(tmp_path: Path, file: FbxFile, way: str) -> None:
    """The content of a video."""
    material = file.material("Wood", (1.0, 1.0, 1.0))
    file.picture(material, r"C:\wood.png", pixels())
    file.mesh("Cube", size=CM, materials=[material], slots=[0] * 6, uvs=CORNERS)
    scene = loaded(tmp_path, getattr(file, way)())
    assert scene.materials["Wood"].image == pixels()


@pytest.mark.parametrize("same", [False, True])
def test_holes_by_a_picture(tmp_path: Path, file: FbxFile, same: bool) -> None:
    """The picture that is connected to what passes, or the surface's own."""
    material = file.material("Fence", (1.0, 1.0, 1.0), prop("TransparencyFactor", 1.0))
    texture = file.picture(material, "fence.png")
    if same:
        file.links.append((texture, material, "TransparentColor"))
    else:
        file.picture(material, "mask.png", by="TransparencyFactor")
    file.mesh("Cube", size=CM, materials=[material], slots=[0] * 6, uvs=CORNERS)
    for name in ("fence.png", "mask.png"):
        write(tmp_path, pixels(), name)
    scene = loaded(tmp_path, file.binary())
    assert whole(scene).uvs is not None
    found = scene.materials["Fence"]
    assert found.color == (1.0, 1.0, 1.0, 1.0)
    assert found.texture == tmp_path / "fence.png"
    assert found.opacity == Opacity(None if same else tmp_path / "mask.png", blend=True)


def test_missing_pictures_are_listed(tmp_path: Path, file: FbxFile) -> None:
    """Once each."""
    material = file.material("Wood", (1.0, 1.0, 1.0))
    file.picture(material, r"C:\wood.png")
    file.mesh("Cube", size=CM, materials=[material], slots=[0] * 6, uvs=CORNERS)
    source = write(tmp_path, file.binary(), "thing.fbx")
    report = import_map(Request(source, cache=tmp_path / "cache")).report
    assert [(kind, Path(name).name) for kind, name, _ in report.missing] == [
        ("texture", "wood.png")
    ]


def test_textures_that_are_moved(tmp_path: Path, file: FbxFile) -> None:
    """Their scale and place in the picture."""
    material = file.material("Wood", (1.0, 1.0, 1.0))
    texture = file.picture(material, "wood.png")
    texture.properties += [prop("Scaling", 2.0, 2.0, 1.0, kind="Vector")]
    file.mesh("Cube", size=CM, materials=[material], slots=[0] * 6, uvs=CORNERS)
    mesh = whole(loaded(tmp_path, file.binary()))
    assert mesh.uvs is not None
    step = (mesh.uvs[0, 1] - mesh.uvs[0, 0]).tolist()
    assert step in ([pytest.approx(0.05), 0.0], [pytest.approx(0.2), 0.0])


@pytest.mark.parametrize("way", ["text6", "text7", "binary"])
def test_vertex_colors(tmp_path: Path, file: FbxFile, way: str) -> None:
    """Where there is no material, as few plain ones."""
    red, blue = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
    file.mesh("Cube", size=CM, colors=[red] * 12 + [blue] * 12)
    scene = loaded(tmp_path, getattr(file, way)())
    assert sorted(material.color for material in scene.materials.values()) == [blue, red]
    mesh = whole(scene)
    assert mesh.slots is not None
    assert np.bincount(mesh.slots).tolist() == [6, 6]


# ---- bad files -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "line", "problem"),
    [
        ("\t\t\ta: 0,0,0", "\t\t\t},0.294444,\n\t\t\ta: 0,0,0", 0, "',' after a bracket"),
        ("a: 0,0,0,100", "a: 0,0,0},0.294444,100", 0, "',' after a bracket"),
        ("a: 0,0,0,100", "a: 0,0,0\n},\n0.294444,100", 1, "',' after a bracket"),
        ("a: 0,0,0,100", "a: 0,0,0\n}\n0.294444,100", 2, "'0.294444' after a bracket"),
        ("a: 0,0,0,100", "a: 0,0,,100", 0, "after a comma"),
        ("a: 0,0,0,100", "a: 0,0.0.1,0,100", 0, "'0.0.1' is no number"),
        ("a: 0,0,0,100", "a: 0,zero,0,100", 0, "'zero' is no number"),
        ("a: 0,0,0,100", "a: 0,0,0 100", 0, "'0 100' is no number"),
        ("a: 0,0,0,100", "a: 0,0,0,}100", 0, "'100' after a bracket"),
    ],
)
def test_faulty_text(
    tmp_path: Path, file: FbxFile, old: str, new: str, line: int, problem: str
) -> None:
    """It is refused with its line."""
    file.mesh("Cube", size=CM)
    text = file.text7().decode()
    assert old in text
    expected = text[: text.index(old)].count("\n") + 1 + line
    message = refused(write(tmp_path, text.replace(old, new), "bad.fbx"))
    assert f"line {expected}: " in message
    assert problem in message


@pytest.mark.parametrize(
    ("old", "new", "line", "problem"),
    [
        ("Vertices: 0,0,0,", "Vertices: 0,0,0\n\t\t},0.294444,", 1, "',' after a bracket"),
        ("Vertices: 0,0,0,", "Vertices: 0,0,0\n\t\t,,", 1, "a comma after a comma"),
        ("Vertices: 0,0,0,", 'Vertices: 0,0,"0,', 0, "is no number"),
        ("Connections:", "} Connections:", 0, "never opened"),
        ("Objects:", "Objects: {", 0, "after a bracket"),
    ],
)
def test_faulty_old_text(
    tmp_path: Path, file: FbxFile, old: str, new: str, line: int, problem: str
) -> None:
    """Version 6.1 has no brackets around arrays."""
    file.mesh("Cube", size=CM)
    text = file.text6().decode()
    assert old in text
    expected = text[: text.index(old)].count("\n") + 1 + line
    message = refused(write(tmp_path, text.replace(old, new), "bad.fbx"))
    assert f"line {expected}: " in message
    assert problem in message


def test_sound_text_passes() -> None:
    """What exporters write, beyond the samples."""
    text = b"""; a comment {
Objects:  {
\tA: "a } { , string", T
\tCameraIndexName:
\tKey:
\t\t1924423250,-90.0,L
\tContent: ,
\t"abc
def"
\tEmpty:  {
\t}
\tVertices: 1.0,-2.5e-3
\t,3,nan,-1.#IND,-nan(ind),inf
\tNormals: *3 {
\t\ta: 1,2,
3
\t} }
"""
    for closely in (False, True):
        check_text(Path("a.fbx"), plain_text(text), closely=closely)


def whole_or_refused(folder: Path, content: bytes, end: int, complete: Bounds) -> bool:
    """Whether a file that is cut there is refused; else it has to give what the whole one gives."""
    path = write(folder, content[:end], "cut.fbx")
    try:
        found = read(path)
    except MapImportError as error:
        one_line(error)
        return True
    assert bounds(found) == complete
    assert found.starts
    return False


@pytest.mark.parametrize("way", slow_but({"text7"}.__contains__, ["text6", "text7"]))
def test_text_cut_anywhere(tmp_path: Path, file: FbxFile, way: str) -> None:
    """At every byte: refused, unless all that counts stands before it."""
    file.mesh("Floor", size=CM)
    file.model("PlayerStart_1")
    content: bytes = getattr(file, way)()
    complete = bounds(loaded(tmp_path, content))
    last = content.rindex(b"\n\tConnect:" if way == "text6" else b"\n\tC:")
    for end in range(len(content)):
        try:
            check_text(tmp_path / "cut.fbx", content[:end])
        except MapImportError:
            continue
        assert whole_or_refused(tmp_path, content, end, complete) or end > last


def test_binary_cut_anywhere(tmp_path: Path, file: FbxFile) -> None:
    """At some bytes, where nodes begin and within them (each takes a process)."""
    file.mesh("Floor", size=CM)
    file.model("PlayerStart_1")
    content = file.binary()
    complete = bounds(loaded(tmp_path, content))
    marks = [match.start() for match in re.finditer(rb"Objects|Geometry|Connections", content)]
    chosen = {*marks, *range(0, len(content), 97), *range(len(content) - 5, len(content))}
    refusals = [whole_or_refused(tmp_path, content, end, complete) for end in sorted(chosen)]
    assert refusals[:-8] == [True] * len(refusals[:-8])


def test_damaged_binary(tmp_path: Path, file: FbxFile) -> None:
    """Bytes that are exchanged are read or refused, by a line."""
    file.mesh("Floor", size=CM)
    content = file.binary(packed=True)
    chance = np.random.default_rng(35)
    for _ in range(25):
        data = bytearray(content)
        for place_, value in zip(
            chance.integers(27, len(data), 3), chance.integers(0, 256, 3), strict=True
        ):
            data[place_] = value
        try:
            loaded(tmp_path, bytes(data))
        except MapImportError as error:
            one_line(error)


def test_packed_arrays_are_no_bombs(tmp_path: Path, file: FbxFile) -> None:
    """An array that says it has a billion values."""
    import struct
    import zlib

    file.mesh("Floor", size=CM)
    content = file.binary(packed=True)
    place_ = content.index(b"Verticesd") + len(b"Verticesd")
    length = struct.unpack_from("<III", content, place_)[2]
    packed = zlib.compress(bytes(1 << 20))
    head = struct.pack("<III", 1_000_000_000, 1, len(packed))
    bomb = content[:place_] + head + packed + content[place_ + 12 + length :]
    refused(write(tmp_path, bomb, "bomb.fbx"))


def test_bounds(tmp_path: Path, file: FbxFile, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bytes, nodes, triangles, nesting."""
    file.mesh("Floor", size=CM)
    path = write(tmp_path, file.binary(), "large.fbx")
    monkeypatch.setattr(answer, "MAX_NODES", 1)
    assert "2 nodes are more than 1" in refused(path)
    monkeypatch.undo()
    monkeypatch.setattr(answer, "MAX_TRIANGLES", 11)
    monkeypatch.setattr("usarsim_maps.meshes.polygons.MAX_TRIANGLES", 11)
    assert "12 triangles are more than 11" in refused(path)
    monkeypatch.undo()
    monkeypatch.setattr(answer, "MAX_BYTES", 1 << 10)
    assert "larger than" in refused(path)
    monkeypatch.undo()
    deep = "A: {\n" * 300 + "}\n" * 300
    assert "brackets within brackets" in refused(write(tmp_path, deep, "deep.fbx"))
    node: Fbx | None = None
    for number in range(300):
        node = file.model(f"N{number}", "Null", to=node)
    refused(write(tmp_path, file.binary(), "deep.fbx"))


def test_only_regular_files(tmp_path: Path) -> None:
    """A pipe is an error at once."""
    os.mkfifo(tmp_path / "pipe.fbx")
    assert "pipe.fbx" in refusal(lambda: read(tmp_path / "pipe.fbx"))


# ---- the library at a distance ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("program", "patience", "reason"),
    [
        ("import time; time.sleep(600)", 0.5, "the FBX library has not read it within"),
        (
            "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
            60.0,
            "crashes on it (SIGSEGV)",
        ),
        ("import os; os.abort()", 60.0, "crashes on it (SIGABRT)"),
        ("raise SystemExit(3)", 60.0, "ends in the middle of it"),
        ("print('FBX scene 1')", 60.0, "ends in the middle of it"),
        ("SEND(b'[]')", 60.0, "ends in the middle of it"),
        ("SEND(b'[' * 100000)", 60.0, "ends in the middle of it"),
        ("SEND(b'{}')", 60.0, "answer makes no sense"),
        ("SEND(b'{\"settings\": 1}')", 60.0, "answer makes no sense"),
        ('SEND(b\'{"unusable": "no such symbol"}\')', 60.0, "usarsim-server[fbx]"),
        ('SEND(b\'{"refused": "broken"}\')', 60.0, "broken"),
    ],
)
def test_a_library_that_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, patience: float, reason: str
) -> None:
    """Whatever it does is a line with file, reason and cure; nothing is left behind."""
    send = (
        "import sys\n"
        "def SEND(text):\n"
        "    head = b'FBX scene 1\\n' + len(text).to_bytes(8, 'little')\n"
        "    sys.stdout.buffer.write(head + text)\n"
    )
    (tmp_path / "child.py").write_text(send + program)
    shelf = tmp_path / "temporary"
    shelf.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(shelf))
    monkeypatch.setattr(answer, "CHILD", tmp_path / "child.py")
    monkeypatch.setattr(apart, "PATIENCE", patience)
    path = write(tmp_path, yard().binary(), "thing.fbx")
    assert reason in refused(path)
    assert not list(shelf.iterdir())
    assert sorted(found.name for found in tmp_path.iterdir()) == [
        "child.py", "temporary", "thing.fbx"
    ]  # fmt: skip


def test_answers_that_lie(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every part of an answer is looked at: changed at any place, it is refused or harmless."""
    path = write(tmp_path, yard().binary(), "thing.fbx")
    kept: list[bytes] = []
    ask = answer._answer

    def keep(source: Path, content: bytes) -> bytes:
        kept.append(ask(source, content))
        return kept[-1]

    monkeypatch.setattr(answer, "_answer", keep)
    read(path)
    chance = np.random.default_rng(7)
    for _ in range(400):
        data = bytearray(kept[0][: chance.integers(1, len(kept[0]) + 1)] if chance.random() < 0.2
                         else kept[0])  # fmt: skip
        data[chance.integers(0, len(data))] = chance.integers(0, 256)
        monkeypatch.setattr(answer, "_answer", lambda *_, data=data: bytes(data))
        try:
            read(path)
        except MapImportError as error:
            one_line(error)


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line that says how to get it."""
    path = write(tmp_path, yard().text6(), "thing.fbx")
    find: Callable[..., object] = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "ufbx" else find(name, *a)
    )
    monkeypatch.setitem(__import__("sys").modules, "ufbx", None)
    message = refused(path)
    assert "FBX files need the Python package 'ufbx'" in message
    assert 'pip install "usarsim-server[fbx]"' in message


# ---- meshes that maps name -------------------------------------------------------------------

CHAIR = actor("StaticMeshActor", "M", (500, 0, 0), "StaticMesh=StaticMesh'Pkg.Props.Chair'")


@pytest.mark.parametrize("unit", [1.0, 2.54, 100.0])
@pytest.mark.parametrize("up", [Y, Z])
def test_unreal_maps(tmp_path: Path, unit: float, up: int) -> None:
    """Meshes take the map's scale, whatever their files say, and keep their axes."""
    file = FbxFile(up=up, unit=unit)
    stretched = [(2.0 * x, y, z) for x, y, z in CUBE_POINTS]
    red = file.material("Red", (1.0, 0.0, 0.0))
    file.mesh("Chair", stretched, CUBE_FACES, size=250.0, materials=[red], slots=[0] * 6)
    file.mesh("UCX_Chair_01", stretched, CUBE_FACES, size=250.0)
    write(tmp_path, file.text6(), "StaticMeshes/chair.fbx")
    scene = read_level(tmp_path, level(room(), CHAIR))
    (part,) = scene.objects[0].parts
    assert isinstance(part.shape, Mesh)
    size: Array = np.ptp(part.shape.vertices, axis=0)
    assert size == pytest.approx([2.0, 1.0, 1.0])
    assert part.shape.materials == ("Red",)
    assert len(part.shape.hulls) == 1
    assert scene.materials["Red"].color == (1.0, 0.0, 0.0, 1.0)


def test_gazebo_worlds(tmp_path: Path) -> None:
    """Their meshes keep unit and axes of the file."""
    file = FbxFile(up=Y)
    file.mesh("Chair", size=CM, at=(0.0, 0.0, 200.0))
    write(tmp_path, file.binary(), "thing/meshes/chair.fbx")
    uri = "<mesh><uri>model://thing/meshes/chair.fbx</uri><scale>2 1 1</scale></mesh>"
    mesh = whole(load_world(tmp_path, model("m", shape(uri))))
    assert mesh.vertices.min(axis=0) == pytest.approx([0.0, -3.0, 0.0])
    assert mesh.vertices.max(axis=0) == pytest.approx([2.0, -2.0, 1.0])


def test_a_broken_mesh_is_a_missing_mesh(tmp_path: Path) -> None:
    """A world is imported without it."""
    write(tmp_path, yard().text6()[:500], "StaticMeshes/chair.fbx")
    findings = Findings()
    read_level(tmp_path, level(room(), CHAIR), findings)
    assert ("mesh", "Pkg.Props.Chair", 1) in findings.missing_list()
    assert "chair.fbx: line 25: " in told(findings)
