"""Laws of motion beside wheels and joints: rotors, propellers, buoyancy, tracks.

A law belongs to one slot and is asked in every step. It may write forces on the bodies of its own
robot (`data.qfrc_applied`), surface velocities of its own geoms and the friction of their contacts,
and nothing else.

Most laws push a chassis on a free joint (`FreeBody`) and stay in the box of the world (`Bounds`).
Both use plain numbers instead of arrays: for three components NumPy is several times slower.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from usarsim_server.simulation.frames import Array, Pose, Vector, axes_of
from usarsim_server.simulation.parts import Part

LawsState = tuple[Array, tuple[Array, ...], frozenset[int]]
"""Commands, what the laws remember, and which slots have laws that hold."""
Motion = tuple[tuple[Vector, Vector, Vector], Vector, Vector]
"""The axes of the body in the world (ahead, to the left, up), the velocity of its origin in the
world (m/s), its turning rate in its own frame (rad/s)."""

_BOUNDS = "usarsim:bounds"
_BOTTOM = 0.5
"""m above the lower edge where machines are held: what falls below that edge is gone."""
_SHARE = 0.25
"""Of the way that is left per time constant: the edge is reached without going beyond it."""


class Law(ABC):
    """What moves one robot. Must be deterministic."""

    def prepare(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        """Before the first half of a step, which finds the contacts."""
        return

    def push(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        """Between the halves: positions and velocities are up to date, forces count now."""
        return

    def feel(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """After the step: its contact forces are known."""
        return

    @abstractmethod
    def release(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """The robot leaves or is put elsewhere: take back what was written, forget the rest."""

    def state(self) -> Array:
        """A copy of what the law remembers, as numbers."""
        return np.zeros(0)

    def restore(self, state: Array) -> None:
        """Go back to a copied state."""
        return


@dataclass(frozen=True, slots=True, eq=False)
class LawModel:
    """A law of a robot class."""

    make: Callable[[mujoco.MjModel, str], Law]
    """Makes the law for a slot from the compiled model and the prefix of all names of that slot
    (`prefix + "base"` is its chassis)."""
    channels: int  # how many numbers it takes as a command; zeros until the first one


class Laws(Part):
    """The laws of all slots of one model generation."""

    def __init__(
        self, model: mujoco.MjModel, slots: Iterable[tuple[str, tuple[LawModel, ...]]]
    ) -> None:
        """Make all laws; `slots` are prefix of names and laws of every slot."""
        self._model = model
        self._laws: dict[int, list[tuple[Law, slice]]] = {}
        self._span: dict[int, slice] = {}
        channels = 0
        for number, (prefix, models) in enumerate(slots):
            begin = channels
            for one in models:
                place = slice(channels, channels + one.channels)
                self._laws.setdefault(number, []).append((one.make(model, prefix), place))
                channels = place.stop
            self._span[number] = slice(begin, channels)
        self.empty = not self._laws
        self._commands = np.zeros(channels)
        self._active: set[int] = set()
        self._running: list[tuple[Law, Array]] = []
        self._feeling: list[Law] = []

    def command(self, slot: int, values: Array) -> None:
        """Set the command of a slot, all laws one after the other.

        Raises:
            ValueError: if the count is wrong.
        """
        span = self._span[slot]
        if values.shape != (span.stop - span.start,):
            raise ValueError(f"command does not fit: {values}")
        self._commands[span] = values

    def drives(self, slot: int) -> bool:
        """Whether the command of a slot asks for anything but zeros."""
        return bool(self._commands[self._span[slot]].any())

    def occupy(self, slot: int) -> None:
        """A robot takes the slot: its laws hold from now on."""
        if slot in self._laws:
            self._active.add(slot)
            self._list()

    def place(self, slot: int, data: mujoco.MjData, pose: Pose) -> None:
        """The robot of a slot was put elsewhere: its laws forget, its command stays."""
        self._forget(slot, data)

    def _forget(self, slot: int, data: mujoco.MjData) -> None:
        for law, _ in self._laws.get(slot, ()):
            law.release(self._model, data)

    def release(self, slot: int, data: mujoco.MjData) -> None:
        """The laws of a slot hold no longer; its command is zero."""
        self._forget(slot, data)
        self._commands[self._span[slot]] = 0.0
        if slot in self._active:
            self._active.remove(slot)
            self._list()

    def _list(self) -> None:
        self._running = [
            (law, self._commands[place])
            for slot in sorted(self._active)
            for law, place in self._laws[slot]
        ]
        self._feeling = [law for law, _ in self._running if type(law).feel is not Law.feel]

    def before(self, data: mujoco.MjData) -> None:
        for law, command in self._running:
            law.prepare(self._model, data, command)

    def between(self, data: mujoco.MjData) -> None:
        if not self._running:
            return
        # A body that diverges is dealt with after the step (see `divergence.py`).
        with np.errstate(all="ignore"):
            for law, command in self._running:
                law.push(self._model, data, command)

    def after(self, data: mujoco.MjData) -> None:
        for law in self._feeling:
            law.feel(self._model, data)

    def rests(self) -> bool:
        return not self._running

    def state(self, data: mujoco.MjData) -> LawsState:
        laws = tuple(law.state() for one in self._laws.values() for law, _ in one)
        return self._commands.copy(), laws, frozenset(self._active)

    def restore(self, data: mujoco.MjData, state: LawsState) -> None:
        commands, laws, active = state
        self._commands[:] = commands
        if active != self._active:
            self._active = set(active)
            self._list()
        every = [law for one in self._laws.values() for law, _ in one]
        for law, kept in zip(every, laws, strict=True):
            law.restore(kept)

    def inherit(
        self, older: Laws, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Take over the robots of an older generation, which sit in the same slots here."""
        for slot in older._active:
            self._commands[self._span[slot]] = older._commands[older._span[slot]]
            pairs = zip(self._laws.get(slot, ()), older._laws.get(slot, ()), strict=True)
            for (law, _), (old, _) in pairs:
                law.restore(old.state())
        self._active = set(older._active)
        self._list()


