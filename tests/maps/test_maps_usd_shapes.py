"""Shapes in stages of OpenUSD: cubes and their kin, polygons, damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from usd_stages import box, extents, moved, quad, saved, stage_at

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Box, Capsule, Cylinder, Mesh, Sphere

pxr = pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")
from pxr import UsdGeom  # noqa: E402

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


def test_shapes_that_are_scaled_unevenly(tmp_path: Path) -> None:
    """An ellipsoid, an oval pipe, a cone and a plane become meshes of the right size."""
    stage = stage_at(tmp_path / "a.usda")
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
        assert isinstance(shape, Mesh)
        if name == "Plane":
            continue
        corners = shape.vertices[shape.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", normals, corners.mean(axis=1)) > -1e-9).all()


def test_polygons(tmp_path: Path) -> None:
    """Polygons with inward corners are triangulated, holes left out, damage is told."""
    stage = stage_at(tmp_path / "a.usda")
    outline = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 1, 0), (0, 2, 0)]
    quad(stage, "/World/Arrow", outline)
    holed = box(stage, "/World/Holed", (0, 0, 0), (1, 1, 1))
    holed.CreateHoleIndicesAttr([0, 3])
    broken = box(stage, "/World/Broken", (0, 0, 0), (1, 1, 1))
    broken.GetFaceVertexIndicesAttr().Set([99] * 24)
    short = box(stage, "/World/Short", (0, 0, 0), (1, 1, 1))
    short.GetFaceVertexCountsAttr().Set([4] * 7)
    UsdGeom.Mesh.Define(stage, "/World/Empty")
    findings = Findings()
    arrow, rest = saved(stage, findings).objects
    mesh = arrow.parts[0].shape
    assert isinstance(mesh, Mesh)
    corners = mesh.vertices[mesh.triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert areas.sum() == pytest.approx(3.0)
    assert (areas >= 0).all()
    assert isinstance(rest.parts[0].shape, Mesh)
    assert len(rest.parts[0].shape.triangles) == 8
    told = {w.subject for w in findings.warnings()}
    assert {"Broken", "Short", "Empty"} <= told
