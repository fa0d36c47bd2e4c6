"""Materials of a stage for the scene: those of surfaces, display colours, a neutral grey else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Ar, UsdShade

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.mesh_files import Pictures
from usarsim_maps.meshes.vertex_colors import WHITE, shaded
from usarsim_maps.scene import NEUTRAL, Array, Integers, Material, Opacity
from usarsim_maps.units import shown
from usarsim_maps.usd.openusd.primvars import (
    DISPLAY,
    Corners,
    Display,
    color_values,
    colors_at,
    own_color,
)
from usarsim_maps.usd.openusd.stage import read_resource
from usarsim_maps.usd.openusd.surfaces import Clearing, PrimvarUse, look_of, shown_channel
from usarsim_maps.usd.openusd.values import StageValues, in_prototype
from usarsim_server.base.files import is_regular

TILE = "<UDIM>"

UNKNOWN = (
    "none of its surfaces names a colour, nor does what it covers; it became grey. Bake materials "
    "on export"
)


@dataclass(frozen=True, slots=True, eq=False)
class Finish:
    """A material, how it uses texture coordinates, and the primvars that multiply it."""

    material: Material
    coordinates: str = "st"  # name of the primvar that its picture lies on
    mapping: Array = field(default_factory=lambda: np.eye(2, 3))  # (2, 3) applied to them
    tint: PrimvarUse | None = None  # that colours it
    clearness: PrimvarUse | None = None  # that holds its opacity


COLOR, CLEARNESS = map(PrimvarUse, DISPLAY)
"""What colours a shape that no material does."""

PLAIN = Finish(WHITE, tint=COLOR, clearness=CLEARNESS)
"""Of a shape without a material."""


@dataclass(slots=True)
class Finishes:
    """The materials of one stage, each read once."""

    pictures: Pictures  # finds files
    findings: Findings  # told what cannot be shown
    values: StageValues
    materials: dict[str, Material] = field(default_factory=dict)  # those in use, by name
    _known: dict[str, Finish] = field(default_factory=dict)

    def of(self, prim: Any) -> Finish:
        """The finish of a shape or of a part of one: its material, else its display colour."""
        found = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        if not found:
            return PLAIN
        key = str(in_prototype(found.GetPrim()).GetPath())
        if key not in self._known:
            self._known[key] = self._read(found)
        return self._known[key]

    def on_shape(self, prim: Any, finish: Finish, display: Display) -> Material:
        """The material of a shape that has one colour; of several colours it gets the mean."""

        def mean(name: str) -> Array | None:
            found = color_values(prim, name, self.values)
            if found is not None and len(np.unique(found, axis=0)) > 1:
                self.findings.warn(prim.GetName(), "a shape of several colours has their mean")
            if found is None:
                return own_color(display, name)
            return np.asarray(found.mean(axis=0, keepdims=True))

        return self._colored(finish, 1, mean)[0][0]

    def on_triangles(
        self, prim: Any, finish: Finish, corners: Corners, display: Display
    ) -> tuple[list[Material], Integers]:
        """Materials of triangles of a mesh, and the number in this list of each triangle."""

        def read(name: str) -> Array | None:
            found = colors_at(prim, name, corners, self.values)
            return own_color(display, name) if found is None else found

        return self._colored(finish, len(corners.faces), read)

    def _colored(
        self, finish: Finish, count: int, read: Callable[[str], Array | None]
    ) -> tuple[list[Material], Integers]:
        """A finish in the colours of its primvars, which a function reads, (t, 1 or more)."""
        base = finish.material
        tint = _first(finish.tint, read)
        if tint is None and finish.tint is not None:
            tint = read(COLOR.name)
        if tint is None and finish.tint is not None:
            if finish is not PLAIN:
                self.findings.warn(base.name, UNKNOWN)
            base = Material("plain" if finish is PLAIN else base.name, NEUTRAL)
        clearness = _first(finish.clearness, read)
        if tint is None and clearness is None:
            material = Material("") if finish is PLAIN else self._entered(base)
            return [material], np.zeros(count, np.int64)
        colors = np.ones((count, 4))
        if tint is not None:
            # A single channel is a grey.
            colors[:, :3] = shown(np.clip(tint[:, :3], 0.0, 1.0))
        if clearness is not None:
            base = replace(base, meant=True)
            colors[:, 3] = clearness[:, 3 if clearness.shape[1] == 4 else 0]
        made, slots = shaded(colors, base)
        return [self._entered(material) for material in made], slots

    def _entered(self, material: Material) -> Material:
        """Equal materials share a name, different ones do not."""
        if not material.name:
            return material
        for count in range(1, 100_000):
            name = material.name if count == 1 else f"{material.name}-{count}"
            named = replace(material, name=name)
            known = self.materials.setdefault(name, named)
            if known == named:
                return known
        return material

    def _read(self, material: Any) -> Finish:
        name = material.GetPrim().GetName()
        look = look_of(material, self.values)
        if look is None:
            white = Material(name, (1.0, 1.0, 1.0, 1.0))
            return Finish(white, tint=COLOR, clearness=CLEARNESS)
        color = look.color
        red, green, blue = map(shown_channel, color.factor)
        made = Material(name, (red, green, blue, look.opacity))
        if color.asset is not None:
            path, content = self._picture(color.asset)
            made = replace(made, texture=path, image=content, repeat=color.repeat)
        if look.holes is not None:
            made = replace(made, opacity=self._opacity(color.asset, look.holes))
            if color.asset is None:
                there = look.holes.picture
                made = replace(made, repeat=there.repeat)
                color = replace(color, coordinates=there.coordinates, mapping=there.mapping)
        return Finish(made, color.coordinates, color.mapping, color.primvar, look.opacity_primvar)

    def _opacity(self, own: Any, holes: Clearing) -> Opacity:
        """Holes by the surface's own picture, or by another one."""
        there = holes.picture
        picture: Path | bytes | None = None
        if there.bright or own is None or own.path != there.asset.path:
            path, content = self._picture(there.asset)
            picture = content if content is not None else path
        return Opacity(picture, holes.cutoff, holes.blend, there.bright)

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


def _first(use: PrimvarUse | None, read: Callable[[str], Array | None]) -> Array | None:
    """Values of a primvar, else its fallback, (t or 1, 1 or more); None without either."""
    if use is None:
        return None
    found = read(use.name)
    if found is None and use.fallback is not None:
        return np.array([use.fallback])
    return found
