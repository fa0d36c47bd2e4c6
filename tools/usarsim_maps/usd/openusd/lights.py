"""Lights of a stage, in the builder's terms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdLux

from usarsim_maps.meshes.mesh_files import Axes
from usarsim_maps.scene import Light, LightKind
from usarsim_maps.usd.openusd.materials import srgb
from usarsim_maps.usd.openusd.values import NOW, array, number

__all__ = ["LIGHTS", "light_of"]

Array = NDArray[np.float64]

LIGHTS = {
    "SphereLight": LightKind.POINT,
    "CylinderLight": LightKind.POINT,
    "DiskLight": LightKind.SPOT,
    "RectLight": LightKind.SPOT,
    "DistantLight": LightKind.DIRECTIONAL,
    "DomeLight": LightKind.AMBIENT,
    "DomeLight_1": LightKind.AMBIENT,
}

ORDINARY_LAMP = 20.0
"""cd: what counts as brightness 1."""

FADED = 5.0
"""lx at which a lamp has faded."""

NEAREST, FARTHEST = 5.0, 100.0
"""m: limits of a lamp's reach."""


def light_of(prim: Any, matrix: Array, axes: Axes) -> Light:
    """A light; flat ones shine along -z.

    Args:
        prim: of one of the types `LIGHTS`.
        matrix: (4, 4) from its frame into the file's.
        axes: from the file's frame into the simulation's.
    """
    kind = LIGHTS[prim.GetTypeName()]
    light = UsdLux.LightAPI(prim)
    cone = 60.0
    if prim.HasAPI(UsdLux.ShapingAPI):
        angle = number(UsdLux.ShapingAPI(prim).GetShapingConeAngleAttr(), 90.0)
        if angle < 90.0:
            cone, kind = angle, LightKind.SPOT
    strength = number(light.GetIntensityAttr(), 1.0)
    strength *= 2.0 ** min(60.0, max(-60.0, number(light.GetExposureAttr(), 0.0)))
    if kind in (LightKind.POINT, LightKind.SPOT):
        strength *= _area(prim, matrix, axes)
        reach = math.sqrt(max(strength, 0.0) / FADED)
        reach = min(FARTHEST, max(NEAREST, reach))
        strength /= ORDINARY_LAMP
    else:
        reach = 0.0
    color = array(light.GetColorAttr())
    tint = color.tolist() if color is not None and len(color) == 3 else (1.0, 1.0, 1.0)
    red, green, blue = map(srgb, tint)
    x, y, z = (axes.linear @ matrix[:3, 3]).tolist()
    dx, dy, dz = (axes.linear @ -matrix[:3, 2]).tolist()
    return Light(
        name=prim.GetName(),
        kind=kind,
        position=(x, y, z),
        direction=(dx, dy, dz),
        color=(red, green, blue),
        brightness=min(10.0, max(0.0, strength)) if math.isfinite(strength) else 1.0,
        reach=reach,
        cone=cone,
    )


def _area(prim: Any, matrix: Array, axes: Axes) -> float:
    """m^2 that turn the luminance of a surface into the luminous intensity of a lamp."""
    light = UsdLux.LightAPI(prim)
    if light.GetNormalizeAttr().Get(NOW) is True:
        return 1.0
    if prim.GetTypeName() == "SphereLight" and (
        UsdLux.SphereLight(prim).GetTreatAsPointAttr().Get(NOW) is True
    ):
        return 1.0
    unit = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3])))) / axes.units_per_metre
    match prim.GetTypeName():
        case "RectLight":
            rect = UsdLux.RectLight(prim)
            area = number(rect.GetWidthAttr(), 1.0) * number(rect.GetHeightAttr(), 1.0)
        case "CylinderLight":
            tube = UsdLux.CylinderLight(prim)
            area = 2.0 * number(tube.GetRadiusAttr(), 0.5) * number(tube.GetLengthAttr(), 1.0)
        case _:
            radius = number(prim.GetAttribute("inputs:radius"), 0.5)
            area = math.pi * radius * radius
    return max(0.0, area * unit * unit)
