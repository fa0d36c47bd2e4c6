"""Lights of a stage, in the builder's terms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import UsdLux

from usarsim_maps.meshes.mesh_files import Axes
from usarsim_maps.scene import Array, Light, LightKind
from usarsim_maps.usd.openusd.surfaces import shown_channel
from usarsim_maps.usd.openusd.values import StageValues

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


def light_of(prim: Any, matrix: Array, axes: Axes, values: StageValues) -> Light:
    """A light of one of the types `LIGHTS`; flat ones shine along -z.

    The matrix (4, 4) leads from its frame into the file's, the axes from there on.
    """
    kind = LIGHTS[prim.GetTypeName()]

    def number(name: str, default: float) -> float:
        return values.number(_input(prim, name), default)

    cone = 60.0
    angle = number("shaping:cone:angle", 90.0)
    if angle < 90.0:
        cone, kind = angle, LightKind.SPOT
    strength = number("intensity", 1.0) * 2.0 ** min(60.0, max(-60.0, number("exposure", 0.0)))
    if kind in (LightKind.POINT, LightKind.SPOT):
        strength *= _area(prim, matrix, axes, values)
        reach = math.sqrt(max(strength, 0.0) / FADED)
        reach = min(FARTHEST, max(NEAREST, reach))
        strength /= ORDINARY_LAMP
    else:
        reach = 0.0
    red, green, blue = map(shown_channel, _tint(prim, values))
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


def _input(prim: Any, name: str) -> Any:
    """An input of a light; before OpenUSD 21.02 it was called without `inputs:`."""
    old = prim.GetAttribute(name)
    return old if old and old.HasAuthoredValue() else prim.GetAttribute(f"inputs:{name}")


def _tint(prim: Any, values: StageValues) -> tuple[float, float, float]:
    """Colour in linear channels: its own times that of its temperature, if that is switched on."""
    color = values.array(_input(prim, "color"))
    red, green, blue = color.tolist() if color is not None and len(color) == 3 else (1.0, 1.0, 1.0)
    if values.value(_input(prim, "enableColorTemperature")) is not True:
        return red, green, blue
    kelvin = values.number(_input(prim, "colorTemperature"), 6500.0)
    glow = UsdLux.BlackbodyTemperatureAsRgb(min(10000.0, max(1000.0, kelvin)))
    most = max(glow)
    return red * glow[0] / most, green * glow[1] / most, blue * glow[2] / most


def _area(prim: Any, matrix: Array, axes: Axes, values: StageValues) -> float:
    """m^2 that turn the luminance of a surface into the luminous intensity of a lamp."""

    def number(name: str, default: float) -> float:
        return values.number(_input(prim, name), default)

    kind = prim.GetTypeName()
    if values.value(_input(prim, "normalize")) is True:
        return 1.0
    if kind == "SphereLight" and values.value(_input(prim, "treatAsPoint")) is True:
        return 1.0
    unit = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3])))) / axes.units_per_metre
    match kind:
        case "RectLight":
            area = number("width", 1.0) * number("height", 1.0)
        case "CylinderLight":
            area = 2.0 * number("radius", 0.5) * number("length", 1.0)
        case _:
            area = math.pi * number("radius", 0.5) ** 2
    return max(0.0, area * unit * unit)
