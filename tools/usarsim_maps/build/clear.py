"""Clear things: cameras draw a material as clear as it is, lasers see it as long as it is felt.

Of programs some write 1 for opaque and some 0, so a material that is wholly clear is no statement:
a solid thing with it is drawn opaque. Where a map says of the thing itself that it is clear
(`Material.meant`), it is: cameras do not see it, lasers do.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Collision, Material, Mesh, Part, Scene, SceneObject
from usarsim_server.simulation.rays.scenery import SEEN_GROUPS, is_glass, is_glass_name

FAINTEST = 1.0 / 255.0
"""Opacity of solid things that cameras do not see: what has none does not exist for rays."""


def with_solids_shown(scene: Scene, findings: Findings) -> Scene:
    """The scene with no solid visible thing of no opacity, see above; findings name the materials.

    Things that are not solid keep their materials: what is neither seen nor felt is nothing.
    """
    shown = _Shown(scene.materials, findings)
    scene = replace(
        scene,
        objects=tuple(map(shown.object, scene.objects)),
        heightfields=tuple(
            replace(terrain, material=shown.name(terrain.material))
            for terrain in scene.heightfields
        ),
        brushes=tuple(
            replace(
                brush,
                polygons=tuple(
                    replace(polygon, material=shown.name(polygon.material))
                    if polygon.solid
                    else polygon
                    for polygon in brush.polygons
                ),
            )
            if any(shown.name(polygon.material) != polygon.material for polygon in brush.polygons)
            else brush
            for brush in scene.brushes
        ),
    )
    return replace(scene, materials={**scene.materials, **shown.added})


@dataclass(frozen=True, slots=True)
class SeenThrough:
    """What is not opaque in a world, of what is seen."""

    clear: tuple[tuple[str, float], ...]
    """Names and opacity of materials that cameras see through."""
    passed: tuple[str, ...]
    """What lasers pass, because it is called glass: materials, and things by their own name."""


def seen_through(model: mujoco.MjModel) -> SeenThrough:
    """What cameras and lasers see through in a world."""
    shown = np.flatnonzero((model.geom_group < SEEN_GROUPS) & (model.geom_matid >= 0))
    clear: dict[str, float] = {}
    passed: dict[str, None] = {}
    for geom in shown.tolist():
        material = model.mat(model.geom_matid[geom]).name
        opacity = float(model.mat_rgba[model.geom_matid[geom], 3])
        if is_glass(model, geom):
            passed[material if is_glass_name(material) else model.geom(geom).name] = None
        if 0.0 < opacity < 1.0:
            clear[material] = round(opacity, 6)
    return SeenThrough(tuple(sorted(clear.items())), tuple(sorted(passed)))


@dataclass(slots=True)
class _Shown:
    """Gives solid things other materials where theirs have no opacity."""

    materials: Mapping[str, Material]
    findings: Findings
    added: dict[str, Material] = field(default_factory=dict)
    _names: dict[str, str] = field(default_factory=dict)

    def object(self, thing: SceneObject) -> SceneObject:
        """A thing with other materials if it is solid; the same if nothing changes."""
        if not any(part.collision is not Collision.NONE for part in thing.parts):
            return thing
        parts = tuple(map(self._part, thing.parts))
        changed = any(new is not old for new, old in zip(parts, thing.parts, strict=True))
        return replace(thing, parts=parts) if changed else thing

    def _part(self, part: Part) -> Part:
        if not part.visible:
            return part
        others = {slot: self.name(name) for slot, name in _slots(part) if self.name(name) != name}
        return replace(part, materials={**part.materials, **others}) if others else part

    def name(self, name: str) -> str:
        """The name of the material that a solid thing gets instead of one of this name."""
        if name not in self._names:
            self._names[name] = self._replaced(name)
        return self._names[name]

    def _replaced(self, name: str) -> str:
        material = self.materials.get(name)
        if material is None or material.color[3] >= FAINTEST:
            return name
        opacity = FAINTEST if material.meant else 1.0
        other = f"{name}-{'faint' if material.meant else 'opaque'}"
        while other in self.materials:
            other += "-2"
        self.added[other] = replace(material, name=other, color=(*material.color[:3], opacity))
        if not material.meant:
            self.findings.warn(
                name or "material",
                "it is wholly clear, as of programs that write 1 for opaque; a solid thing with it "
                "is drawn opaque",
            )
        return other


def _slots(part: Part) -> Iterator[tuple[int, str]]:
    """Numbers and materials of the slots of a part."""
    own = part.shape.materials if isinstance(part.shape, Mesh) else ()
    for slot, name in enumerate(own or ("",)):
        yield slot, part.materials.get(slot, name)