class FreeBody:
    """One robot's chassis with everything on it.

    Attributes:
        mass: kg.
        inertia: about the axes of the body through its origin, joints at home, kg m^2.
    """

    def __init__(self, model: mujoco.MjModel, base: str) -> None:
        """Find it by the name of the chassis."""
        self._body = body = int(model.body(base).id)
        dof = int(model.body_dofadr[body])
        coordinates = int(model.jnt_qposadr[model.body_jntadr[body]])
        self._dofs = slice(dof, dof + 6)
        self._place = slice(coordinates, coordinates + 3)
        self._quaternion = slice(coordinates + 3, coordinates + 7)
        self.mass = float(model.body_subtreemass[body])
        a, b, c = model.dof_M0[dof + 3 : dof + 6].tolist()
        self.inertia: Vector = (a, b, c)

    def look(self, data: mujoco.MjData) -> Motion:
        """How it stands and moves."""
        ahead, left, up = axes_of(*data.qpos[self._quaternion].tolist())
        vx, vy, vz, p, q, r = data.qvel[self._dofs].tolist()
        return (ahead, left, up), (vx, vy, vz), (p, q, r)

    def place(self, data: mujoco.MjData) -> Vector:
        """Where its origin is, m."""
        x, y, z = data.qpos[self._place].tolist()
        return x, y, z

    def push(self, data: mujoco.MjData, motion: Motion, force: Vector, torque: Vector) -> None:
        """Push it until told otherwise; positions are up to date, `motion` is from `look`.

        The force (N, in the world) acts in the mass centre, the torque (N m) in the body's frame.
        """
        cx, cy, cz = data.subtree_com[self._body].tolist()
        ox, oy, oz = data.xpos[self._body].tolist()
        moment = cross((cx - ox, cy - oy, cz - oz), force)
        a, b, c = motion[0]
        data.qfrc_applied[self._dofs] = (
            *force,
            torque[0] + dot(a, moment),
            torque[1] + dot(b, moment),
            torque[2] + dot(c, moment),
        )

    def release(self, data: mujoco.MjData) -> None:
        """Let go of it."""
        data.qfrc_applied[self._dofs] = 0.0


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def dot(a: Vector, b: Vector) -> float:
    """The scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def add_bounds(spec: mujoco.MjSpec, lower: Vector, upper: Vector) -> None:
    """Write the box of a world, by two corners (m), into its scene."""
    x, y, z = lower
    spec.add_numeric(name=_BOUNDS, data=[x, y, min(z + _BOTTOM, upper[2]), *upper])


class Bounds:
    """The box of the world that a model was compiled from; endless if the model knows none.

    It travels in the model, as numbers of a name of their own, so that laws find it in every
    generation. Near an edge the speed towards it is limited to what a machine can take away on the
    way that is left; one that got outside is brought back.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Look it up."""
        names = [model.numeric(number).name for number in range(model.nnumeric)]
        values = model.numeric(_BOUNDS).data.tolist() if _BOUNDS in names else []
        self._edges = tuple(zip(values[:3], values[3:], strict=True))

    def hold(self, velocity: Vector, place: Vector, response: float, braking: float) -> Vector:
        """The wanted velocity (m/s) at a place (m) as far as it does not lead out of the box.

        The machine changes its velocity with a time constant (s) and can brake by so much (m/s^2).
        """
        if not self._edges:
            return velocity
        rate = _SHARE / response
        x, y, z = (
            max(-_most(at - low, rate, braking), min(_most(high - at, rate, braking), speed))
            for speed, at, (low, high) in zip(velocity, place, self._edges, strict=True)
        )
        return x, y, z


def _most(way: float, rate: float, braking: float) -> float:
    """Most speed (m/s) towards an edge with this way left; negative, that is back, beyond it."""
    return math.copysign(min(rate * abs(way), math.sqrt(braking * abs(way))), way)
