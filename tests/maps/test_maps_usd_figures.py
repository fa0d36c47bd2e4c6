"""Skinned meshes and blend shapes of OpenUSD stand as skeleton and animation hold them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_samples import read, told

from usarsim_maps.findings import Findings
from usarsim_maps.geometry import points_of

pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")

STAGE = """#usda 1.0
(
 defaultPrim = "W"
 metersPerUnit = 1
 upAxis = "Z"
 %(time)s
)
def Xform "W" {
 def SkelRoot "Figure" (prepend apiSchemas = ["SkelBindingAPI"]) {
  double3 xformOp:translate = (10, 0, 0)
  uniform token[] xformOpOrder = ["xformOp:translate"]
  rel skel:skeleton = </W/Figure/Bones>
  %(source)s
  def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI"]) {
   double3 xformOp:translate = (0, 0, 77)
   uniform token[] xformOpOrder = ["xformOp:translate"]
   int[] faceVertexCounts = [4, 4]
   int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4, 5]
   point3f[] points = [(0,0,0), (1,0,0), (1,0,1), (0,0,1), (1,0,2), (0,0,2)]
   uniform token subdivisionScheme = "none"
   int[] primvars:skel:jointIndices = %(joints)s (
    elementSize = 1
    interpolation = "%(how)s"
   )
   float[] primvars:skel:jointWeights = %(weights)s (
    elementSize = 1
    interpolation = "%(how)s"
   )
   matrix4d primvars:skel:geomBindTransform = ((1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1))
   %(mesh)s
  }
  def Skeleton "Bones" {
   uniform token[] joints = ["Low", "Low/High"]
   uniform matrix4d[] bindTransforms = [
    ((1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1)), ((1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,1,1))
   ]
   uniform matrix4d[] restTransforms = [
    ((1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,3,1)), ((1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,2,1))
   ]
  }
  def SkelAnimation "Walk" {
   uniform token[] joints = ["Low/High"]
   float3[] translations = [(0, 0, 5)]
   quatf[] rotations = [(1, 0, 0, 0)]
   half3[] scales = [(1, 1, 1)]
   uniform token[] blendShapes = ["Fat"]
   float[] blendShapeWeights.timeSamples = {
    -5: [0], 0: [0.5], 10: [1]
   }
  }
  def BlendShape "Fat" {
   uniform vector3f[] offsets = [(0, 4, 0)]
   uniform int[] pointIndices = [5]
  }
 }
}
"""

USUAL = {
    "time": "startTimeCode = 0",
    "source": "",
    "joints": "[0, 0, 0, 0, 1, 1]",
    "weights": "[1, 1, 1, 1, 1, 1]",
    "how": "vertex",
    "mesh": "",
}
WALK = "rel skel:animationSource = </W/Figure/Walk>"
FAT = 'uniform token[] skel:blendShapes = ["Fat"]\n   rel skel:blendShapeTargets = </W/Figure/Fat>'


def corners(folder: Path, findings: Findings | None = None, **changes: str) -> np.ndarray:
    """Lower and upper corner of the figure in the world."""
    path = folder / "a.usda"
    path.write_text(STAGE % (USUAL | changes))
    (thing,) = read(path, findings).objects
    points = points_of(thing.parts[0]) @ thing.pose.matrix().T + np.array(thing.pose.position)
    return np.array([points.min(axis=0), points.max(axis=0)])


def test_rest_pose(tmp_path: Path) -> None:
    """Without an animation joints have their rest transforms; the mesh's own place is no matter.

    The lower joint is 3 higher than when it was bound, the upper one 4 higher.
    """
    np.testing.assert_allclose(corners(tmp_path), [[10, 0, 3], [11, 0, 6]], atol=1e-6)


def test_animation_at_its_start(tmp_path: Path) -> None:
    """An animation moves the joints that it names; blend shapes have their weights at the start."""
    found = corners(tmp_path, source=WALK)
    np.testing.assert_allclose(found, [[10, 0, 3], [11, 0, 9]], atol=1e-6)
    found = corners(tmp_path, source=WALK, mesh=FAT)
    np.testing.assert_allclose(found, [[10, 0, 3], [11, 2, 9]], atol=1e-6)
    found = corners(tmp_path, source=WALK, mesh=FAT, time="startTimeCode = 10")
    np.testing.assert_allclose(found, [[10, 0, 3], [11, 4, 9]], atol=1e-6)


def test_stiff_parts_and_orders(tmp_path: Path) -> None:
    """One joint may hold all of a mesh; a mesh may have an order of joints of its own."""
    found = corners(tmp_path, joints="[1]", weights="[1]", how="constant")
    np.testing.assert_allclose(found, [[10, 0, 4], [11, 0, 6]], atol=1e-6)
    order = 'uniform token[] skel:joints = ["Low/High", "Low"]'
    found = corners(tmp_path, joints="[1, 1, 1, 1, 0, 0]", mesh=order)
    np.testing.assert_allclose(found, [[10, 0, 3], [11, 0, 6]], atol=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {"joints": "[0, 0, 0, 0, 1, 9]"},
        {"joints": "[0, 0, 0, 0, 1, -1]"},
        {"joints": "[0, 0]", "weights": "[1, 1]"},
        {"weights": "[1]"},
        {"weights": "[]", "joints": "[]"},
    ],
)
def test_skeletons_that_do_not_fit(tmp_path: Path, changes: dict[str, str]) -> None:
    """A mesh whose joints make no sense stands as it was modelled; the report says so."""
    findings = Findings()
    found = corners(tmp_path, findings, **changes)
    np.testing.assert_allclose(found, [[10, 0, 77], [11, 0, 79]], atol=1e-6)
    assert "Skin: its skeleton does not fit it" in told(findings)
