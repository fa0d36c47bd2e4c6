"""What the surface shaders of a material say of its looks: colour, picture, primvars, opacity.

Surfaces differ by renderer: UsdPreviewSurface, those of MaterialX (standard_surface, OpenPBR,
gltf_pbr), of MDL, Unreal, Arnold, RenderMan and others. Their inputs are known by their names, and
the networks of shaders that feed them are followed to what they begin with.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pxr import Sdf, UsdShade

from usarsim_maps.scene import Array
from usarsim_maps.units import srgb
from usarsim_maps.usd.openusd.values import StageValues, numbers

MAX_STEPS = 16
"""Shaders between a surface and what feeds it, and shaders that are looked at for it."""

Rgb = tuple[float, float, float]

COLORS = (
    "diffusecolorconstant", "diffusecolor", "basecolor", "basecolorconstant", "basecolorfactor",
    "basecolour", "albedo", "albedocolor", "albedoconstant", "diffusereflectioncolor", "diffuse",
    "kd", "glasscolor", "surfacecolor", "maincolor", "color", "tintcolor", "emissioncolor",
    "emissivecolor",
)  # fmt: skip
"""Inputs of surfaces that hold a colour, in the order in which they count; see `_plain`."""

TEXTURE = re.compile(
    r"(base|diffuse|albedo).*(texture|tex|map|image|file)|(main|color)(texture|tex|map)"
)
"""Inputs that hold the picture of the colour."""

NO_TEXTURE = re.compile(r"normal|bump|rough|metal|orm|mask|opacity|alpha|emissi|influence|weight")
"""Inputs that hold another picture, though their names are alike."""

TINTS = ("diffusetint", "basecolortint", "albedotint", "tint")
"""Inputs that multiply the colour."""

WEIGHTS = (
    "base", "baseweight", "basecolorweight", "diffuseweight", "diffusereflectionweight",
    "diffusegain", "albedobrightness",
)  # fmt: skip
"""Inputs, numbers that multiply the colour."""

OPACITIES = ("opacity", "opacityconstant", "geometryopacity", "alpha", "cutoutopacity", "presence")
TRANSMISSIONS = ("transmission", "transmissionweight", "speculartransmissionweight")
THRESHOLDS = ("opacitythreshold", "geometryopacitythreshold", "alphacutoff")

CLEAREST = 0.2
"""Opacity of what lets all light through."""

READERS = re.compile(r"UsdPrimvarReader_|ND_UsdPrimvarReader|ND_geompropvalue|ND_geomcolor")
"""Shaders that yield a primvar."""


@dataclass(frozen=True, slots=True)
class PrimvarUse:
    """A primvar that colours a surface, or makes it clear."""

    name: str
    fallback: tuple[float, ...] | None = None  # where a shape lacks it; None: the file says none


@dataclass(frozen=True, slots=True, eq=False)
class Fed:
    """What an input gets: a constant, a picture, a primvar, or a product of them."""

    factor: Rgb = (1.0, 1.0, 1.0)  # linear
    asset: Any = None  # Sdf.AssetPath of the picture
    repeat: bool = True
    coordinates: str = "st"  # name of the primvar that the picture lies on
    mapping: Array = field(default_factory=lambda: np.eye(2, 3))  # (2, 3) applied to them
    primvar: PrimvarUse | None = None
    bright: bool = True  # as a number the picture is its brightness, else its opacity

    def times(self, other: Fed) -> Fed:
        """The product; of two pictures the first stays."""
        r, g, b = (one * two for one, two in zip(self.factor, other.factor, strict=True))
        base = self if self.asset is not None or other.asset is None else other
        return replace(base, factor=(r, g, b), primvar=self.primvar or other.primvar)


@dataclass(frozen=True, slots=True)
class Clearing:
    """A picture that says where a surface is clear; see `scene.Opacity`."""

    picture: Fed
    cutoff: float
    blend: bool


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceLook:
    """How a material looks."""

    color: Fed
    opacity: float = 1.0
    opacity_primvar: PrimvarUse | None = None
    holes: Clearing | None = None


def look_of(material: Any, values: StageValues) -> SurfaceLook | None:
    """The looks of a material; None if none of its surfaces names a colour.

    A UsdPreviewSurface has precedence, since all programs draw it alike.
    """
    networks = _Networks(values)
    surfaces = list(_surfaces(material))
    surfaces.sort(key=lambda shader: "UsdPreviewSurface" not in _identity(shader))
    for shader in surfaces:
        found = networks.look(shader)
        if found is not None:
            return found
    return networks.own_look(material)


def shown_channel(value: float) -> float:
    """A linear colour channel as screens show it; what makes no sense is 1."""
    return srgb(unit(value))


def unit(value: float) -> float:
    """The number from 0 to 1 that is nearest; what makes no sense is 1."""
    return min(1.0, max(0.0, value)) if math.isfinite(value) else 1.0


def _surfaces(material: Any) -> Iterator[Any]:
    """Surface shaders of all renderers, the one for all of them first; each once."""
    outputs = [material.GetSurfaceOutput(), *material.GetSurfaceOutputs()]
    seen = set()
    for output in outputs:
        for attribute in UsdShade.Utils.GetValueProducingAttributes(output) if output else ():
            shader = UsdShade.Shader(attribute.GetPrim())
            if shader and shader.GetPath() not in seen:
                seen.add(shader.GetPath())
                yield shader


def _identity(shader: Any) -> str:
    """The name of a shader's kind: identifier, or MDL's name of the material in its module."""
    prim = shader.GetPrim()
    for name in ("info:id", "info:mdl:sourceAsset:subIdentifier"):
        attribute = prim.GetAttribute(name)
        value = attribute.Get() if attribute else None
        if value:
            return str(value)
    return ""


def _plain(name: str) -> str:
    """The name of an input without what differs between renderers: capitals, underscores."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


