"""What ground does to what is on it: patches of water, mud, sand, ice; conveyor belts; slipping.

All of it changes contacts between the two halves of every step, without geometry of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.parts import Part

MARK = 1e-9
"""m/s, rad/s: what a geom must have at compile time whose surface is moved later; no belt."""
EDGE_SLOPE = 0.125
"""Rise per metre of the ground at the edge of a patch that bodies sink into."""
CREEP_SPEED = 0.02
"""m/s below which rolling resistance fades."""
GROUND_SLOPE = 0.7
"""Least upward part of a contact normal that still counts as ground (45 degrees)."""
MIN_FRICTION = 1e-5
"""Smallest friction that MuJoCo's cones can have (mjMINMU)."""
HASTE = 0.3
"""m that a body may go between two calls of `near`: 20 ms at 15 m/s."""
MAX_BRAKING = 0.5
"""Largest part of its speed that resistance may take from a robot in one step. So a robot that
is held fast by more than its grip creeps, at about 2 mu g dt (3 cm/s at 4 ms and mu 0.4)."""
REST_SPEED = 1e-4
"""m/s below which nothing resists, so that what stands can fall asleep (MuJoCo's tolerance)."""
LANDED = 0.002
"""m above the lowered ground from which a body counts as standing on it."""

_INWARD = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
"""Directions into a patch from its edges at low x, low y, high x, high y."""


@dataclass(frozen=True, slots=True)
class Surface:
    """A patch of ground, parallel to the axes. Where patches overlap, the later one counts."""

    name: str  # unique in the world
    kind: str  # water, mud, sand, ice or custom
    x: tuple[float, float]  # limits of the rectangle, m
    y: tuple[float, float]
    z: tuple[float, float]  # heights between which ground belongs to the patch, m
    friction: float  # sliding friction coefficient of everything that touches this ground
    drag: float = 0.0
    """N s/m against each body that touches it, per body: four wheels feel it four times."""
    sinkage: float = 0.0  # how deep bodies sink in away from the edge, m
    painted: bool = True  # draw it as a thin slab on the floor at height 0


