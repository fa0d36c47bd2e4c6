"""Materials, shapes and physics in stages of OpenUSD (worlds 35, 37, 39, 40)."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mesh_samples import faces_out, read
from PIL import Image
from pxr import Gf, Sdf, UsdGeom, UsdPhysics, UsdShade, UsdUtils, Vt
from usd_stages import (
    bind,
    box,
    coordinates,
    extents,
    moved,
    quad,
    saved,
    stage_at,
    surface,
    world,
)

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Box, Capsule, Collision, Cylinder, Mesh, Sphere

pxr = pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")

DOWN = np.array([[0, 0, -1.0]])
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def picture(path: Path) -> None:
    """Red left below, green right below, blue above."""
    image = Image.new("RGB", (2, 2), (0, 0, 255))
    image.putpixel((0, 1), (255, 0, 0))
    image.putpixel((1, 1), (0, 255, 0))
    path.parent.mkdir(exist_ok=True)
    image.save(path)


# ---- materials -----------------------------------------------------------------------------


def test_colors(stage: Any) -> None:
    """Linear colours of preview surfaces and of displays become those of screens."""
    one = box(stage, "/World/One", (0, 0, 0), (1, 1, 1))
    bind(one, surface(stage, "/World/Looks/Dark", color=(0.2140, 0.0, 1.0)))
    two = box(stage, "/World/Two", (0, 0, 0), (1, 1, 2))
    two.CreateDisplayColorAttr([Gf.Vec3f(1, 0, 0)])
    box(stage, "/World/Three", (0, 0, 0), (1, 1, 3))
    scene = saved(stage)
    names = [
        part.shape.materials
        for thing in scene.objects
        for part in thing.parts
        if isinstance(part.shape, Mesh)
    ]
    assert names == [("Dark",), ("color_ff0000",), ("",)]
    assert scene.materials["Dark"].color == pytest.approx((0.5, 0, 1, 1), abs=1e-3)
    assert scene.materials["color_ff0000"].color == pytest.approx((1, 0, 0, 1))


def test_materials_without_a_preview(stage: Any, findings: Findings) -> None:
    """A material that only the engine can draw becomes grey, with a warning (worlds 39)."""
    material = UsdShade.Material.Define(stage, "/World/Looks/M_Engine")
    material.GetPrim().CreateAttribute("unrealMaterial", Sdf.ValueTypeNames.String).Set("/Game/M")
    bind(box(stage, "/World/Box", (0, 0, 0), (1, 1, 1)), material)
    scene = saved(stage, findings)
    red, green, blue, alpha = scene.materials["M_Engine"].color
    assert (red, green, alpha) == pytest.approx((blue, blue, 1.0), abs=0.03)
    assert any(w.subject == "M_Engine" and "grey" in w.text for w in findings.warnings())


def test_materials_with_the_same_name(stage: Any) -> None:
    """Equal materials are one, different ones of the same name are two."""
    for number, color in enumerate([(1, 0, 0), (1, 0, 0), (0, 1, 0)]):
        mesh = box(stage, f"/World/Box{number}", (0, 0, 0), (1, 1, 1 + number))
        bind(mesh, surface(stage, f"/World/Looks{number}/Paint", color=color))
    scene = saved(stage)
    assert sorted(scene.materials) == ["Paint", "Paint-2"]


@pytest.mark.parametrize("how", ["faceVarying", "vertex", "indexed"])
def test_pictures(tmp_path: Path, stage: Any, how: str) -> None:
    """A picture lies the right way up, however its coordinates are stored."""
    picture(tmp_path / "tex" / "mark.png")
    mesh = quad(stage, "/World/Quad", CORNERS)
    bind(mesh, surface(stage, "/World/Mark", picture="tex/mark.png"))
    primvar = coordinates(mesh, SQUARE, "vertex" if how == "vertex" else "faceVarying")
    if how == "indexed":
        primvar.Set([Gf.Vec2f(*value) for value in SQUARE[::-1]])
        primvar.SetIndices([3, 2, 1, 0])
    scene = saved(stage)
    shape = scene.objects[0].parts[0].shape
    places = shape.vertices[shape.triangles]
    np.testing.assert_allclose(shape.uvs, places[..., :2], atol=1e-6)
    assert scene.materials["Mark"].texture == tmp_path / "tex" / "mark.png"
    assert tmp_path / "tex" / "mark.png" in scene.source.files


def test_picture_is_seen(tmp_path: Path, stage: Any) -> None:
    """Cameras see red at the origin's corner and green along x (worlds 40's unpacked half)."""
    picture(tmp_path / "mark.png")
    mesh = quad(stage, "/World/Quad", [(4 * x, 4 * y, z) for x, y, z in CORNERS])
    bind(mesh, surface(stage, "/World/Mark", picture="mark.png"))
    coordinates(mesh, SQUARE)
    built = world(tmp_path, stage)
    finish = built.built.finishes["Mark"]
    stored = Image.open(built.built.folder / "textures" / finish.picture).convert("RGB")
    assert stored.getpixel((0, 1)) == (255, 0, 0)
    model = built.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    (geom,) = np.flatnonzero(
        (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (model.geom_group == 2)
    )
    turn = data.geom_xmat[geom].reshape(3, 3)
    places = model.mesh_vert.reshape(-1, 3)[:4] @ turn.T + data.geom_xpos[geom]
    # MuJoCo counts v downwards.
    expected = places[:, :2] / 4.0 * [1, -1] + [0, 1]
    found = model.mesh_texcoord.reshape(-1, 2)[:4]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_transformed_coordinates(tmp_path: Path, stage: Any) -> None:
    """UsdTransform2d scales, turns and moves texture coordinates; wrap modes are kept."""
    picture(tmp_path / "mark.png")
    mesh = quad(stage, "/World/Quad", CORNERS)
    material = surface(stage, "/World/Mark", picture="mark.png")
    bind(mesh, material)
    coordinates(mesh, SQUARE)
    change = UsdShade.Shader.Define(stage, "/World/Mark/Change")
    change.CreateIdAttr("UsdTransform2d")
    change.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(2, 3))
    change.CreateInput("rotation", Sdf.ValueTypeNames.Float).Set(90.0)
    change.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(0.5, 0))
    reader = UsdShade.Shader.Get(stage, "/World/Mark/Reader")
    change.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(
        reader.ConnectableAPI(), "result"
    )
    texture = UsdShade.Shader.Get(stage, "/World/Mark/Texture")
    texture.GetInput("st").ConnectToSource(change.ConnectableAPI(), "result")
    texture.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("clamp")
    scene = saved(stage)
    shape = scene.objects[0].parts[0].shape
    u, v = np.moveaxis(shape.vertices[shape.triangles][..., :2], -1, 0)
    np.testing.assert_allclose(shape.uvs, np.stack([0.5 - 3 * v, 2 * u], -1), atol=1e-6)
    assert not scene.materials["Mark"].repeat


def test_subsets(stage: Any) -> None:
    """Faces of a subset have its material, the rest that of the mesh."""
    mesh = box(stage, "/World/Box", (0, 0, 0), (1, 1, 1))
    bind(mesh, surface(stage, "/World/Looks/Rest", color=(1, 1, 1)))
    subset = UsdGeom.Subset.CreateGeomSubset(
        mesh, "Top", UsdGeom.Tokens.face, Vt.IntArray([5]), UsdShade.Tokens.materialBind
    )
    bind(subset, surface(stage, "/World/Looks/Top", color=(1, 0, 0)))
    shape = saved(stage).objects[0].parts[0].shape
    assert shape.materials == ("Rest", "Top")
    top = (shape.vertices[shape.triangles][..., 2] == 1.0).all(axis=1)
    assert shape.slots.tolist() == top.astype(int).tolist()
    assert top.sum() == 2


def test_missing_pictures(tmp_path: Path, stage: Any) -> None:
    """A picture that is not there is listed; the mesh is there in its colour (worlds 70)."""
    mesh = quad(stage, "/World/Quad", [(4 * x, 4 * y, z) for x, y, z in CORNERS])
    bind(mesh, surface(stage, "/World/Mark", picture="C:/art/gone.png"))
    built = world(tmp_path, stage)
    assert ("texture", "gone.png", 1) in built.findings.missing_list()


# ---- archives ------------------------------------------------------------------------------


def test_archives(tmp_path: Path) -> None:
    """A USDZ archive loads with the pictures in it (worlds 40)."""
    picture(tmp_path / "mark.png")
    stage = stage_at(tmp_path / "a.usdc")
    mesh = quad(stage, "/World/Quad", CORNERS)
    bind(mesh, surface(stage, "/World/Mark", picture="mark.png"))
    coordinates(mesh, SQUARE)
    stage.GetRootLayer().Save()
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "a.usdc"), str(tmp_path / "b.usdz"))
    (tmp_path / "mark.png").unlink()
    scene = read(tmp_path / "b.usdz")
    content = scene.materials["Mark"].image
    image = Image.open(io.BytesIO(content)).convert("RGB")
    assert image.getpixel((0, 1)) == (255, 0, 0)
    assert scene.source.files == (tmp_path / "b.usdz",)


# ---- physics -------------------------------------------------------------------------------


def test_guides(tmp_path: Path, stage: Any) -> None:
    """Guides are not seen, and are all that is felt of their sibling (worlds 35)."""
    UsdGeom.Xform.Define(stage, "/World/Floor")
    box(stage, "/World/Floor/Box", (-5, -5, -1), (5, 5, 0))
    UsdGeom.Xform.Define(stage, "/World/Table")
    box(stage, "/World/Table/Render", (0, 0, 0), (1, 1, 1))
    guide = box(stage, "/World/Table/Collision", (0, 0, 0), (1, 1, 0.5))
    guide.CreatePurposeAttr("guide")
    UsdPhysics.CollisionAPI.Apply(guide.GetPrim())
    box(stage, "/World/Icon", (3, 3, 0), (4, 4, 1)).CreatePurposeAttr("guide")
    UsdGeom.Xform.Define(stage, "/World/Shelf")
    box(stage, "/World/Shelf/Render", (-2, -2, 0), (-1, -1, 1))
    box(stage, "/World/Shelf/UCX_Render_01", (-2, -2, 0), (-1, -1, 0.25))
    built = world(tmp_path, stage)
    assert [thing.name for thing in built.scene.objects] == ["Floor", "Table", "Shelf"]
    for place, seen, felt in (
        ((0.5, 0.5, 3.0), 2.0, 2.5),
        ((3.5, 3.5, 3.0), 3.0, 3.0),
        ((-1.5, -1.5, 3.0), 2.0, 2.75),
    ):
        assert built.rays(place, DOWN) == pytest.approx([seen], abs=1e-5)
        assert built.solid_rays(place, DOWN) == pytest.approx([felt], abs=1e-5)


def test_collision(tmp_path: Path, stage: Any) -> None:
    """Collision that is switched off is not felt but seen; approximations are obeyed
    (worlds 37)."""
    box(stage, "/World/Floor", (-5, -5, -1), (5, 5, 0))
    ghost = box(stage, "/World/Ghost", (0, 0, 0), (1, 1, 1))
    UsdPhysics.CollisionAPI.Apply(ghost.GetPrim()).CreateCollisionEnabledAttr(False)
    words = {"A": "convexHull", "B": "boundingCube", "C": "boundingSphere", "D": "none"}
    for name, word in words.items():
        UsdGeom.Xform.Define(stage, f"/World/{name}")
        UsdPhysics.CollisionAPI.Apply(stage.GetPrimAtPath(f"/World/{name}"))
        mesh = box(stage, f"/World/{name}/Mesh", (3, 3, 0), (4, 4, 1))
        UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(word)
    built = world(tmp_path, stage)
    assert built.rays((0.5, 0.5, 3.0), DOWN) == pytest.approx([2.0], abs=1e-5)
    assert built.solid_rays((0.5, 0.5, 3.0), DOWN) == pytest.approx([3.0], abs=1e-5)
    modes = {thing.name: thing.parts[0].collision for thing in built.scene.objects}
    told = {"Floor": "auto", "Ghost": "none", "A": "hull", "B": "box", "C": "sphere", "D": "auto"}
    assert modes == {name: Collision(word) for name, word in told.items()}


def test_bodies(stage: Any) -> None:
    """Rigid bodies can be pushed and have their mass; kinematic ones stand (worlds 29)."""
    box(stage, "/World/Floor", (-5, -5, -1), (5, 5, 0))
    for name in ("Crate", "Door"):
        UsdGeom.Xform.Define(stage, f"/World/{name}")
        box(stage, f"/World/{name}/Low", (0, 0, 0), (1, 1, 0.5))
        box(stage, f"/World/{name}/High", (0, 0, 0.5), (1, 1, 1))
        body = UsdPhysics.RigidBodyAPI.Apply(stage.GetPrimAtPath(f"/World/{name}"))
        UsdPhysics.MassAPI.Apply(stage.GetPrimAtPath(f"/World/{name}")).CreateMassAttr(12.0)
    body.CreateKinematicEnabledAttr(True)
    slippery = UsdShade.Material.Define(stage, "/World/Ice")
    UsdPhysics.MaterialAPI.Apply(slippery.GetPrim()).CreateDynamicFrictionAttr(0.1)
    low = stage.GetPrimAtPath("/World/Crate/Low")
    UsdShade.MaterialBindingAPI.Apply(low).Bind(
        slippery, UsdShade.Tokens.weakerThanDescendants, "physics"
    )
    objects = {thing.name: thing for thing in saved(stage).objects}
    crate = objects["Crate"]
    assert (crate.movable, crate.mass, len(crate.parts)) == (True, 12.0, 2)
    assert crate.friction == pytest.approx(0.1)
    assert [objects[name].movable for name in ("Low", "High")] == [False, False]


# ---- shapes --------------------------------------------------------------------------------


def test_shapes(tmp_path: Path) -> None:
    """Cubes, spheres, cylinders and capsules stay what they are, along any axis."""
    stage = stage_at(tmp_path / "a.usda", unit=0.1)
    moved(UsdGeom.Cube.Define(stage, "/World/Cube"), (10, 0, 0), (5, 10, 15))
    UsdGeom.Sphere.Define(stage, "/World/Sphere").CreateRadiusAttr(5.0)
    pipe = UsdGeom.Cylinder.Define(stage, "/World/Pipe")
    pipe.CreateAxisAttr("X")
    pipe.CreateHeightAttr(20.0)
    pipe.CreateRadiusAttr(2.0)
    UsdGeom.Capsule.Define(stage, "/World/Capsule").CreateAxisAttr("Y")
    cube, sphere, pipe_, capsule = saved(stage).objects
    assert isinstance(cube.parts[0].shape, Box)
    assert cube.parts[0].shape.size == pytest.approx((1, 2, 3))
    assert isinstance(sphere.parts[0].shape, Sphere)
    assert sphere.parts[0].shape.radius == pytest.approx(0.5)
    assert isinstance(pipe_.parts[0].shape, Cylinder)
    np.testing.assert_allclose(extents(pipe_)[1], [1, 0.2, 0.2], atol=1e-6)
    assert isinstance(capsule.parts[0].shape, Capsule)
    np.testing.assert_allclose(extents(capsule)[1], [0.05, 0.1, 0.05], atol=1e-6)


def test_shapes_that_are_scaled_unevenly(stage: Any) -> None:
    """An ellipsoid, an oval pipe, a cone and a plane become meshes of the right size."""
    moved(UsdGeom.Sphere.Define(stage, "/World/Egg"), (0, 0, 0), (1, 2, 3))
    moved(UsdGeom.Cylinder.Define(stage, "/World/Oval"), (0, 0, 0), (1, 2, 1))
    UsdGeom.Cone.Define(stage, "/World/Cone")
    UsdGeom.Plane.Define(stage, "/World/Plane").CreateWidthAttr(6.0)
    objects = {thing.name: thing for thing in saved(stage).objects}
    sizes = {"Egg": (2, 4, 6), "Oval": (2, 4, 2), "Cone": (2, 2, 2), "Plane": (6, 2, 0)}
    for name, size in sizes.items():
        low, high = extents(objects[name])
        np.testing.assert_allclose(high - low, size, atol=0.02)
        shape = objects[name].parts[0].shape
        assert faces_out(shape)


def test_polygons(stage: Any, findings: Findings) -> None:
    """Polygons with inward corners are triangulated, holes left out, damage is told."""
    outline = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 1, 0), (0, 2, 0)]
    quad(stage, "/World/Arrow", outline)
    holed = box(stage, "/World/Holed", (0, 0, 0), (1, 1, 1))
    holed.CreateHoleIndicesAttr([0, 3])
    broken = box(stage, "/World/Broken", (0, 0, 0), (1, 1, 1))
    broken.GetFaceVertexIndicesAttr().Set([99] * 24)
    short = box(stage, "/World/Short", (0, 0, 0), (1, 1, 1))
    short.GetFaceVertexCountsAttr().Set([4] * 7)
    UsdGeom.Mesh.Define(stage, "/World/Empty")
    arrow, rest = saved(stage, findings).objects
    mesh = arrow.parts[0].shape
    corners = mesh.vertices[mesh.triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert areas.sum() == pytest.approx(3.0)
    assert (areas >= 0).all()
    assert len(rest.parts[0].shape.triangles) == 8
    told = {w.subject for w in findings.warnings()}
    assert {"Broken", "Short", "Empty"} <= told
