"""Figures of a stage: meshes that a skeleton or blend shapes bend, at the moment shown.

Without an animation that is the rest pose of the skeleton, and blend shapes have no effect.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Tf, UsdSkel

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.figures import morphed, skinned
from usarsim_maps.scene import Array
from usarsim_maps.usd.openusd.values import StageValues, matrix, numbers, upwards

MAX_JOINTS = 10_000
"""Of one skeleton."""


@dataclass(slots=True)
class Figures:
    """The bent meshes of one stage."""

    findings: Findings  # told of skeletons that fit no mesh
    values: StageValues
    transforms: Any  # UsdGeom.XformCache
    _cache: Any = field(default_factory=UsdSkel.Cache)

    def bent(self, prim: Any, points: Array) -> Array:
        """Points (n, 3) of a mesh in its frame, from those that it is modelled with."""
        try:
            points = self._morphed(prim, points)
            skeleton = _skeleton(prim)
            return points if skeleton is None else self._skinned(prim, skeleton, points)
        except (ValueError, IndexError, TypeError, Tf.ErrorException) as error:
            self.findings.warn(prim.GetName(), f"its skeleton does not fit it: {error}"[:200])
            return points

    def _skinned(self, prim: Any, skeleton: Any, points: Array) -> Array:
        """Points of a skin where the joints hold them, whatever the matrix of its own prim."""
        binding = UsdSkel.BindingAPI(prim)
        query = self._cache.GetSkelQuery(UsdSkel.Skeleton(skeleton))
        transforms = query.ComputeSkinningTransforms(self.values.time) if query else None
        if transforms is None or not 0 < len(transforms) <= MAX_JOINTS:
            raise ValueError("it has no joints with a rest pose and a bind pose")
        matrices = np.array([matrix(found) for found in transforms])
        own = self.values.value(binding.GetJointsAttr())
        if own:
            number = {str(name): k for k, name in enumerate(query.GetJointOrder())}
            matrices = matrices[[number.get(str(name), 0) for name in own]]
        primvars = binding.GetJointIndicesPrimvar(), binding.GetJointWeightsPrimvar()
        joints, weights = (numbers(found.ComputeFlattened(self.values.time)) for found in primvars)
        each = max(1, primvars[0].GetElementSize())
        if joints is None or weights is None or len(joints) != len(weights) or len(joints) % each:
            raise ValueError("its joints and weights are not as many")
        joints, weights = joints.reshape(-1, each), weights.reshape(-1, each)
        if len(joints) == 1:  # a stiff part
            joints, weights = (np.repeat(found, len(points), axis=0) for found in (joints, weights))
        if len(joints) != len(points):
            raise ValueError(f"joints of {len(joints)} points for {len(points)}")
        bound = self.values.value(binding.GetGeomBindTransformAttr())
        start = np.eye(4) if bound is None else matrix(bound)
        with np.errstate(invalid="ignore", over="ignore"):
            whole = points @ start[:3, :3].T + start[:3, 3]
        held = skinned(whole, joints.astype(np.int64), weights, matrices)
        of_skeleton, of_skin = (
            matrix(self.transforms.GetLocalToWorldTransform(here)) for here in (skeleton, prim)
        )
        back = np.linalg.inv(of_skin) @ of_skeleton
        return np.asarray(held @ back[:3, :3].T + back[:3, 3])

    def _morphed(self, prim: Any, points: Array) -> Array:
        """Points with the offsets of those blend shapes that the animation gives a weight."""
        binding = UsdSkel.BindingAPI(prim)
        names: Any = self.values.value(binding.GetBlendShapesAttr())
        skeleton = binding.GetInheritedSkeleton() if names else None
        query = self._cache.GetSkelQuery(skeleton) if skeleton else None
        animation: Any = query.GetAnimQuery() if query else None
        weights = animation.ComputeBlendShapeWeights(self.values.time) if animation else None
        if not weights:
            return points
        by_name = dict(zip(map(str, animation.GetBlendShapeOrder()), weights, strict=False))
        shapes = UsdSkel.BlendShapeQuery(binding)
        wanted = [float(by_name.get(str(name), 0.0)) for name in names]
        found = shapes.ComputeSubShapeWeights(wanted)
        changes, shares = [], []
        for share, blend, part in zip(*found, strict=True):
            offsets = numbers(shapes.ComputeSubShapePointOffsets()[part], 3)
            chosen = numbers(shapes.ComputeBlendShapePointIndices()[blend])
            if offsets is None:
                continue
            change = np.zeros_like(points)
            if chosen is not None and len(chosen):
                change[chosen.astype(np.int64)] = offsets
            else:
                change += offsets
            changes.append(change)
            shares.append(float(share))
        return morphed(points, changes, shares)


def _skeleton(prim: Any) -> Any | None:
    """The skeleton that bends a mesh, if it is in a figure and has joints that hold it."""
    if not any(here.GetTypeName() == "SkelRoot" for here in upwards(prim)):
        return None
    binding = UsdSkel.BindingAPI(prim)
    held = binding.GetJointIndicesPrimvar()
    skeleton = binding.GetInheritedSkeleton()
    if not held or not held.HasAuthoredValue() or not skeleton:
        return None
    return skeleton.GetPrim()