class Traction(Part):
    """All patches of a world, for one model generation.

    MuJoCo has one friction per pair of geoms and one level per floor. Patches are laid over that by
    changing the contacts with fixed ground, so they work on an endless plane as on a ramp:

    * Grip: friction of the contact, together with the `mu` that the elliptic cone derives from it,
      is what it would be if both geoms had the patch's coefficient.
    * Sinking in: the reference acceleration of the contact's normal row is that of ground lying
      lower by the local depth. At the edge the depth grows with the slope `EDGE_SLOPE`, and the
      share of the load that such a slope would push downhill is applied, so that coming out costs
      what going in gave.
    * Drag: -drag times velocity, on each body that touches the patch. A body that has sunk in by z
      pushes ground before it: its rolling resistance is the load times sqrt(z/d), d being the
      diameter (the textbook formula for a slow rigid wheel on yielding ground). Below `CREEP_SPEED`
      it fades, so that it never pushes.

    The load of a body is the weight of its robot, divided evenly among those of its bodies that
    touch ground. Nothing is remembered from step to step.
    """

    def __init__(self, model: mujoco.MjModel, surfaces: Sequence[Surface]) -> None:
        limits = np.array([(patch.x, patch.y, patch.z) for patch in surfaces], dtype=float)
        self._low, self._high = limits[:, :, 0].copy(), limits[:, :, 1].copy()
        self._friction = np.array([max(patch.friction, MIN_FRICTION) for patch in surfaces])
        self._drag = np.array([patch.drag for patch in surfaces])
        self._sinkage = np.array([patch.sinkage for patch in surfaces])
        self._low[:, 2] -= self._sinkage
        self._fixed: NDArray[np.bool_] = np.equal(model.body_weldid, 0)
        self._free, places, reach = _free_trees(model)
        self._places = places[:, None] + np.arange(3)
        self._near_low = self._low - reach[:, None, None]
        self._near_high = self._high + reach[:, None, None]
        self._root = model.body_rootid.astype(np.intp)
        self._mass = model.body_subtreemass[self._root]
        self._weight = self._mass * float(np.linalg.norm(model.opt.gravity))
        self._body = model.geom_bodyid.astype(np.intp)
        self._size = np.maximum(2.0 * model.geom_rbound, 1e-3)
        self._timestep = float(model.opt.timestep)
        self._pushed: Numbers = np.zeros(0, dtype=np.intp)

    def begin(self, data: mujoco.MjData) -> None:
        """See whether a body may touch a patch in this batch."""
        centres = data.qpos[self._places][:, None]
        within = (centres > self._near_low) & (centres < self._near_high)
        self._near = bool(within.all(axis=2).any())

    def rests(self) -> bool:
        return not self._near

    def between(self, data: mujoco.MjData) -> None:
        """Change contacts and set forces; before compensation."""
        if self._near:
            self._apply(data)

    # What has diverged is the engine's business, afterwards.
    @np.errstate(over="ignore", invalid="ignore")
    def _apply(self, data: mujoco.MjData) -> None:
        contact = data.contact
        bodies = self._body[contact.geom]
        fixed = self._fixed[bodies]
        movers = np.where(fixed[:, 0], bodies[:, 1], bodies[:, 0])
        ground = fixed.any(axis=1) & self._free[movers] & (contact.efc_address >= 0)
        ground &= np.abs(contact.frame[:, 2]) > GROUND_SLOPE
        patches = self._patches(contact.pos)
        on = np.flatnonzero(ground & (patches >= 0))
        if on.size == 0:
            return
        patches, movers_on = patches[on], movers[on]
        velocity = self._velocities(data, movers_on)
        self._grip(data, on, patches)
        depths, downhill = self._sink(data, on, patches, velocity)
        # One contact stands for all that a body has.
        pushed, first = np.unique(movers_on, return_index=True)
        load = self._load(pushed, np.unique(movers[ground]))
        force = self._resistance(
            data, pushed, on[first], patches[first], depths[first], velocity[first], load
        )
        force[:, :2] += load[:, None] * downhill[first]
        # MuJoCo lets nothing sleep on which a force is set, were it zero.
        real = force.any(axis=1)
        self._pushed = pushed[real]
        data.xfrc_applied[self._pushed, :3] = force[real]

    def after(self, data: mujoco.MjData) -> None:
        """Take the forces away again."""
        if self._pushed.size:
            data.xfrc_applied[self._pushed] = 0.0
            self._pushed = self._pushed[:0]

    def _patches(self, places: Array) -> Numbers:
        """The patch at each place (n, 3), -1 for none."""
        within = (places[:, None] >= self._low) & (places[:, None] <= self._high)
        inside: NDArray[np.bool_] = np.all(within, axis=2)
        last = len(self._low) - 1 - inside[:, ::-1].argmax(axis=1)
        return np.where(inside.any(axis=1), last, -1)

    def _grip(self, data: mujoco.MjData, on: Numbers, patches: Numbers) -> None:
        contact = data.contact
        present = contact.friction[on]
        sliding = present[:, 0]
        # What has no friction, such as a caster, stays so.
        ratio = np.where(sliding > MIN_FRICTION, self._friction[patches] / sliding, 1.0)
        contact.friction[on] = present * ratio[:, None]
        contact.mu[on] *= ratio

    def _sink(
        self, data: mujoco.MjData, on: Numbers, patches: Numbers, velocity: Array
    ) -> tuple[Array, Array]:
        """Lower the ground; returns how deep each contact is in it, and its slope (n, 2)."""
        contact = data.contact
        place, sinkage = contact.pos[on], self._sinkage[patches]
        margins = np.concatenate((place - self._low[patches], self._high[patches] - place), axis=1)
        margins = margins[:, (0, 1, 3, 4)]
        rise = margins.min(axis=1) * EDGE_SLOPE
        depth = np.minimum(sinkage, rise)
        slope = np.where(rise < sinkage, EDGE_SLOPE, 0.0)
        downhill = slope[:, None] * _INWARD[margins.argmin(axis=1)]
        # To a body that moves the ground on a slope is coming or going.
        going = (downhill * velocity[:, :2]).sum(axis=1)
        rows = contact.efc_address[on]
        law = data.efc_KBIP[rows]
        data.efc_aref[rows] -= law[:, 0] * law[:, 2] * depth + law[:, 1] * going
        sunk = np.minimum(np.maximum(-contact.dist[on], 0.0), depth)
        # What is still falling does not press on the slope below it.
        downhill[depth - sunk > LANDED] = 0.0
        return sunk, downhill

    def _load(self, bodies: Numbers, touching: Numbers) -> Array:
        """What rests on each body, N, if all bodies of a tree that touch ground share alike."""
        roots = self._root[bodies]
        shares = (self._root[touching] == roots[:, None]).sum(axis=1)
        load: Array = self._weight[bodies] / shares
        return load

    def _resistance(
        self,
        data: mujoco.MjData,
        bodies: Numbers,
        contacts: Numbers,
        patches: Numbers,
        depths: Array,
        velocity: Array,
        load: Array,
    ) -> Array:
        """Drag and rolling resistance (n, 3) of bodies, each with one of its contacts, N."""
        contact = data.contact
        geoms = contact.geom[contacts]
        own = np.where(self._body[geoms[:, 0]] == bodies, geoms[:, 0], geoms[:, 1])
        yielding = np.minimum(np.sqrt(depths / self._size[own]), 1.0)
        normal = contact.frame[contacts, :3]
        velocity = velocity - (velocity * normal).sum(axis=1)[:, None] * normal
        speed = np.sqrt((velocity * velocity).sum(axis=1))
        resistance = self._drag[patches] + load * yielding / np.maximum(speed, CREEP_SPEED)
        roots = self._root[bodies]
        total = (roots[:, None] == roots) @ resistance
        limit = MAX_BRAKING * self._mass[bodies] / (self._timestep * np.maximum(total, 1e-12))
        resistance *= np.minimum(limit, 1.0)
        resistance[speed < REST_SPEED] = 0.0
        force: Array = -resistance[:, None] * velocity
        return force

    def _velocities(self, data: mujoco.MjData, bodies: Numbers) -> Array:
        """World velocities (n, 3) of the mass centres of bodies, m/s."""
        spatial = data.cvel[bodies]
        arm = data.xipos[bodies] - data.subtree_com[self._root[bodies]]
        # The cross product, without the overhead of numpy's own.
        turn = spatial[:, (1, 2, 0)] * arm[:, (2, 0, 1)] - spatial[:, (2, 0, 1)] * arm[:, (1, 2, 0)]
        moving: Array = spatial[:, 3:] + turn
        return moving