class _Networks:
    """Follows networks of shaders."""

    def __init__(self, values: StageValues) -> None:
        self._values = values

    # ---- surfaces --------------------------------------------------------------------------

    def look(self, shader: Any) -> SurfaceLook | None:
        """What a surface says, or what it mixes; None if no input names a colour."""
        todo, seen = [shader], {shader.GetPath()}
        for here in todo:
            found = self._single(here)
            if found is not None:
                return found
            for port in here.GetInputs():
                source = _source(port)
                if source is None or source[0].GetPath() in seen or len(seen) >= MAX_STEPS:
                    continue
                seen.add(source[0].GetPath())
                todo.append(source[0])
        return None

    def own_look(self, material: Any) -> SurfaceLook | None:
        """What the inputs of the material itself say: some exporters leave the shader empty."""
        color = self._color({_plain(port.GetBaseName()): port for port in material.GetInputs()})
        return None if color is None else SurfaceLook(color)

    def _single(self, shader: Any) -> SurfaceLook | None:
        inputs = {_plain(port.GetBaseName()): port for port in shader.GetInputs()}
        preview = "UsdPreviewSurface" in _identity(shader)
        color = self._color(inputs)
        if color is None:
            if not preview:
                return None
            color = Fed((0.18, 0.18, 0.18))  # the default of UsdPreviewSurface
        opacity, primvar, holes = self._opacity(_identity(shader), inputs)
        return SurfaceLook(color, opacity, primvar, holes)

    def _color(self, inputs: dict[str, Any]) -> Fed | None:
        """Picture or colour of a surface, with what multiplies them."""
        found = self._texture(inputs) or next(
            (fed for fed in (self.fed(inputs.get(name)) for name in COLORS) if fed is not None),
            None,
        )
        tint = next((fed for fed in (self.fed(inputs.get(n)) for n in TINTS) if fed), None)
        if found is None:
            return tint
        for name in WEIGHTS:
            value = self._constant(inputs.get(name))
            if isinstance(value, (int, float)) and math.isfinite(value):
                found = found.times(Fed((value, value, value)))
        return found if tint is None else found.times(tint)

    def _texture(self, inputs: dict[str, Any]) -> Fed | None:
        """The picture that an input of the surface itself holds."""
        for name, port in inputs.items():
            if NO_TEXTURE.search(name) or not TEXTURE.fullmatch(name):
                continue
            if self._constant(inputs.get(re.sub(r"(texture|tex|map)$", "usetexture", name))) in (
                0, False,
            ):  # fmt: skip
                continue
            found = self.fed(port)
            if found is not None and found.asset is not None:
                return replace(found, mapping=self._stretched(inputs))
        return None

    def _stretched(self, inputs: dict[str, Any]) -> Array:
        """How a surface with a picture of its own uses texture coordinates."""
        mapping = np.eye(2, 3)
        mapping[:, :2] = np.diag(self._vector(inputs.get("texturescale"), (1.0, 1.0)))
        mapping[:, 2] = self._vector(inputs.get("texturetranslate"), (0.0, 0.0))
        return mapping

    def _opacity(
        self, kind: str, inputs: dict[str, Any]
    ) -> tuple[float, PrimvarUse | None, Clearing | None]:
        """Opacity, a primvar that multiplies it, and a picture that makes holes."""
        if self._constant(inputs.get("enableopacity")) in (0, False):
            return 1.0, None, None
        if "gltf_pbr" in kind and self._constant(inputs.get("alphamode")) in (None, 0):
            inputs = {name: port for name, port in inputs.items() if name != "alpha"}
        threshold = self._first_number(inputs, THRESHOLDS, 0.0)
        opacity, primvar = 1.0, None
        pictures = [self._opacity_texture(inputs)]
        for name in OPACITIES:
            found = self.fed(inputs.get(name))
            if found is not None:
                pictures.append(found)
                primvar, opacity = found.primvar, unit(sum(found.factor) / 3.0)
                break
        holes = None
        for found in pictures:
            if found is not None and found.asset is not None:
                cutoff = threshold / max(opacity, 1e-6) if threshold > 0.0 else 0.5
                holes = Clearing(found, cutoff, blend=threshold <= 0.0)
                break
        if threshold > 0.0:
            opacity = 1.0 if holes is not None or opacity >= threshold else 0.0
        passed = unit(self._first_number(inputs, TRANSMISSIONS, 0.0))
        if kind.startswith("OmniGlass"):
            passed = 1.0
        return min(opacity, 1.0 - (1.0 - CLEAREST) * passed), primvar, holes

    def _opacity_texture(self, inputs: dict[str, Any]) -> Fed | None:
        """The picture of opacity that an input of the surface itself holds."""
        if self._constant(inputs.get("enableopacitytexture")) in (0, False):
            return None
        for name, port in inputs.items():
            if re.fullmatch(r"(opacity|alpha|cutout|mask)(texture|tex|map)", name):
                return self.fed(port)
        return None

    def _first_number(self, inputs: dict[str, Any], names: Sequence[str], default: float) -> float:
        """The first of several inputs that is a number."""
        for name in names:
            value = self._constant(inputs.get(name))
            if isinstance(value, float) and math.isfinite(value):
                return value
        return default

    # ---- what feeds an input ---------------------------------------------------------------

    def fed(self, port: Any, depth: int = 0) -> Fed | None:
        """What an input gets; None if nothing says so.

        Args:
            port: the input, or None.
            depth: shaders on the way to here.
        """
        if not port or depth > MAX_STEPS:
            return None
        source = _source(port)
        if source is not None:
            return self._made(*source, depth + 1) or _fed_by(self._values.value(port.GetAttr()))
        value = self._constant(port)
        if isinstance(value, Sdf.AssetPath):
            return Fed(asset=value) if value.path else None
        return _fed_by(value)

    def _made(self, shader: Any, output: str, depth: int) -> Fed | None:
        """What an output of a shader yields."""
        kind = _identity(shader)
        inputs = {_plain(port.GetBaseName()): port for port in shader.GetInputs()}
        if READERS.match(kind):
            return self._primvar(kind, inputs)
        asset = next(
            (value for value in map(self._constant, inputs.values())
             if isinstance(value, Sdf.AssetPath) and value.path), None,
        )  # fmt: skip
        if asset is not None:
            return replace(
                self._pictured(shader, inputs, asset), bright=not _is_alpha(kind, output)
            )
        if "UVTexture" in kind or "image" in kind.lower():
            return _fed_by(self._constant(inputs.get("fallback") or inputs.get("default")))
        if "multiply" in kind.lower():
            one, two = (self.fed(inputs.get(name), depth) for name in ("in1", "in2"))
            return one.times(two) if one and two else one or two
        order = ("in", "in1", "input", "input1", "fg", "color", "value", "texture", "bg", "in2")
        ports = [inputs[name] for name in order if name in inputs]
        others = [port for port in inputs.values() if _source(port) is not None]
        for port in [*ports, *others]:
            found = self.fed(port, depth)
            if found is not None:
                return found
        return None

    def _primvar(self, kind: str, inputs: dict[str, Any]) -> Fed:
        """A primvar by its name, with its fallback."""
        name = self._constant(inputs.get("varname") or inputs.get("geomprop"))
        if not isinstance(name, str) or not name:
            name = "displayColor"
        fallback = self._constant(inputs.get("fallback") or inputs.get("default"))
        fed = None if fallback is None else _fed_by(fallback)
        return Fed(primvar=PrimvarUse(name, None if fed is None else fed.factor))

    def _pictured(self, shader: Any, inputs: dict[str, Any], asset: Any) -> Fed:
        """A picture, with what multiplies it."""
        wrap = str(self._constant(inputs.get("wraps") or inputs.get("uaddressmode")))
        coordinates, mapping = self._coordinates(inputs)
        tiling = self._vector(inputs.get("uvtiling"), (1.0, 1.0))
        mapping = np.diag(tiling) @ mapping
        factor: tuple[float, ...] = (1.0, 1.0, 1.0)
        if "UVTexture" in _identity(shader):
            factor = self._vector(inputs.get("scale"), factor)
        elif "gltf" in _identity(shader):
            factor = self._vector(inputs.get("color") or inputs.get("factor"), factor)
        red, green, blue = factor[:3]
        repeat = wrap not in ("clamp", "black", "constant")
        return Fed((red, green, blue), asset, repeat, coordinates, mapping)

    def _coordinates(self, inputs: dict[str, Any]) -> tuple[str, Array]:
        """Name of the texture coordinates of a picture, and the map (2, 3) applied to them."""
        mapping = np.eye(3)
        for _ in range(MAX_STEPS):
            port = next((inputs[n] for n in ("st", "texcoord", "uv", "in") if n in inputs), None)
            source = _source(port)
            if source is None:
                break
            kind = _identity(source[0])
            inputs = {_plain(port.GetBaseName()): port for port in source[0].GetInputs()}
            if "UsdTransform2d" in kind:
                mapping = mapping @ self._transform(inputs)
            elif "place2d" in kind:
                mapping = mapping @ self._placed(inputs)
            elif READERS.match(kind):
                name = self._constant(inputs.get("varname") or inputs.get("geomprop"))
                return name if isinstance(name, str) and name else "st", mapping[:2]
        return "st", mapping[:2]

    def _transform(self, inputs: dict[str, Any]) -> Array:
        """UsdTransform2d: scale, then rotation anticlockwise in degrees, then translation."""
        answer = np.eye(3)
        stretch = np.diag(self._vector(inputs.get("scale"), (1.0, 1.0)))
        answer[:2, :2] = _turn(self._constant(inputs.get("rotation"))) @ stretch
        answer[:2, 2] = self._vector(inputs.get("translation"), (0.0, 0.0))
        return answer

    def _placed(self, inputs: dict[str, Any]) -> Array:
        """MaterialX's place2d, which moves the picture: the inverse of scale, rotation, offset."""
        scale = self._vector(inputs.get("scale"), (1.0, 1.0))
        pivot = np.array(self._vector(inputs.get("pivot"), (0.0, 0.0)))
        offset = np.array(self._vector(inputs.get("offset"), (0.0, 0.0)))
        if min(map(abs, scale)) < 1e-9:
            return np.eye(3)
        answer = np.eye(3)
        answer[:2, :2] = _turn(self._constant(inputs.get("rotate"))).T @ np.diag(
            1.0 / np.array(scale)
        )
        answer[:2, 2] = pivot - offset - answer[:2, :2] @ pivot
        return answer

    def _constant(self, port: Any) -> Any | None:
        """The value of an input, its own or that of the interface it is connected to."""
        if not port:
            return None
        for attribute in UsdShade.Utils.GetValueProducingAttributes(port):
            if not UsdShade.Output.IsOutput(attribute):
                return self._values.value(attribute)
        return None

    def _vector(self, port: Any, default: Sequence[float]) -> tuple[float, ...]:
        """The value of an input with as many parts as the default has; more are left out."""
        value = numbers(self._constant(port))
        if value is None or len(value) < len(default) or not np.isfinite(value).all():
            return tuple(default)
        return tuple(value[: len(default)].tolist())


