"""Stages of OpenUSD: units and axes, composition, instances, places (worlds 30 to 34, 38)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built_worlds import build_world
from mesh_samples import read
from t3d_maps import corner
from usd_stages import box, extents, moved, reference, saved, stage_at, world

from usarsim_maps.findings import Findings
from usarsim_maps.reader import find_reader
from usarsim_maps.scene import Mesh

pxr = pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, Vt  # noqa: E402

# ---- frames --------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", [0.01, 1.0, 0.0254])
def test_units(tmp_path: Path, unit: float) -> None:
    """Equivalent stages in different units have the same extents in metres (worlds 30)."""
    stage = stage_at(tmp_path / "a.usda", unit=unit)
    moved(box(stage, "/World/Box", (0, 0, 0), (1 / unit, 2 / unit, 3 / unit)), (1 / unit, 0, 0))
    scene = saved(stage)
    np.testing.assert_allclose(extents(scene.objects[0]), [[1, 0, 0], [2, 2, 3]], rtol=1e-6)
    assert scene.source.units_per_metre == pytest.approx(1 / unit)
    assert not scene.source.assumed
    wide = saved(stage, scale=2.5 / unit)
    np.testing.assert_allclose(extents(wide.objects[0])[1], [0.8, 0.8, 1.2], rtol=1e-6)


def test_units_that_are_not_stated(tmp_path: Path) -> None:
    """Without `metersPerUnit` a unit is a centimetre, as the format says; the report tells so."""
    path = tmp_path / "a.usda"
    path.write_text('#usda 1.0\n(\n upAxis = "Z"\n)\ndef Cube "Box"\n{\n double size = 200\n}\n')
    scene = read(path)
    assert scene.source.assumed
    np.testing.assert_allclose(extents(scene.objects[0]), [[-1, -1, -1], [1, 1, 1]])


def test_up_axes(tmp_path: Path) -> None:
    """The same room with Y and with Z upwards coincides (worlds 31)."""
    upright = stage_at(tmp_path / "z.usda")
    moved(box(upright, "/World/Box", (0, 0, 0), (1, 2, 3)), (5, 6, 7), yaw=30.0)
    lying = stage_at(tmp_path / "y.usda", up="Y")
    thing = box(lying, "/World/Box", (0, 0, -2), (1, 3, 0))
    shape = UsdGeom.Xformable(thing)
    shape.AddTranslateOp().Set(Gf.Vec3d(5, 7, -6))
    shape.AddRotateYOp().Set(30.0)
    one, other = saved(upright).objects[0], saved(lying).objects[0]
    np.testing.assert_allclose(extents(one), extents(other), atol=1e-6)
    np.testing.assert_allclose(one.pose.position, other.pose.position, atol=1e-9)
    np.testing.assert_allclose(one.pose.matrix(), other.pose.matrix(), atol=1e-6)
    np.testing.assert_allclose(one.pose.rotate((1, 0, 0)), (np.cos(np.pi / 6), 0.5, 0), atol=1e-6)


def test_same_layout_as_text(tmp_path: Path) -> None:
    """The asymmetric map exported as USD and as T3D looks the same from above (worlds 9)."""
    (tmp_path / "corner.t3d").write_text(corner())
    boxes = {
        "Floor": ((-1000, -1000, -50), (1000, 1000, 0)),
        "Long": ((0, 0, 0), (750, 100, 250)),
        "Short": ((0, 100, 0), (100, 400, 250)),
        "Tower": ((500, -250, 0), (600, -100, 500)),
    }
    stage = stage_at(tmp_path / "corner.usda", unit=0.004)
    for name, ((a, b, c), (d, e, f)) in boxes.items():
        box(stage, f"/World/{name}", (a, -e, c), (d, -b, f))  # exporters negate Y
    binary = world(tmp_path, stage)
    text = build_world(tmp_path, read(tmp_path / "corner.t3d"))
    down = np.array([[0.0, 0.0, -1.0]])
    for x, y in np.random.default_rng(2).uniform(-3.9, 3.9, (60, 2)).tolist():
        np.testing.assert_allclose(
            binary.rays((x, y, 5.0), down), text.rays((x, y, 5.0), down), atol=1e-5
        )


def test_mirror_switch(stage: Any) -> None:
    """A map that lost its handedness is reflected on demand; faces look outwards still
    (worlds 74)."""
    box(stage, "/World/Box", (0, 1, 0), (1, 2, 1))
    assert extents(saved(stage).objects[0])[0][1] == pytest.approx(1.0)
    mirrored = saved(stage, mirror=True).objects[0]
    assert extents(mirrored)[0][1] == pytest.approx(-2.0)


@pytest.mark.parametrize("how", ["plain", "left-handed", "mirrored", "both"])
def test_normals(tmp_path: Path, stage: Any, how: str) -> None:
    """Left-handed meshes and mirroring transforms keep normals outside (worlds 36)."""
    mesh = box(stage, "/World/Box", (-1, -1, -1), (1, 1, 1))
    if how in ("left-handed", "both"):
        mesh.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
        mesh.GetFaceVertexIndicesAttr().Set(list(mesh.GetFaceVertexIndicesAttr().Get())[::-1])
    if how in ("mirrored", "both"):
        moved(mesh, (0, 0, 0), (-1, 1, 1))
    built = world(tmp_path, stage)
    model = built.model
    (part,) = built.scene.objects[0].parts
    linear = built.scene.objects[0].pose.matrix() @ part.matrix[:3, :3]
    corners = (part.shape.vertices @ linear.T)[part.shape.triangles]
    if np.linalg.det(linear) < 0.0:
        corners = corners[:, ::-1]
    for a, b, c in corners:
        assert np.cross(b - a, c - a) @ (a + b + c) > 0.0
    assert model.nmesh >= 1
    assert built.solid_rays((5.0, 0.0, 0.0), np.array([[-1.0, 0, 0]])) == pytest.approx([4.0])


# ---- composition ---------------------------------------------------------------------------


def chair(folder: Path, name: str = "chair.usda", unit: float = 1.0) -> Path:
    """A file with a chair: seat and back."""
    stage = stage_at(folder / name, unit=unit, top="Chair")
    box(stage, "/Chair/Seat", (0, 0, 0), (0.5, 0.5, 0.5))
    box(stage, "/Chair/Back", (0, 0, 0.5), (0.1, 0.5, 1.0))
    stage.GetRootLayer().Save()
    return folder / name


def test_references_payloads_and_instances(tmp_path: Path) -> None:
    """References, nested ones, payloads and instances are there, each at its place (worlds 32)."""
    chair(tmp_path)
    room = stage_at(tmp_path / "room.usda", top="Room")
    reference(room, "/Room/Inner", "chair.usda", (0, 0, 1))
    room.GetRootLayer().Save()
    stage = stage_at(tmp_path / "a.usda")
    reference(stage, "/World/Plain", "chair.usda", (1, 0, 0))
    for number in range(3):
        prim = reference(stage, f"/World/Copy_{number}", "chair.usda", (2 + number, 0, 0))
        prim.SetInstanceable(True)
    reference(stage, "/World/Nested", "room.usda", (10, 0, 0))
    heavy = UsdGeom.Xform.Define(stage, "/World/Heavy").GetPrim()
    heavy.GetPayloads().AddPayload("chair.usda")
    moved(heavy, (20, 0, 0))
    objects = {thing.name: thing for thing in saved(stage).objects}
    assert sorted(objects) == ["Copy_0", "Copy_1", "Copy_2", "Heavy", "Inner", "Plain"]
    places = {name: thing.pose.position for name, thing in objects.items()}
    assert places["Plain"] == (1, 0, 0)
    assert places["Copy_2"] == (4, 0, 0)
    assert places["Inner"] == (10, 0, 1)
    assert places["Heavy"] == (20, 0, 0)
    assert all(len(thing.parts) == 2 for thing in objects.values())
    # All copies of a mesh are one mesh in memory.
    assert len({id(thing.parts[0].shape) for thing in objects.values()}) == 1


def test_point_instancers(stage: Any) -> None:
    """Six instances of two prototypes stand where they should; hidden ones do not (worlds 32)."""
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Trees")
    moved(instancer, (0, 0, 10))
    box(stage, "/World/Trees/Protos/Low", (0, 0, 0), (1, 1, 1))
    tall = UsdGeom.Xform.Define(stage, "/World/Trees/Protos/Tall")
    moved(tall, (0, 0, 1))
    box(stage, "/World/Trees/Protos/Tall/Trunk", (0, 0, 0), (1, 1, 5))
    instancer.CreatePrototypesRel().SetTargets(
        ["/World/Trees/Protos/Low", "/World/Trees/Protos/Tall"]
    )
    instancer.CreateProtoIndicesAttr([0, 1, 0, 1, 0, 1, 0])
    instancer.CreatePositionsAttr([(4.0 * n, 0, 0) for n in range(7)])
    instancer.CreateScalesAttr([(1, 1, 2)] * 7)
    turned = Gf.Rotation(Gf.Vec3d(0, 0, 1), 90).GetQuat()
    instancer.CreateOrientationsAttr([Gf.Quath(turned)] * 7)
    instancer.InvisIds([6], Usd.TimeCode.Default())
    objects = saved(stage).objects
    assert len(objects) == 6
    for number, thing in enumerate(objects):
        x = 4.0 * number
        height, foot = (10.0, 12.0) if number % 2 else (2.0, 10.0)
        expected = [[x - 1, 0, foot], [x, 1, foot + height]]
        np.testing.assert_allclose(extents(thing), expected, atol=0.02)


def test_missing_payload(stage: Any, findings: Findings) -> None:
    """A payload or reference that is not there is named; the rest loads (worlds 33)."""
    box(stage, "/World/Here", (0, 0, 0), (1, 1, 1))
    stage.DefinePrim("/World/Gone", "Xform").GetPayloads().AddPayload("gone/heavy.usdc")
    reference(stage, "/World/Lost", "lost.usda")
    assert [thing.name for thing in saved(stage, findings).objects] == ["Here"]
    missing = {name: times for kind, name, times in findings.missing_list() if kind == "file"}
    assert missing == {"gone/heavy.usdc": 1, "lost.usda": 1}
    assert any(w.subject == "gone/heavy.usdc" for w in findings.warnings())


def test_files_in_asset_folders(tmp_path: Path, stage: Any) -> None:
    """References are searched in the asset folders, too; all files that were read are told."""
    (tmp_path / "lib").mkdir()
    path = chair(tmp_path / "lib")
    reference(stage, "/World/Chair", "chair.usda")
    scene = saved(stage, assets=(tmp_path / "lib",))
    assert len(scene.objects) == 1
    assert set(scene.source.files) == {path, tmp_path / "a.usda"}


def test_variants(tmp_path: Path, stage: Any) -> None:
    """Of levels of detail the finest is taken, whatever is selected; others stay (worlds 34)."""
    thing = UsdGeom.Xform.Define(stage, "/World/Rock").GetPrim()
    groups = {"LOD": ["LOD2", "LOD0", "LOD1"], "look": ["wet", "dry"]}
    for group, names in groups.items():
        variants = thing.GetVariantSets().AddVariantSet(group)
        for name in names:
            variants.AddVariant(name)
            variants.SetVariantSelection(name)
            with variants.GetVariantEditContext():
                box(stage, f"/World/Rock/{name}", (0, 0, 0), (1, 1, 1))
    shapes = [part.shape for thing in saved(stage).objects for part in thing.parts]
    assert sorted(s.name for s in shapes if isinstance(s, Mesh)) == ["LOD0", "dry"]
    before = (tmp_path / "a.usda").read_bytes()
    read(tmp_path / "a.usda")
    assert (tmp_path / "a.usda").read_bytes() == before


def test_visibility_and_purpose(tmp_path: Path, stage: Any) -> None:
    """Invisible prims and proxies give neither contact nor rays (worlds 34)."""
    box(stage, "/World/Floor", (-5, -5, -0.1), (5, 5, 0))
    hidden = UsdGeom.Xform.Define(stage, "/World/Hidden")
    hidden.CreateVisibilityAttr("invisible")
    box(stage, "/World/Hidden/Box", (-1, -1, 0), (1, 1, 1))
    box(stage, "/World/Proxy", (-1, -1, 0), (1, 1, 2)).CreatePurposeAttr("proxy")
    box(stage, "/World/Render", (2, -1, 0), (3, 1, 2)).CreatePurposeAttr("render")
    stage.CreateClassPrim("/World/Class")
    box(stage, "/World/Class/Box", (-1, -1, 0), (1, 1, 3))
    built = world(tmp_path, stage)
    down = np.array([[0, 0, -1.0]])
    for cast in (built.rays, built.solid_rays):
        assert cast((0, 0, 4.0), down) == pytest.approx([4.0], abs=1e-5)
        assert cast((2.5, 0, 4.0), down) == pytest.approx([2.0], abs=1e-5)


# ---- places and lights ---------------------------------------------------------------------


def test_places(tmp_path: Path) -> None:
    """Starts, path nodes and victims are known by name, folder or attribute (worlds 38)."""
    stage = stage_at(tmp_path / "a.usda", unit=0.01)
    box(stage, "/World/Floor", (-500, -500, -10), (500, 500, 0))
    for number, name in enumerate(("PlayerStart", "PlayerStart_3", "playerstart2")):
        moved(UsdGeom.Xform.Define(stage, f"/World/{name}"), (100 * number, 200, 30), yaw=90.0)
    UsdGeom.Xform.Define(stage, "/World/RobotStarts")
    moved(UsdGeom.Xform.Define(stage, "/World/RobotStarts/Red"), (0, 100, 0))
    UsdGeom.Xform.Define(stage, "/World/PathNode_1")
    body = UsdGeom.Xform.Define(stage, "/World/FemaleVictim_0")
    box(stage, "/World/FemaleVictim_0/Body", (0, 0, 0), (50, 50, 180))
    assert body
    marked = UsdGeom.Xform.Define(stage, "/World/Gate").GetPrim()
    for name, value in {"usarsim:kind": "start", "usarsim:tag": "North"}.items():
        marked.CreateAttribute(name, Sdf.ValueTypeNames.String).Set(value)
    UsdGeom.Xform.Define(stage, "/World/VictimRoom")
    box(stage, "/World/VictimRoom/Wall", (0, 0, 0), (10, 10, 10))
    scene = saved(stage)
    tags = [start.tag for start in scene.starts]
    assert tags == ["PlayerStart", "PlayerStart_3", "playerstart2", "Red", "North"]
    assert scene.starts[1].pose.position == pytest.approx((1.0, 2.0, 0.3))
    assert scene.starts[1].pose.rotate((1, 0, 0)) == pytest.approx((0, 1, 0))
    assert [node.tag for node in scene.path_nodes] == ["PathNode_1"]
    assert [v.name for v in scene.victims] == ["FemaleVictim_0"]
    assert scene.victims[0].properties["figure"] == "female"
    assert [thing.name for thing in scene.objects] == ["Floor", "VictimRoom"]


def test_lights(stage: Any) -> None:
    """Lights keep kind, place, direction and colour; intensity becomes candela (worlds 76)."""
    lamp = UsdLux.SphereLight.Define(stage, "/World/Lamp")
    lamp.CreateRadiusAttr(0.1)
    lamp.CreateIntensityAttr(20.0 / (np.pi * 0.01))
    lamp.CreateColorAttr(Gf.Vec3f(1, 0, 0))
    moved(lamp, (1, 2, 3))
    UsdLux.DistantLight.Define(stage, "/World/Sun")
    spot = UsdLux.DiskLight.Define(stage, "/World/Spot")
    UsdLux.ShapingAPI.Apply(spot.GetPrim()).CreateShapingConeAngleAttr(25.0)
    UsdLux.DomeLight.Define(stage, "/World/Sky")
    box(stage, "/World/Floor", (-5, -5, -1), (5, 5, 0))
    lights = {light.name: light for light in saved(stage).lights}
    kinds = [light.kind.value for light in lights.values()]
    assert kinds == ["point", "directional", "spot", "ambient"]
    assert lights["Lamp"].position == (1, 2, 3)
    assert lights["Lamp"].color == pytest.approx((1, 0, 0))
    assert lights["Lamp"].brightness == pytest.approx(1.0, rel=1e-5)
    assert lights["Sun"].direction == pytest.approx((0, 0, -1))
    assert lights["Spot"].cone == 25.0


def test_names_of_objects(tmp_path: Path, stage: Any) -> None:
    """An object is the actor: what holds a single mesh, the component's owner, the model."""
    chair(tmp_path)
    UsdGeom.Xform.Define(stage, "/World/Cupboard")
    box(stage, "/World/Cupboard/Cube_001", (0, 0, 0), (1, 1, 1))
    UsdGeom.Xform.Define(stage, "/World/Actor_7")
    reference(stage, "/World/Actor_7/StaticMeshComponent0", "chair.usda")
    car = UsdGeom.Xform.Define(stage, "/World/Car").GetPrim()
    Usd.ModelAPI(car).SetKind("component")
    box(stage, "/World/Car/Body", (0, 0, 0), (1, 1, 1))
    reference(stage, "/World/Car/SeatOne", "chair.usda")
    UsdGeom.Xform.Define(stage, "/World/Group")
    box(stage, "/World/Group/One", (0, 0, 0), (1, 1, 1))
    box(stage, "/World/Group/Two", (0, 0, 0), (1, 1, 2))
    info = stage.GetPrimAtPath("/World/Cupboard")
    info.SetAssetInfoByKey("unreal", {"assetType": "StaticMesh"})
    objects = saved(stage).objects
    parts = {thing.name: len(thing.parts) for thing in objects}
    assert parts == {"Cupboard": 1, "Actor_7": 2, "Car": 3, "One": 1, "Two": 1}
    assert objects[0].kind == "StaticMesh"


def test_animation_is_taken_at_its_beginning(stage: Any) -> None:
    """A prim that moves over time stands where it begins."""
    mesh = box(stage, "/World/Lift", (0, 0, 0), (1, 1, 1))
    place = UsdGeom.Xformable(mesh).AddTranslateOp()
    place.Set(Gf.Vec3d(0, 0, 3), 10)
    place.Set(Gf.Vec3d(0, 0, 9), 50)
    assert saved(stage).objects[0].pose.position == (0, 0, 3)


def test_recognised_by_content(tmp_path: Path) -> None:
    """Stages are recognised without an extension."""
    for name, cookie in {"a": b"#usda 1.0\n", "b": b"PXR-USDC...."}.items():
        (tmp_path / name).write_bytes(cookie)
        assert find_reader(tmp_path / name).title == "OpenUSD"


def test_arrays(stage: Any) -> None:
    """Arrays that hold something else than expected count as absent."""
    mesh = box(stage, "/World/Box", (0, 0, 0), (1, 1, 1))
    mesh.GetPointsAttr().Set(Vt.Vec3fArray())
    box(stage, "/World/Good", (0, 0, 0), (1, 1, 1))
    assert [thing.name for thing in saved(stage).objects] == ["Good"]
