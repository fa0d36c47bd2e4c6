"""Small stages, authored with the USD library; without it the tests that import this skip."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built_worlds import World, build_world
from mesh_samples import read

from usarsim_maps.findings import Findings
from usarsim_maps.geometry import points_of
from usarsim_maps.scene import Scene, SceneObject

pytest.importorskip("pxr.Usd", reason="usd-core is not installed: pip install usd-core")

from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

Triple = tuple[float, float, float]

FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def stage_at(path: Path, up: str = "Z", unit: float = 1.0, top: str = "World") -> Any:
    """A new stage with a root prim, which is its default."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, f"/{top}").GetPrim())
    return stage


def box(stage: Any, path: str, low: Triple, high: Triple, kind: Any = UsdGeom.Mesh) -> Any:
    """A mesh of six quads, faces outwards."""
    mesh = kind.Define(stage, path)
    points = [
        tuple((low, high)[bit][axis] for axis, bit in enumerate(bits))
        for bits in ((x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1))
    ]
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr([index for face in FACES for index in face])
    return mesh


def quad(stage: Any, path: str, points: Sequence[Triple]) -> Any:
    """A mesh of one polygon."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(list(points))
    mesh.CreateFaceVertexCountsAttr([len(points)])
    mesh.CreateFaceVertexIndicesAttr(list(range(len(points))))
    return mesh


def moved(prim: Any, place: Triple, scale: Triple | None = None, yaw: float = 0.0) -> Any:
    """Place, turn about z in degrees, scale."""
    shape = UsdGeom.Xformable(prim)
    shape.AddTranslateOp().Set(Gf.Vec3d(*place))
    if yaw:
        shape.AddRotateZOp().Set(yaw)
    if scale is not None:
        shape.AddScaleOp().Set(Gf.Vec3f(*scale))
    return prim


def reference(stage: Any, path: str, file: str, place: Triple = (0.0, 0.0, 0.0)) -> Any:
    """A prim that brings in a file."""
    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
    prim.GetReferences().AddReference(file)
    return moved(prim, place)


def surface(stage: Any, path: str, color: Triple | None = None, picture: str = "") -> Any:
    """A material with a preview surface."""
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    tint = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    if color is not None:
        tint.Set(Gf.Vec3f(*color))
    if picture:
        texture = UsdShade.Shader.Define(stage, f"{path}/Texture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(picture)
        reader = UsdShade.Shader.Define(stage, f"{path}/Reader")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("uvs")
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.ConnectableAPI(), "result"
        )
        tint.ConnectToSource(texture.ConnectableAPI(), "rgb")
    return material


def bind(mesh: Any, material: Any) -> None:
    """Give a shape a material."""
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def coordinates(mesh: Any, values: Sequence[tuple[float, float]], how: str = "faceVarying") -> Any:
    """Texture coordinates called `uvs`."""
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "uvs", Sdf.ValueTypeNames.TexCoord2fArray, how
    )
    primvar.Set([Gf.Vec2f(*value) for value in values])
    return primvar


def saved(stage: Any, findings: Findings | None = None, **options: object) -> Scene:
    """Save a stage and read it."""
    stage.GetRootLayer().Save()
    return read(Path(stage.GetRootLayer().realPath), findings, **options)


def world(folder: Path, stage: Any) -> World:
    """Save a stage, read and build it."""
    findings = Findings()
    return build_world(folder, saved(stage, findings), findings)


def extents(thing: SceneObject) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Lower and upper corner of an object in the world."""
    points = np.concatenate([points_of(part) for part in thing.parts])
    points = points @ thing.pose.matrix().T + np.array(thing.pose.position)
    return np.array([points.min(axis=0), points.max(axis=0)])
