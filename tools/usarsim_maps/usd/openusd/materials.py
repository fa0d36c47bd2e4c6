"""Materials: preview surfaces with their pictures, display colours, a neutral grey for the rest.

Lights of a stage, in the builder's terms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Ar, Sdf, UsdGeom, UsdLux, UsdShade

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.mesh_files import Axes, Pictures
from usarsim_maps.scene import NEUTRAL, Array, Color, Light, LightKind, Material
from usarsim_maps.units import srgb
from usarsim_maps.usd.openusd.stage import read_resource
from usarsim_maps.usd.openusd.values import NOW, array, number, numbers
from usarsim_server.files import is_regular

MAX_STEPS = 16
"""Shaders between a surface and its picture."""

TILE = "<UDIM>"


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


@dataclass(frozen=True, slots=True, eq=False)
class Finish:
    """A material and how it uses texture coordinates."""

    material: Material  # for the scene
    coordinates: str = "st"  # name of the primvar that its picture lies on
    mapping: Array = field(default_factory=lambda: np.eye(2, 3))  # (2, 3) applied to them


@dataclass(slots=True)
class Finishes:
    """The materials of one stage, each read once."""

    pictures: Pictures  # finds files
    findings: Findings  # told what cannot be shown
    materials: dict[str, Material] = field(default_factory=dict)  # those in use, by name
    _known: dict[str, Finish] = field(default_factory=dict)

    def of(self, prim: Any) -> Finish:
        """The finish of a shape or of a part of one: its material, else its colour."""
        found = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        if found:
            key = str(found.GetPath())
            if key not in self._known:
                self._known[key] = self._enter(self._read(found))
            return self._known[key]
        color = _display_color(prim)
        if color is None:
            return Finish(Material(""))
        red, green, blue = (round(value * 255) for value in color[:3])
        name = f"color_{red:02x}{green:02x}{blue:02x}"
        return self._enter(Finish(Material(name, color)))

    def friction(self, prim: Any) -> float | None:
        """Sliding friction of the physics material of a shape; None if it has none."""
        found = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0]
        if not found:
            return None
        for name in ("physics:dynamicFriction", "physics:staticFriction"):
            attribute = found.GetPrim().GetAttribute(name)
            value = attribute.Get(NOW) if attribute and attribute.HasAuthoredValue() else None
            if isinstance(value, float) and 0.0 <= value < 100.0:
                return value
        return None

    def _enter(self, finish: Finish) -> Finish:
        """Equal materials share a name, different ones do not."""
        base = finish.material.name
        for count in range(1, 100_000):
            name = base if count == 1 else f"{base}-{count}"
            material = replace(finish.material, name=name)
            known = self.materials.setdefault(name, material)
            if known == material:
                return replace(finish, material=material)
        return finish

    def _read(self, material: Any) -> Finish:
        name = material.GetPrim().GetName()
        shader = material.ComputeSurfaceSource("")[0]
        if not shader or shader.GetIdAttr().Get() != "UsdPreviewSurface":
            self.findings.warn(
                name, "a material without a preview surface became grey; bake materials on export"
            )
            return Finish(Material(name, NEUTRAL))
        alpha = _alpha(shader)
        base = shader.GetInput("diffuseColor")
        source = _source(base)
        if source is not None:
            found = self._textured(name, source, alpha)
            if found is not None:
                return found
        red, green, blue = map(_shown, _vector(base, (0.18, 0.18, 0.18)))
        return Finish(Material(name, (red, green, blue, alpha)))

    def _textured(self, name: str, shader: Any, alpha: float) -> Finish | None:
        """A finish with a picture, if a picture is what feeds the colour."""
        if shader.GetIdAttr().Get() != "UsdUVTexture":
            return None
        asset = _constant(shader.GetInput("file"))
        if not isinstance(asset, Sdf.AssetPath) or not asset.path:
            return None
        red, green, blue = map(_shown, _vector(shader.GetInput("scale"), (1.0, 1.0, 1.0)))
        wrap = str(_constant(shader.GetInput("wrapS")))
        coordinates, mapping = _coordinates(shader)
        material = Material(
            name,
            (red, green, blue, alpha),
            *self._picture(asset),
            repeat=wrap not in ("clamp", "black"),
        )
        return Finish(material, coordinates, mapping)

    def _picture(self, asset: Any) -> tuple[Path | None, bytes | None]:
        """File or bytes of a picture."""
        resolved = str(asset.resolvedPath) or str(asset.path)
        if TILE in resolved:
            self.findings.warn(asset.path, "of a tiled picture only the first tile is used")
            resolved = resolved.replace(TILE, "1001")
        if Ar.IsPackageRelativePath(resolved):
            content = read_resource(resolved)
            if content is None:
                self.findings.missing("texture", asset.path)
            return None, content
        path = Path(resolved)
        if is_regular(path) and self.pictures.context.admit(path, self.pictures.source):
            self.pictures.files.append(path)
            return path, None
        return self.pictures.find(str(asset.path)), None


def _source(port: Any) -> Any | None:
    """The shader that feeds an input, through node graphs."""
    for _ in range(MAX_STEPS):
        if not port or not port.HasConnectedSource():
            return None
        owner, name, _ = port.GetConnectedSource()
        shader = UsdShade.Shader(owner.GetPrim())
        if shader:
            return shader
        port = owner.GetOutput(name) or owner.GetInput(name)
    return None


def _constant(port: Any) -> Any | None:
    """The value of an input, its own or that of the interface it is connected to."""
    if not port:
        return None
    for attribute in UsdShade.Utils.GetValueProducingAttributes(port):
        if not UsdShade.Output.IsOutput(attribute):
            return attribute.Get(NOW)
    return None


def _coordinates(texture: Any) -> tuple[str, Array]:
    """Name of the texture coordinates of a picture, and the map applied to them."""
    mapping = np.eye(3)
    shader = _source(texture.GetInput("st"))
    for _ in range(MAX_STEPS):
        if shader is None:
            break
        kind = str(shader.GetIdAttr().Get())
        if kind == "UsdTransform2d":
            mapping = mapping @ _transform(shader)
            shader = _source(shader.GetInput("in"))
            continue
        if kind.startswith("UsdPrimvarReader"):
            name = _constant(shader.GetInput("varname"))
            return name if isinstance(name, str) and name else "st", mapping[:2]
        break
    return "st", mapping[:2]


def _transform(shader: Any) -> Array:
    """Scale, then rotation anticlockwise in degrees, then translation."""
    value = _constant(shader.GetInput("rotation"))
    angle = math.radians(value) if isinstance(value, float) and math.isfinite(value) else 0.0
    c, s = math.cos(angle), math.sin(angle)
    answer = np.eye(3)
    stretch = _vector(shader.GetInput("scale"), (1.0, 1.0))
    answer[:2, :2] = np.array([[c, -s], [s, c]]) @ np.diag(stretch)
    answer[:2, 2] = _vector(shader.GetInput("translation"), (0.0, 0.0))
    return answer


def _alpha(shader: Any) -> float:
    opacity = shader.GetInput("opacity")
    if _source(opacity) is not None:
        return 1.0
    value = _constant(opacity)
    return _unit(float(value)) if isinstance(value, float) else 1.0


def _display_color(prim: Any) -> Color | None:
    """The first display colour of a shape, if there is one."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
    values = array(primvar.GetAttr(), 3) if primvar and primvar.HasAuthoredValue() else None
    if values is None or not len(values) or not np.isfinite(values[0]).all():
        return None
    red, green, blue = (_shown(float(value)) for value in values[0])
    return red, green, blue, 1.0


def _vector(port: Any, default: tuple[float, ...]) -> tuple[float, ...]:
    """The value of an input with as many parts as the default has; more are left out."""
    value = numbers(_constant(port))
    if value is None or len(value) < len(default) or not np.isfinite(value).all():
        return default
    return tuple(value[: len(default)].tolist())


def _unit(value: float) -> float:
    return min(1.0, max(0.0, value)) if math.isfinite(value) else 1.0


def _shown(value: float) -> float:
    """Colours in a stage are linear; screens are not."""
    return srgb(_unit(value))


def light_of(prim: Any, matrix: Array, axes: Axes) -> Light:
    """A light of one of the types `LIGHTS`; flat ones shine along -z.

    The matrix (4, 4) leads from its frame into the file's, the axes from there on.
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
    red, green, blue = map(_shown, tint)
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