def _is_alpha(kind: str, output: str) -> bool:
    """Whether what a picture yields as a number is its opacity.

    MaterialX takes the channel out of a picture of four in another node, which is the last of them
    in most files.
    """
    return output == "a" or "color4" in kind or "vector4" in kind


def _source(port: Any) -> tuple[Any, str] | None:
    """The shader that feeds an input, through node graphs, and the name of its output."""
    for _ in range(MAX_STEPS):
        if not port or not port.HasConnectedSource():
            return None
        owner, name, _ = port.GetConnectedSource()
        shader = UsdShade.Shader(owner.GetPrim())
        if shader:
            return shader, str(name)
        port = owner.GetOutput(name) or owner.GetInput(name)
    return None


def _fed_by(value: Any) -> Fed | None:
    """A constant: a number for all channels, or at least three numbers; else None."""
    if isinstance(value, bool):
        return None
    if isinstance(value, (int, float)):
        return Fed((float(value),) * 3) if math.isfinite(value) else None
    found = numbers(value)
    if found is None or len(found) < 3 or not np.isfinite(found).all():
        return None
    red, green, blue = found[:3].tolist()
    return Fed((red, green, blue))


def _turn(degrees: Any) -> Array:
    """Rotation (2, 2) anticlockwise."""
    angle = math.radians(degrees) if isinstance(degrees, float) and math.isfinite(degrees) else 0.0
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])
