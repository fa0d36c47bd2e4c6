"""Bodies that go their own way: placed by a function of simulated time, not moved by forces.

People who wave or walk, avatars, objects that a controller shoves around. In the model they are
mocap bodies: they push what they meet and nothing pushes them back. Their poses are a pure
function of time, so runs repeat whatever the batches in which the physics advances.

MuJoCo takes a mocap body for one that stands still wherever it is. So its contacts are told how
fast it goes, between the two halves of a step: what lies on a moving body is carried along by
friction, and what is pushed is pushed without sinking in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Pose
from usarsim_server.simulation.parts import MOST_AT_REST, Part
from usarsim_server.simulation.rays.culling import bounding_spheres
from usarsim_server.simulation.snapshot import Snapshot

Way = Callable[[float], Pose]
"""Pose in the world at a simulated time (s)."""

LOOK_STEPS = MOST_AT_REST
"""Steps between two looks whether anything is near a body."""
HASTE = 1.0
"""m that two things may come nearer between two such looks: 20 ms at 50 m/s."""
JUMP = 20.0
"""m/s: whatever is faster was put somewhere else and drags nothing along."""
CLOSING = JUMP + 15.0
"""m/s at which something may come nearer to a body: as long as it takes nothing is looked for."""
LONGEST = 0.1
"""Simulated s after which it is looked for anyway: a body may be put elsewhere by its way."""


@dataclass(frozen=True, slots=True)
class Mover:
    """The way of one body."""

    body: str  # name of a mocap body of the scenery
    pose: Way
    """Its pose in the world at a simulated time (s). Called before every physics step, by the
    physics thread and by others: cheap, without side effects, always finite."""


def since(epoch: float, way: Way) -> Way:
    """A way that begins at a simulated time (s), not with the world."""
    return way if epoch == 0.0 else lambda time: way(time - epoch)


class MovingBodies(Part):
    """Everything that moves by itself, with the places of its bodies in one model generation.

    Movers belong to the world, or to one robot or thing in a slot (see `follow`).
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._bodies = mocap_bodies(model)
        self._index = {model.body(body).name: n for n, body in enumerate(self._bodies)}
        """Row in `mocap_pos` of each body that may be moved, by its name."""
        self.movers: tuple[Mover, ...] = ()
        """Those of the world."""
        self._watched = False
        self._followers: dict[int, tuple[Mover, ...]] = {}
        self._epoch = 0.0
        self._step, self._met = 0, False
        self._clear = -math.inf
        """Simulated time up to which a look finds that nothing is near."""
        self._told = False
        """Whether steps have been made since something was put elsewhere, which they find out."""
        self._change()

    def replace(self, movers: Sequence[Mover], watched: bool = False) -> None:
        """Replace the movers of the world; a body that nobody moves any more stays.

        Args:
            movers: the new ones.
            watched: somebody looks at the bodies while steps are made, near or not.

        Raises:
            ValueError: if a body does not exist or is no mocap body; the old ones stay.
        """
        self._check(movers)
        self.movers, self._watched = tuple(movers), watched
        self._change()

    def follow(self, owner: int, movers: Sequence[Mover]) -> None:
        """Replace the movers of one robot or thing; none is fine.

        Raises:
            ValueError: if a body does not exist or is no mocap body; the old ones stay.
        """
        if not (movers or owner in self._followers):
            return
        self._check(movers)
        self._followers.pop(owner, None)
        if movers:
            self._followers[owner] = tuple(movers)
        self._change()

    def inherit(
        self, older: MovingBodies, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Go on with the same movers, whose bodies have other numbers now."""
        self.movers, self._followers = older.movers, older._followers
        self._epoch, self._watched = older._epoch, older._watched
        self._change()

    def restart(self, time: float) -> None:
        """Let the bodies of the world go their ways from the beginning, which is now (s)."""
        self._epoch = time
        self._change()

    def _check(self, movers: Sequence[Mover]) -> None:
        for name in (mover.body for mover in movers):
            if name not in self._index:
                known = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_BODY, name) >= 0
                what = "is no mocap body" if known else "does not exist"
                raise ValueError(f"body {name!r} cannot be moved: it {what}")

    def _change(self) -> None:
        """Have the bodies of all movers looked up when they are placed next: once, however many
        change until then."""
        self._looked_up = False
        self._placed = self._clear = -math.inf

    def _look_up(self) -> None:
        if self._looked_up:
            return
        self._looked_up = True
        model = self._model
        movers = [Mover(one.body, since(self._epoch, one.pose)) for one in self.movers]
        movers += [*(one for own in self._followers.values() for one in own)]
        self._ways = [(self._index[mover.body], mover.pose) for mover in movers]
        bodies = self._bodies[np.array([index for index, _ in self._ways], dtype=np.intp)]
        row_of_body = np.full(model.nbody, -1)
        row_of_body[bodies] = np.arange(len(bodies))
        self._row_of_geom = row_of_body[self._root_of_geom]
        self._measure_reach([index for index, _ in self._ways], bodies)
        self._timestep = float(model.opt.timestep)
        self._ahead: tuple[float, list[Pose]] = (-math.inf, [])
        # The last row, number -1, stands for everything that has no mover.
        self._origin = np.zeros((len(movers) + 1, 3))
        self._twist = np.zeros((len(movers) + 1, 6))

    @cached_property
    def _root_of_geom(self) -> NDArray[np.int32]:
        model = self._model
        roots: NDArray[np.int32] = model.body_rootid[model.geom_bodyid]
        return roots

    @cached_property
    def _spheres(self) -> tuple[NDArray[np.intp], Array, dict[int, int]]:
        return bounding_spheres(self._model)

    def _measure_reach(self, indices: list[int], bodies: NDArray[np.intp]) -> None:
        """How near the roots of all trees may come to each body without touching it."""
        self._mocap = np.array(indices, dtype=np.intp)
        if not indices:
            return
        roots, radii, number = self._spheres
        own = radii[[number.get(int(body), -1) for body in bodies]]
        own[[int(body) not in number for body in bodies]] = 0.0
        loose = self._model.body_mocapid[roots] < 0
        self._roots = roots[loose]
        self._reach = radii[loose][:, None] + own

    def place(self, slot: int, data: mujoco.MjData, pose: Pose) -> None:
        self._clear, self._told = -math.inf, False

    def drop(self, tree: int, data: mujoco.MjData) -> None:
        self._clear, self._told = -math.inf, False

    def state(self, data: mujoco.MjData) -> float:
        return self._clear

    def restore(self, data: mujoco.MjData, state: float) -> None:
        self._clear = state

    def begin(self, data: mujoco.MjData) -> None:
        self._step = 0
        self._look(data)

    def rests(self) -> bool:
        return not self._met

    def _look(self, data: mujoco.MjData) -> None:
        """Place the bodies and see whether anything may come near one of them before the next
        look; unless that is known from the last one."""
        self._look_up()
        time = data.time
        if time < self._clear:
            return
        self.apply(data, time)
        clearance = self._clearance(data)
        self._met = clearance < HASTE
        told, self._told = self._told, True
        if told and not (self._met or self._watched):
            batch = LOOK_STEPS * self._timestep
            self._clear = time + min(clearance / CLOSING, LONGEST) - batch

    def before(self, data: mujoco.MjData) -> None:
        """Place the bodies; while nothing is near one of them, only every few steps."""
        step, self._step = self._step, self._step + 1
        if step and step % LOOK_STEPS == 0:
            self._look(data)
        elif step and self._met:
            self.apply(data, data.time)

    def apply(self, data: mujoco.MjData, time: float) -> None:
        """Put all bodies where they are at a time."""
        self._look_up()
        if not self._ways or time == self._placed:
            return
        self._placed = time
        known, poses = self._ahead
        if known != time:
            poses = [pose_at(time) for _, pose_at in self._ways]
            self._ahead = time, poses
        places, turns = data.mocap_pos, data.mocap_quat
        for (index, _), pose in zip(self._ways, poses, strict=True):
            places[index], turns[index] = pose.position, pose.quaternion

    def _clearance(self, data: mujoco.MjData) -> float:
        """How near anything that moves by forces is to a body, m; at most, so far as is known.

        While it is far enough nothing depends on where the bodies are.
        """
        if not self._ways:
            return math.inf
        away = data.xpos[self._roots][:, None] - data.mocap_pos[self._mocap]
        away *= away
        gaps = np.sqrt(away.sum(axis=2)) - self._reach
        return float(gaps.min(initial=math.inf))

    def between(self, data: mujoco.MjData) -> None:
        """Tell the contacts how fast the bodies go in this step.

        To be called before the contact compensation, which judges by how fast things slide.
        """
        if not (self._met and data.ncon):
            return
        contact = data.contact
        rows = self._row_of_geom[contact.geom]
        known = (rows >= 0).any(axis=1) & (contact.efc_address >= 0)
        chosen = np.flatnonzero(known)
        if not chosen.size:
            return
        self._measure(data.time)
        velocity = self._contact_velocity(contact.pos[chosen], rows[chosen])
        frames = contact.frame[chosen].reshape(-1, 3, 3)
        local = np.einsum("nij,nj->ni", frames, velocity[:, :3])
        spin = np.einsum("nij,nj->ni", frames, velocity[:, 3:])
        start, width = contact.efc_address[chosen], contact.dim[chosen]
        for axis, change in enumerate((*local.T, *spin.T)):
            row = start[width > axis] + axis
            data.efc_aref[row] -= data.efc_KBIP[row, 1] * change[width > axis]

    def _measure(self, time: float) -> None:
        """Twists of this step: from where the bodies are to where they will be."""
        here = self._ahead[1]
        after = time + self._timestep
        there = [pose_at(after) for _, pose_at in self._ways]
        for row, (one, other) in enumerate(zip(here, there, strict=True)):
            self._origin[row] = one.position
            self._twist[row] = _twist(one, other, self._timestep)
        self._ahead = after, there

    def _contact_velocity(self, points: Array, rows: NDArray[np.intp]) -> Array:
        """Velocity (n, 6), world frame, at contacts: of the second body less that of the first."""
        linear, angular = self._twist[rows, :3], self._twist[rows, 3:]
        arms = points[:, None, :] - self._origin[rows]
        each = np.concatenate([linear + np.cross(angular, arms), angular], axis=2)
        answer: Array = each[:, 1] - each[:, 0]
        return answer


def _twist(one: Pose, other: Pose, seconds: float) -> Array:
    """Linear and angular velocity (world frame) of a body that goes from one pose to another."""
    twist = np.zeros(6)
    if one == other:
        return twist
    twist[:3] = (np.array(other.position) - np.array(one.position)) / seconds
    if np.abs(twist[:3]).max() > JUMP:
        return np.zeros(6)
    turn = Pose((0.0, 0.0, 0.0), other.quaternion) @ Pose((0, 0, 0), one.quaternion).inverse()
    mujoco.mju_quat2Vel(twist[3:], np.array(turn.quaternion), seconds)
    return twist


def mocap_bodies(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Body ids of all mocap bodies, in the order of `mocap_pos` and `mocap_quat`."""
    bodies = np.flatnonzero(model.body_mocapid >= 0)
    return bodies[np.argsort(model.body_mocapid[bodies])]


def pose_as(data: mujoco.MjData, snapshot: Snapshot, mocap: NDArray[np.intp]) -> None:
    """Give a copy the coordinates of a snapshot; `mocap` is that of `mocap_bodies`."""
    data.qpos[:] = snapshot.qpos
    data.mocap_pos[:] = snapshot.xpos[mocap]
    data.mocap_quat[:] = snapshot.xquat[mocap]


def carry_over(
    old_model: mujoco.MjModel,
    old: mujoco.MjData,
    new_model: mujoco.MjModel,
    new: mujoco.MjData,
    others: tuple[str, ...] = (),
) -> None:
    """Put the mocap bodies of another model where their namesakes are in the old one.

    `others` are prefixes of bodies that only bear the same names.
    """
    for body in mocap_bodies(old_model):
        name = old_model.body(body).name
        twin = _find(new_model, name)
        if twin < 0 or name.startswith(others):
            continue
        index = old_model.body_mocapid[body]
        new.mocap_pos[twin] = old.mocap_pos[index]
        new.mocap_quat[twin] = old.mocap_quat[index]


def _find(model: mujoco.MjModel, name: str) -> int:
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    return int(model.body_mocapid[body]) if body >= 0 else -1
