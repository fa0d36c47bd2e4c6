"""Static meshes in text form: `Begin StaticMesh` of UE2's batch export (worlds reference 4.4)."""

from __future__ import annotations

import numpy as np

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Mesh
from usarsim_maps.units import unreal_points
from usarsim_maps.unreal.t3d_text import Block, numbers

__all__ = ["mesh_of_block"]


def mesh_of_block(block: Block, name: str, scale: float, findings: Findings) -> Mesh | None:
    """The mesh of a `Begin StaticMesh` block; None if it has no triangles.

    Each triangle names its texture and three `Vertex n x y z u v` lines. Their order is the
    reverse of that of brushes, so the reflection into the simulation frame sets it right.
    """
    corners: list[list[list[float]]] = []
    slots: list[int] = []
    materials: dict[str, int] = {}
    broken = 0
    for triangle in block.inner("triangle"):
        vertices = []
        material = ""
        for _, line in triangle.lines:
            word, _, rest = line.replace("=", " ", 1).partition(" ")
            match word.lower():
                case "vertex":
                    values = numbers(rest)
                    if len(values) >= 4:
                        vertices.append([*values[1:6], 0.0, 0.0][:5])
                case "texture":
                    material = rest.strip()
        if len(vertices) != 3:
            broken += 1
            continue
        corners.append(vertices)
        slots.append(materials.setdefault(material, len(materials)))
    if broken:
        findings.warn(name, f"{broken} triangles without three vertices were left out")
    if not corners:
        return None
    table = np.array(corners)
    points = unreal_points(table[:, :, :3].reshape(-1, 3), scale)
    uvs = table[:, :, 3:5] * np.array([1.0, -1.0]) + np.array([0.0, 1.0])
    return Mesh(
        name=name,
        vertices=points,
        triangles=np.arange(len(points), dtype=np.int32).reshape(-1, 3),
        uvs=uvs,
        slots=np.array(slots, dtype=np.int32),
        materials=tuple(materials),
    )
