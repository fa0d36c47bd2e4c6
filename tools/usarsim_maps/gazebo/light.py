"""Lights of SDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.gazebo.frames import flag
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.scene import Light, LightKind

Array = NDArray[np.float64]

DOWN = np.array([0.0, 0.0, -1.0])

BRIGHTEST = 0.6
"""Directional light that a surface gets at most: the server's own light adds to it."""


def sun() -> Light:
    """The light of `model://sun`, which is not on disk: high, from the side."""
    return Light("sun", LightKind.DIRECTIONAL, (0.0, 0.0, 10.0), (-0.5, 0.1, -0.9))


def light_of(document: Document, node: Node, matrix: Array, unit: float) -> Light:
    """A light. Suns cast no shadows: over a large map the grain of the shadows would show.

    Args:
        document: the file.
        node: `light` element.
        matrix: (4, 4) of its pose in the world.
        unit: metres per unit of the file.
    """
    kinds = {"directional": LightKind.DIRECTIONAL, "spot": LightKind.SPOT}
    kind = kinds.get(node.get("type"), LightKind.POINT)
    diffuse = _numbers(document, node.child("diffuse"), np.ones(3), 3, 4)[:3]
    strength = float(diffuse.max())
    color = diffuse / strength if strength > 0.0 else np.ones(3)
    r, g, b = np.clip(color, 0.0, 1.0).tolist()
    direction = _numbers(document, node.child("direction"), DOWN, 3)
    if not np.linalg.norm(direction) > 1e-9:
        direction = DOWN
    dx, dy, dz = (matrix[:3, :3] @ direction).tolist()
    x, y, z = matrix[:3, 3].tolist()
    reach = document.number(node.child("attenuation", "range")) or 0.0
    cone = document.number(node.child("spot", "outer_angle"))
    intensity = document.number(node.child("intensity"))
    return Light(
        name=node.get("name") or "light",
        kind=kind,
        position=(x, y, z),
        direction=(dx, dy, dz),
        color=(r, g, b),
        brightness=min(10.0, max(0.0, strength * (1.0 if intensity is None else intensity))),
        reach=max(0.0, reach) * unit if kind is not LightKind.DIRECTIONAL else 0.0,
        cone=min(90.0, max(1.0, float(np.degrees(cone or np.pi / 2.0)) / 2.0)),
        shadows=kind is LightKind.SPOT and flag(node.word("cast_shadows"), False),
    )


def dimmed(lights: Sequence[Light]) -> list[Light]:
    """Lights with the directional ones made weaker together, where they add up to plain white.

    Worlds have many suns, one from each side or several from above; screens know no more than
    white, and MuJoCo does not adapt to brightness.
    """
    suns = [light for light in lights if light.kind is LightKind.DIRECTIONAL]
    if not suns:
        return list(lights)
    ways = np.array([light.direction for light in suns])
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1), 1e-12)[:, None]
    strength = np.array([light.brightness for light in suns])
    sides = np.concatenate([np.eye(3), -np.eye(3)])
    most = float((np.maximum(ways @ sides.T, 0.0) * strength[:, None]).sum(axis=0).max())
    factor = min(1.0, BRIGHTEST / most) if most > 0.0 else 1.0
    return [
        replace(light, brightness=light.brightness * factor)
        if light.kind is LightKind.DIRECTIONAL
        else light
        for light in lights
    ]


def _numbers(document: Document, node: Node | None, default: Array, *counts: int) -> Array:
    values = document.vector(node, *counts)
    return default if values is None else values