def _free_trees(model: mujoco.MjModel) -> tuple[NDArray[np.bool_], Numbers, Array]:
    """Everything on free joints.

    Returns:
        For every body whether it belongs to such a tree; for every tree its first coordinate; and
        how far from there it may touch something before the next look, m.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    free = np.zeros(model.nbody, dtype=bool)
    places, reach = [], []
    for joint in np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)):
        root = model.jnt_bodyid[joint]
        free |= model.body_rootid == root
        geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == root)
        away = np.linalg.norm(data.geom_xpos[geoms] - data.xpos[root], axis=1)
        places.append(int(model.jnt_qposadr[joint]))
        reach.append(float((away + model.geom_rbound[geoms]).max(initial=0.0)) + HASTE)
    return free, np.array(places, dtype=np.intp), np.array(reach)


class Belts(Part):
    """Conveyor belts, geoms of the scene with a `surfacevel`, and how fast they run.

    A belt answers to its geom's name; several belts that are to obey together are called `<tag>:1`,
    `<tag>:2` and so on.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the belts of a scene; a MuJoCo without moving surfaces has none."""
        self._model = model
        velocity = getattr(model, "geom_surfacevel", np.zeros((0, 6)))
        self._speeds: dict[str, NDArray[np.float64]] = {
            model.geom(geom).name: velocity[geom].copy()
            for geom in np.flatnonzero((np.abs(velocity) > MARK).any(axis=1))
        }
        self._factors: dict[str, float] = {}

    def run(self, tag: str, factor: float) -> int:
        """Run the belts of a tag at so many times their speed in the scene; how many obey."""
        wanted = tag.lower()
        found = [
            name for name in self._speeds if name and name.lower().partition(":")[0] == wanted
        ] or [name for name in self._speeds if name.lower() == wanted]
        for name in found:
            self._run(name, factor)
        return len(found)

    def restart(self) -> None:
        """Run all belts as the scene has them."""
        for name in self._speeds:
            self._run(name, 1.0)

    def _run(self, name: str, factor: float) -> None:
        self._factors[name] = factor
        self._model.geom_surfacevel[self._model.geom(name).id] = factor * self._speeds[name]

    def inherit(
        self, older: Belts, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Let the belts run on as they were told."""
        for name, factor in older._factors.items():
            self._run(name, factor)


