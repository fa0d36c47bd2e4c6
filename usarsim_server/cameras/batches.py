"""What stands together is drawn together: the plain geoms of one body become one mesh.

A call of OpenGL costs some five microseconds whatever it draws, and a box is drawn in one. So geoms
that never move against each other, and differ at most in their colours, are drawn as one: those of
a body, and of the world those of one cell of `CELL` metres. The first geom of a batch stands for
all, as its *leader*: the batch is in its frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.facets import facets
from usarsim_server.cameras.shading import PLAIN
from usarsim_server.simulation.frames import Array, rotation_matrix

CELL = 4.0
"""m: edge of a cell; geoms that are larger are not drawn with what is in one."""
MOST_FACES = 400
"""Triangles of a mesh that is drawn with others; larger ones gain nothing."""
_OPAQUE = 0.995

_TYPES = mujoco.mjtGeom
_ROUND = tuple(
    int(kind)
    for kind in (
        _TYPES.mjGEOM_SPHERE,
        _TYPES.mjGEOM_CAPSULE,
        _TYPES.mjGEOM_ELLIPSOID,
        _TYPES.mjGEOM_CYLINDER,
    )
)


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Geoms that are drawn together.

    Attributes:
        geoms: their numbers, the leader first.
        key: equal for batches that look the same in their own frame, in any model with the same
            meshes.
    """

    geoms: tuple[int, ...]
    key: bytes

    @property
    def leader(self) -> int:
        """The geom in whose frame the batch is."""
        return self.geoms[0]


def batches(model: mujoco.MjModel, groups: NDArray[np.int32]) -> tuple[Batch, ...]:
    """All batches of a model.

    Args:
        model: as it is drawn.
        groups: (ngeom,) groups of the geoms, of which 0 to 2 are drawn.
    """
    found: dict[tuple[object, ...], list[int]] = {}
    plain = _plain(model) & (groups <= 2)
    gloss = np.stack(_gloss(model), axis=1)
    for geom in _endless(model):
        found[geom,] = [geom]
    for geom in np.flatnonzero(plain).tolist():
        body = int(model.geom_bodyid[geom])
        place = () if body else _cell(model, geom)
        found.setdefault((body, place, *gloss[geom].tolist()), []).append(geom)
    colors = rgba(model)
    return tuple(Batch(tuple(geoms), _key(model, geoms, colors)) for geoms in found.values())


def shape(
    model: mujoco.MjModel,
    geoms: Sequence[int],
    colors: NDArray[np.float32],
    slices: int,
    stacks: int,
) -> NDArray[np.float32]:
    """Corners (n, 10) of the triangles of a batch, in the frame of the leader.

    Each has its place, its normal and its colour, which are those of `rgba`.
    """
    found = []
    first = geoms[0]
    home = rotation_matrix(model.geom_quat[first])
    for geom in geoms:
        local = facets(model, geom, slices, stacks)
        turn = home.T @ rotation_matrix(model.geom_quat[geom])
        place = home.T @ (model.geom_pos[geom] - model.geom_pos[first])
        corners = np.empty((len(local), 10), np.float32)
        corners[:, :3] = local[:, 0] @ turn.T + place
        corners[:, 3:6] = local[:, 1] @ turn.T
        corners[:, 6:] = colors[geom]
        found.append(corners)
    return np.concatenate(found)


def rgba(model: mujoco.MjModel) -> NDArray[np.float32]:
    """Colours (ngeom, 4): a geom's own goes before that of its material, as in MuJoCo."""
    colors: NDArray[np.float32] = model.geom_rgba.copy()
    painted = (model.geom_matid >= 0) & (model.geom_rgba == PLAIN).all(axis=1)
    colors[painted] = model.mat_rgba[model.geom_matid[painted]]
    return colors


def roundest(model: mujoco.MjModel, geoms: Sequence[int]) -> float:
    """Largest radius (m) of the round shapes among some geoms; 0 if there is none."""
    chosen = np.array(geoms, np.intp)
    chosen = chosen[np.isin(model.geom_type[chosen], _ROUND)]
    sizes = model.geom_size[chosen]
    sizes[model.geom_type[chosen] != _TYPES.mjGEOM_ELLIPSOID, 1:] = 0.0
    return float(sizes.max(initial=0.0))


def _plain(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms (ngeom,) are opaque, of one colour, and neither glow nor mirror."""
    kinds = (int(_TYPES.mjGEOM_BOX), *_ROUND)
    meshes = model.geom_type == int(_TYPES.mjGEOM_MESH)
    small = np.zeros(model.ngeom, bool)
    of = model.geom_dataid[meshes]
    small[meshes] = model.mesh_facenum[of] <= MOST_FACES
    plain: NDArray[np.bool_] = np.isin(model.geom_type, kinds) | small
    plain &= rgba(model)[:, 3] >= _OPAQUE
    painted = np.flatnonzero(model.geom_matid >= 0)
    material = model.geom_matid[painted]
    odd = (model.mat_texid[material] >= 0).any(axis=1)
    odd |= (model.mat_emission[material] > 0.0) | (model.mat_reflectance[material] > 0.0)
    plain[painted[odd]] = False
    return plain


def _endless(model: mujoco.MjModel) -> list[int]:
    """Planes that go on for ever, if all do: MuJoCo counts planes to know which is which."""
    planes = np.flatnonzero(model.geom_type == _TYPES.mjGEOM_PLANE)
    fit = (model.geom_size[planes, :2] <= 0.0).all(axis=1)
    fit &= (rgba(model)[planes, 3] >= _OPAQUE) & (model.geom_group[planes] <= 2)
    return planes.tolist() if fit.all() else []


def _gloss(model: mujoco.MjModel) -> tuple[Array, Array]:
    """Specular and shininess (ngeom,), 0.5 without a material, as in MuJoCo."""
    painted, found = model.geom_matid >= 0, []
    for values in (model.mat_specular, model.mat_shininess):
        gloss = np.full(model.ngeom, 0.5)
        gloss[painted] = values[model.geom_matid[painted]]
        found.append(gloss)
    return found[0], found[1]


def _cell(model: mujoco.MjModel, geom: int) -> tuple[object, ...]:
    if 2.0 * model.geom_rbound[geom] > CELL:
        return ("large",)
    return tuple(np.floor(model.geom_pos[geom] / CELL).tolist())


def _key(model: mujoco.MjModel, geoms: Sequence[int], colors: NDArray[np.float32]) -> bytes:
    arrays = (model.geom_type, model.geom_size, model.geom_pos, model.geom_quat, colors)
    meshes = np.where(model.geom_type[geoms] == _TYPES.mjGEOM_MESH, model.geom_dataid[geoms], -1)
    return b"".join(array[geoms].tobytes() for array in arrays) + meshes.tobytes()
