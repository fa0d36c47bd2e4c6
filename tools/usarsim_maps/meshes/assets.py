"""Meshes of a file that another one names: everything in it as one mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from usarsim_maps.scene import Mesh, Scene
from usarsim_maps.units import matrix_of_pose

PICTURES = (".png", ".tga", ".dds", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff")
"""Extensions of pictures, in the order of preference."""


def merge_meshes(scene: Scene, name: str) -> Mesh | None:
    """One mesh out of everything visible in a scene, hulls of the artist included.

    Parts that are solid and not visible become hulls. None if there is no mesh at all.
    """
    vertices, triangles, uvs, slots, hulls = [], [], [], [], []
    materials: dict[str, int] = {}
    count, textured = 0, False
    for thing in scene.objects:
        for part in thing.parts:
            mesh = part.shape
            if not isinstance(mesh, Mesh):
                continue
            matrix = matrix_of_pose(thing.pose) @ part.matrix
            linear, offset = matrix[:3, :3], matrix[:3, 3]
            if not part.visible:
                hulls.append(mesh.vertices @ linear.T + offset)
                continue
            hulls += [np.asarray(hull) @ linear.T + offset for hull in mesh.hulls]
            turned = -1 if np.linalg.det(linear) < 0.0 else 1
            vertices.append(mesh.vertices @ linear.T + offset)
            triangles.append(mesh.triangles[:, ::turned] + count)
            count += len(mesh.vertices)
            own = np.zeros((len(mesh.triangles), 3, 2)) if mesh.uvs is None else mesh.uvs
            textured |= mesh.uvs is not None
            uvs.append(own[:, ::turned])
            slots.append(_slots(mesh, part.materials, materials))
    if not vertices:
        return None
    return Mesh(
        name=name,
        vertices=np.concatenate(vertices),
        triangles=np.concatenate(triangles).astype(np.int32),
        uvs=np.concatenate(uvs) if textured else None,
        slots=np.concatenate(slots).astype(np.int32),
        materials=tuple(materials),
        hulls=tuple(hulls),
    )


def _slots(
    mesh: Mesh, other: Mapping[int, str], materials: dict[str, int]
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Slots of a mesh's triangles in a common list of materials."""
    names: Sequence[str] = mesh.materials or ("",)
    own = np.zeros(len(mesh.triangles), np.int64) if mesh.slots is None else mesh.slots
    renamed = [other.get(slot, name) for slot, name in enumerate(names)]
    table = np.array([materials.setdefault(name, len(materials)) for name in renamed])
    answer: np.ndarray[tuple[int], np.dtype[np.int64]] = table[np.clip(own, 0, len(table) - 1)]
    return answer