class Compensation(Part):
    """Contact compensation: sliding contacts must not push bodies off the ground.

    A slipping contact of MuJoCo's soft friction cone turns tangential motion into normal motion: a
    skid-steered robot that turns hops, and its yaw rate depends on the time step. While a contact
    slips, the solver sees its normal row as if its reference acceleration were higher by the
    friction coefficient times the norm of its tangential residual, the acceleration along the
    surface less the tangential reference. Lowering the normal reference by as much removes that
    coupling (robots reference 4.2). It is for the elliptic cone only, and comes after everything
    else that changes contacts.

    The acceleration of the step is not known yet; that of the last one stands in for it. Without it
    a body that brakes on its own friction would be let down by mu times its deceleration: a block
    on ground of mu 1 would sink in by 3.5 mm and slide 7 % too far at 1 ms. The loop through the
    solver is stable, with a gain of mu^2 / (1 + mu^2). The last acceleration may only lessen the
    correction: after an impact it says nothing about what comes next.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._three = max(model.geom_condim.max(initial=0), model.pair_dim.max(initial=0)) <= 3

    def between(self, data: mujoco.MjData) -> None:
        """See `compensate`."""
        compensate(data, self._three)


def compensate(data: mujoco.MjData, three: bool = False) -> None:
    """Remove the dilatancy of all active contacts of dimension three or more.

    To be called after `mj_step1` and before `mj_step2` of a model with the elliptic cone, whose
    constraint rows of a contact are one normal row followed by the tangential rows; `three`: none
    has more than two of those.
    """
    contact = data.contact
    rows = contact.efc_address
    count = rows.size
    if count == 0:
        return
    reference = data.efc_aref
    acceleration = np.empty(reference.size)
    mujoco.mj_mulJacVec(data.model, data, acceleration, data.qacc_warmstart)
    start = rows[0]
    block = reference[start:]
    if start >= 0 and 3 * count == block.size and (three or contact.dim.max() == 3):
        # All contacts are active and of dimension three: their rows are one block at the end.
        moved = acceleration[start:]
        slip = _slip(block[1::3], block[2::3], moved[1::3], moved[2::3])
        slip *= contact.friction[:, 0]
        normals = block[::3]
        normals -= slip
        return
    frictional = (rows >= 0) & (contact.dim > 2)
    normal = rows[frictional]
    if normal.size == 0:
        return
    one, two = normal + 1, normal + 2
    slip = _slip(reference[one], reference[two], acceleration[one], acceleration[two])
    reference[normal] -= contact.friction[frictional, 0] * slip


def _slip(first: Array, second: Array, moved_first: Array, moved_second: Array) -> Array:
    """Norms of the tangential residuals, none longer than the references themselves."""
    squares = first * first
    squares += second * second
    left, beside = first - moved_first, second - moved_second
    left *= left
    beside *= beside
    left += beside
    np.minimum(squares, left, out=left)
    return np.sqrt(left, out=left)
