"""What rays hit: names, poses, materials and sizes of the things in the world.

A ray knows a geom. What a user calls an object is the geom itself if it is a piece of the fixed
scenery, otherwise the body it belongs to: a crate, a victim, the leaf of a door, a whole robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import IDENTITY, Array, Pose, Vector, pose_of
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.snapshot import Snapshot

Names = NDArray[np.object_]

WORLD = 0
"""Body id of the world itself; it is nobody's name."""

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


@dataclass(frozen=True, slots=True)
class ObjectFacts:
    """One object at one instant."""

    name: str  # of the object; for a robot the name of its slot, such as `robot3`
    pose: Pose
    """In the world. The frame is that of the body, or of the geom as the scene places it."""
    material: str | None
    """Name of the material of the geom that was asked about, None if it has none."""
    size: Vector
    """Extents (m) along the axes of `pose`, joints at zero; infinite for endless planes."""
    robot: int | None = None  # the robot's number in the simulation, None for everything else


class Objects:
    """The objects of one model generation; may be used by any thread."""

    def __init__(self, world: CompiledWorld) -> None:
        self._model = world.model
        self._owner = {body: lay.base for lay in world.layouts for body in lay.bodies}
        """Base of the slot that a body belongs to."""
        self._sizes: dict[tuple[int, int | None], Vector] = {}

    @cached_property
    def names(self) -> Names:
        """Name of every geom as rays report it, by geom id; one more None at the end, id -1."""
        return geom_names(self._model)

    def facts(self, name: str | int, snapshot: Snapshot) -> ObjectFacts | None:
        """Facts about the object that a ray's name, or a body's name, belongs to.

        Args:
            name: as in `RayHits.names`; or the number of a robot or thing in the simulation.
            snapshot: the instant; of this generation.

        Returns:
            None if there is no such thing, or if it is a robot that is not in the world.
        """
        if isinstance(name, int):
            layout = snapshot.layouts.get(name)
            if layout is None:
                return None
            name = str(self._model.body(layout.base).name)
        geom = self._geoms.get(name)
        if geom is None:
            return None
        body, single = self._object(geom)
        robot = None
        if body in self._owner:
            robot = next((r for r, lay in snapshot.layouts.items() if lay.base == body), None)
            if robot is None:
                return None
        place = IDENTITY if single is None else _geom_pose(self._model, single)
        material = int(self._model.geom_matid[geom])
        return ObjectFacts(
            name=self._name(body, single),
            pose=pose_of(snapshot.xpos[body], snapshot.xquat[body]) @ place,
            material=self._material(body, material),
            size=self._size(body, single),
            robot=robot,
        )

    @cached_property
    def _geoms(self) -> dict[str, int]:
        """A geom by every name that leads to it; names of geoms have precedence."""
        model = self._model
        found = {}
        for geom in reversed(range(model.ngeom)):
            body = int(model.geom_bodyid[geom])
            if body != WORLD:
                found[model.body(body).name] = geom
        found |= {model.geom(geom).name: geom for geom in range(model.ngeom)}
        found.pop("", None)
        return found

    def _object(self, geom: int) -> tuple[int, int | None]:
        """The body whose frame counts, and the geom if it is an object of its own."""
        model = self._model
        body = int(model.geom_bodyid[geom])
        if body in self._owner:
            return self._owner[body], None
        rigid = int(model.body_weldid[body])
        for candidate in (rigid, body):
            if candidate != WORLD and model.body(candidate).name:
                return candidate, None
        return body, geom

    def _name(self, body: int, single: int | None) -> str:
        if single is not None:
            return str(self.names[single])
        name: str = self._model.body(body).name
        return name.partition(":")[0] if body in self._owner else name

    def _material(self, body: int, material: int) -> str | None:
        """Name of a material as the scene, or the maker of the robot or thing, gave it."""
        if material < 0:
            return None
        name: str = self._model.mat(material).name
        return name.partition(":")[2] if body in self._owner else name

    def _size(self, body: int, single: int | None) -> Vector:
        key = (body, single)
        if key not in self._sizes:
            self._sizes[key] = self._measure(body, single)
        return self._sizes[key]

    def _measure(self, body: int, single: int | None) -> Vector:
        model, data = self._model, self._at_rest
        if single is None:
            geoms = [geom for geom in range(model.ngeom) if self._object(geom) == (body, None)]
            origin, axes = data.xpos[body], data.xmat[body].reshape(3, 3)
        else:
            if model.geom_type[single] == mujoco.mjtGeom.mjGEOM_PLANE:
                return _plane_size(model, single)
            geoms, pose = [single], _geom_pose(model, single)
            turn = data.xmat[body].reshape(3, 3)
            origin, axes = data.xpos[body] + turn @ np.array(pose.position), turn @ pose.matrix()
        corners = np.concatenate([_corners(model, data, geom, origin, axes) for geom in geoms])
        x, y, z = np.ptp(corners, axis=0).tolist()
        return x, y, z

    @cached_property
    def _at_rest(self) -> mujoco.MjData:
        data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, data)
        return data


def geom_names(model: mujoco.MjModel) -> Names:
    """Names by geom id: the geom's own, else its body's, else None; one more None for id -1."""
    names = np.full(model.ngeom + 1, None, dtype=object)
    owners = [str(model.body(body).name) for body in range(model.nbody)]
    owners[WORLD] = ""
    text: bytes = model.names
    bodies = model.geom_bodyid.tolist()
    for geom, begin in enumerate(model.name_geomadr.tolist()):
        own = text[begin : text.index(b"\0", begin)].decode()
        names[geom] = own or owners[bodies[geom]] or None
    return names


def _geom_pose(model: mujoco.MjModel, geom: int) -> Pose:
    """Pose of a geom in its body as the scene gives it.

    The compiler moves the frame of a mesh to its mass centre and principal axes; that is undone.
    """
    pose = pose_of(model.geom_pos[geom], model.geom_quat[geom])
    mesh = int(model.geom_dataid[geom])
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH or mesh < 0:
        return pose
    return pose @ pose_of(model.mesh_pos[mesh], model.mesh_quat[mesh]).inverse()


def _plane_size(model: mujoco.MjModel, geom: int) -> Vector:
    x, y, _ = (2.0 * model.geom_size[geom]).tolist()
    return x or math.inf, y or math.inf, 0.0


def _corners(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, origin: Array, axes: Array
) -> Array:
    """Corners (8, 3) of a geom's bounding box in a frame given by its origin and its axes."""
    box = model.geom_aabb[geom]
    turn = axes.T @ data.geom_xmat[geom].reshape(3, 3)
    middle = (data.geom_xpos[geom] - origin) @ axes
    answer: Array = (box[:3] + _CORNERS * box[3:]) @ turn.T + middle
    return answer
