"""Every type of OpenUSD is in the world or in the report; moments, copies, levels of detail."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_samples import read, told
from usd_stages import box, extents, moved, reference, saved, stage_at

from usarsim_maps.findings import Findings
from usarsim_maps.support import Support
from usarsim_maps.usd.schemas import API_SCHEMAS, PRIM_TYPES
from usarsim_maps.usd.usd import UsdReader

pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux


def concrete_types(root: str = "UsdTyped") -> list[str]:
    """Names of all types of prims that the library knows."""
    found = []
    for below in Tf.Type.FindByName(root).derivedTypes:
        name = Usd.SchemaRegistry.GetConcreteSchemaTypeName(below)
        found += ([name] if name else []) + concrete_types(below.typeName)
    return sorted(found)


EFFECTS = {
    "BlendShape", "GeomSubset", "Material", "Mesh", "NodeGraph", "PointInstancer", "Scope",
    "Shader", "SkelAnimation", "SkelRoot", "Skeleton", "Xform",
}  # fmt: skip
"""Types that work through others, or need values to be something."""


@pytest.mark.parametrize("kind", concrete_types())
def test_each_type_is_there_or_told(stage: Any, findings: Findings, kind: str) -> None:
    """A prim of a type becomes a shape or a light, or is counted by type and name."""
    box(stage, "/World/Floor", (-5, -5, -1), (5, 5, 0))
    stage.DefinePrim("/World/Odd", kind)
    scene = saved(stage, findings)
    there = len(scene.objects) + len(scene.lights) == 2
    if kind in EFFECTS:
        assert not there
        assert PRIM_TYPES[kind] is Support.READ
        assert kind not in findings.skipped
        return
    assert there is (PRIM_TYPES.get(kind) is Support.READ)
    assert (findings.skipped_names.get(kind) == ["Odd"]) is not there


def test_schemas_without_an_effect_are_counted(stage: Any, findings: Findings) -> None:
    """API schemas that change nothing are counted, those of other programs, too."""
    prim = box(stage, "/World/Box", (0, 0, 0), (1, 1, 1)).GetPrim()
    names = ["MaterialBindingAPI", "PhysxRigidBodyAPI", "PhysicsDriveAPI:angular", "MeshLightAPI"]
    prim.SetMetadata("apiSchemas", Sdf.TokenListOp.Create(prependedItems=names))
    saved(stage, findings)
    assert findings.skipped == {"PhysxRigidBodyAPI": 1, "PhysicsDriveAPI": 1, "MeshLightAPI": 1}
    assert "MaterialBindingAPI" in API_SCHEMAS
    assert set(UsdReader.support) == {
        "OpenUSD prim types", "OpenUSD API schemas", "OpenUSD purposes", "OpenUSD composition"
    }  # fmt: skip


# ---- moments -------------------------------------------------------------------------------


@pytest.mark.parametrize(("start", "height"), [(None, 1.0), (20, 4.0), (15, 3.0), (99, 4.0)])
def test_the_moment_that_is_shown(
    stage: Any, findings: Findings, start: float | None, height: float
) -> None:
    """What moves stands as where the stage starts, else as at its first sample; it is counted."""
    place = UsdGeom.Xformable(box(stage, "/World/Lift", (0, 0, 0), (1, 1, 1))).AddTranslateOp()
    for time, z in ((5, 1.0), (10, 2.0), (20, 4.0)):
        place.Set(Gf.Vec3d(0, 0, z), time)
    box(stage, "/World/Floor", (-5, -5, -1), (5, 5, 0))
    if start is not None:
        stage.SetStartTimeCode(start)
    lift = saved(stage, findings).objects[0]
    assert lift.pose.position == pytest.approx((0, 0, height))
    assert findings.skipped_names["animation"] == ["Lift"]


def test_samples_have_precedence(stage: Any) -> None:
    """Where a value has samples they count, as in every program that shows a stage."""
    mesh = box(stage, "/World/Box", (0, 0, 0), (1, 1, 1))
    mesh.GetPointsAttr().Set([(2.0 * x, y, z) for x, y, z in mesh.GetPointsAttr().Get()], 3.0)
    np.testing.assert_allclose(extents(saved(stage).objects[0])[1], (2, 1, 1))


def test_order_of_operations(stage: Any) -> None:
    """Operations count in their order, inverted ones too; a stack that is reset begins anew."""
    outer = UsdGeom.Xform.Define(stage, "/World/Outer")
    moved(outer, (100, 0, 0))
    inner = box(stage, "/World/Outer/Box", (0, 0, 0), (1, 1, 1))
    shape = UsdGeom.Xformable(inner)
    shape.SetResetXformStack(True)
    shape.AddTranslateOp().Set(Gf.Vec3d(5, 0, 0))
    pivot = shape.AddTranslateOp(opSuffix="pivot")
    pivot.Set(Gf.Vec3d(0.5, 0.5, 0))
    shape.AddRotateZOp().Set(90.0)
    shape.AddTranslateOp(opSuffix="pivot", isInverseOp=True)
    np.testing.assert_allclose(extents(saved(stage).objects[0]), [[5, 0, 0], [6, 1, 1]], atol=1e-6)


# ---- copies --------------------------------------------------------------------------------


def instancer(stage: Any, count: int) -> Any:
    """Copies of a box in a row, with a prototype that is only an `over`."""
    found = UsdGeom.PointInstancer.Define(stage, "/World/Row")
    stage.OverridePrim("/World/Row/Protos")
    box(stage, "/World/Row/Protos/Box", (0, 0, 0), (1, 1, 1))
    found.CreatePrototypesRel().SetTargets(["/World/Row/Protos/Box"])
    found.CreateProtoIndicesAttr([0] * count)
    found.CreatePositionsAttr([(3.0 * number, 0, 0) for number in range(count)])
    return found


def test_copies_that_are_hidden(stage: Any, findings: Findings) -> None:
    """Copies that are invisible or inactive by their ids are left out and counted."""
    row = instancer(stage, 5)
    row.CreateIdsAttr([10, 11, 12, 13, 14])
    row.InvisId(11, Usd.TimeCode.Default())
    row.DeactivateId(13)
    row.GetProtoIndicesAttr().Set([0, 0, 0, 0, 7])
    objects = saved(stage, findings).objects
    assert [round(extents(thing)[0][0]) for thing in objects] == [0, 6]
    assert findings.skipped == {"invisible": 2}
    assert "Row: copies of what is not there were left out" in told(findings)


@pytest.mark.parametrize("purpose", ["proxy", "render"])
def test_copies_have_the_purpose_of_their_instancer(
    stage: Any, findings: Findings, purpose: str
) -> None:
    """What has no purpose of its own has that of the instancer, wherever the prototype lies."""
    row = instancer(stage, 2)
    row.CreatePurposeAttr(purpose)
    box(stage, "/Elsewhere", (0, 0, 0), (1, 1, 1))
    stage.GetPrimAtPath("/Elsewhere").SetSpecifier(Sdf.SpecifierOver)
    row.GetPrototypesRel().SetTargets(["/Elsewhere"])
    box(stage, "/World/Floor", (-5, -5, -1), (5, 5, 0))
    objects = saved(stage, findings).objects
    assert len(objects) == (1 if purpose == "proxy" else 3)
    assert findings.skipped.get("proxy", 0) == (2 if purpose == "proxy" else 0)


def test_instances_below_a_proxy(tmp_path: Path, findings: Findings) -> None:
    """The purpose of an instance reaches what is in it; what says another one has that."""
    (tmp_path / "thing.usda").write_text(
        '#usda 1.0\n(\n defaultPrim = "T"\n metersPerUnit = 1\n upAxis = "Z"\n)\n'
        'def Xform "T" {\n def Cube "Rough" {}\n'
        ' def Cube "Fine" {\n  uniform token purpose = "render"\n }\n}\n'
    )
    stage = stage_at(tmp_path / "a.usda")
    prim = reference(stage, "/World/One", "thing.usda")
    prim.SetInstanceable(True)
    UsdGeom.Imageable(prim).CreatePurposeAttr("proxy")
    (thing,) = saved(stage, findings).objects
    assert len(thing.parts) == 1
    assert findings.skipped_names == {"proxy": ["Rough"]}


# ---- what is chosen ------------------------------------------------------------------------


def variants(group: str, **types: str) -> str:
    """A variant set of single prims by name and type."""
    each = "".join(
        f'  "{name}" {{\n   def {kind} "{name}" {{\n   }}\n  }}\n' for name, kind in types.items()
    )
    return f' variantSet "{group}" = {{\n{each} }}\n'


def test_what_is_not_chosen_is_counted(tmp_path: Path, findings: Findings) -> None:
    """Variants that are not selected are counted by set and name, levels of detail are not."""
    path = tmp_path / "a.usda"
    path.write_text(
        '#usda 1.0\n(\n metersPerUnit = 1\n)\ndef Xform "Rock" (\n'
        ' variants = { string look = "wet"\n string LOD = "LOD1" }\n'
        ' prepend variantSets = ["look", "LOD"]\n) {\n'
        + variants("look", wet="Cube", dry="Cone")
        + variants("LOD", LOD0="Sphere", LOD1="Cube")
        + "}\n"
    )
    assert {thing.name for thing in read(path, findings).objects} == {"wet", "LOD0"}
    assert findings.skipped_names == {"variant": ["look dry"]}


def test_levels_of_detail(tmp_path: Path, findings: Findings) -> None:
    """Of the children of a prim with LODRootAPI the first is taken; instances have theirs, too."""
    (tmp_path / "rock.usda").write_text(
        '#usda 1.0\n(\n defaultPrim = "Rock"\n metersPerUnit = 1\n upAxis = "Z"\n)\n'
        'def Xform "Rock" {\n def Xform "Stone" (\n variants = { string LOD = "LOD1" }\n'
        ' prepend variantSets = "LOD"\n ) {\n'
        + variants("LOD", LOD0="Sphere", LOD1="Cube")
        + " }\n}\n"
    )
    path = tmp_path / "a.usda"
    path.write_text(
        '#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Z"\n)\n'
        'def Xform "Tree" (\n prepend apiSchemas = ["LODRootAPI"]\n) {\n'
        ' def Sphere "Near" {}\n def Cube "Far" {}\n}\n'
        + "".join(
            f'def Xform "{name}" (\n instanceable = true\n'
            " prepend references = @rock.usda@\n) {\n}\n"
            for name in ("A", "B")
        )
    )
    scene = read(path, findings)
    shapes = [type(part.shape).__name__ for thing in scene.objects for part in thing.parts]
    assert shapes == ["Sphere"] * 3
    assert not findings.skipped


def test_subdivision_is_told(stage: Any, findings: Findings) -> None:
    """Meshes with a scheme are cages, and counted; those that say `none`, or nothing, are not."""
    for name, scheme in (("Smooth", "catmullClark"), ("Hard", "none"), ("Plain", None)):
        mesh = box(stage, f"/World/{name}", (0, 0, 0), (1, 1, 1))
        if scheme:
            mesh.CreateSubdivisionSchemeAttr(scheme)
    saved(stage, findings)
    assert findings.skipped_names == {"subdivision": ["Smooth"]}


def test_lights_of_old_and_new(stage: Any) -> None:
    """Inputs of lights may lack their prefix; a temperature colours a light that is told so."""
    box(stage, "/World/Floor", (-5, -5, -1), (5, 5, 0))
    old = stage.DefinePrim("/World/Old", "DistantLight")
    old.CreateAttribute("color", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0, 1, 0))
    old.CreateAttribute("intensity", Sdf.ValueTypeNames.Float).Set(3.0)
    warm = UsdLux.DistantLight.Define(stage, "/World/Warm")
    warm.CreateEnableColorTemperatureAttr(True)
    warm.CreateColorTemperatureAttr(2000.0)
    lights = {light.name: light for light in saved(stage).lights}
    assert lights["Old"].color == pytest.approx((0, 1, 0))
    assert lights["Old"].brightness == pytest.approx(3.0)
    red, green, blue = lights["Warm"].color
    assert red == pytest.approx(1.0)
    assert 0.3 < green < 0.8
    assert blue < 0.3


def test_colours_of_copies(stage: Any) -> None:
    """Copies have the colours that their instancer gives them, unless they have some already."""
    row = instancer(stage, 3)
    UsdGeom.Cube.Define(stage, "/World/Row/Protos/Cube")
    row.GetPrototypesRel().AddTarget("/World/Row/Protos/Cube")
    row.GetProtoIndicesAttr().Set([0, 1, 0])
    colors = UsdGeom.PrimvarsAPI(row).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, "varying"
    )
    colors.Set([Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 0), Gf.Vec3f(0, 0, 1)])
    one, two, three = (thing.parts[0] for thing in saved(stage).objects)
    names = [one.shape.materials, two.materials, three.shape.materials]
    assert names == [("color_ff0000",), {0: "color_00ff00"}, ("color_0000ff",)]
    UsdGeom.Mesh.Get(stage, "/World/Row/Protos/Box").CreateDisplayColorAttr([Gf.Vec3f(1, 1, 1)])
    one, _, three = (thing.parts[0] for thing in saved(stage).objects)
    assert one.shape is three.shape or one.shape.materials == three.shape.materials


def test_files_that_cannot_be_read(tmp_path: Path, findings: Findings) -> None:
    """References to files of other kinds and to damaged ones are told, in the same words twice."""
    (tmp_path / "x.abc").write_text("hello")
    (tmp_path / "b.usda").write_text('#usda 1.0\ndef Xform "A" {{{\n')
    path = tmp_path / "a.usda"
    path.write_text(
        "#usda 1.0\n(\n subLayers = [@gone.usda@]\n metersPerUnit = 1\n)\n"
        'def Cube "Here" {\n}\ndef "P" (\n references = @x.abc@\n) {\n}\n'
        'def "Q" (\n payload = @b.usda@\n) {\n}\ndef "R" (\n references = </Nowhere>\n) {\n}\n'
    )
    read(path, findings)
    assert findings.missing_list() == [("file", "gone.usda", 1)]
    assert findings.skipped_names == {"file": ["b.usda", "x.abc"]}
    words = told(findings)
    assert "x.abc: a reference to no file of OpenUSD was left out" in words
    assert "b.usda: a reference or payload is damaged" in words
    assert "Unresolved reference prim path" in words
    assert "0x" not in words
    again = Findings()
    read(path, again)
    assert told(again) == words
