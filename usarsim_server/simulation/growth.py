"""Larger and smaller models: compiled aside, while the physics goes on with the present one.

MuJoCo ends the process if it gets no memory while it compiles a model or makes a state of it. So
whoever makes a larger model asks first whether there is room, and gives back what the process does
not need.
"""

from __future__ import annotations

import ctypes
import math
import resource
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.ground import Belts, Compensation, Traction
from usarsim_server.simulation.hands import Hands
from usarsim_server.simulation.joint_servos import JointServos
from usarsim_server.simulation.machines import Machines
from usarsim_server.simulation.model import (
    VACANT,
    Blueprint,
    CompiledWorld,
    PhysicsOptions,
    RobotModel,
    matching_joints,
    slot_prefix,
)
from usarsim_server.simulation.motion_laws import Laws
from usarsim_server.simulation.movers import MovingBodies
from usarsim_server.simulation.native import native_steps
from usarsim_server.simulation.parts import MOST_AT_REST, Part, Parts
from usarsim_server.simulation.servos import WheelServos
from usarsim_server.simulation.sleep import Sleep
from usarsim_server.simulation.splice import FixedPart

MIB = 2**20
KEPT_SIZE = 16 * MIB
"""Bytes of a model whose specification is kept for the next one."""


class WorldParts(Parts):
    """The parts of one model generation, by name for those who command them."""

    def __init__(self, world: CompiledWorld, options: PhysicsOptions) -> None:
        model = world.model
        self.wheels = WheelServos(world)
        self.joints = JointServos(world)
        self.laws = Laws(model, [(slot_prefix(n), one.laws) for n, one in enumerate(world.slots)])
        self.machines = Machines(world)
        self.moving = MovingBodies(model)
        self.belts = Belts(model)
        self.hands = Hands(world)
        self.sleep = Sleep(world)
        # Machines decide before bodies go; contacts are changed by the ground, compensated last.
        contacts: list[Part] = [Traction(model, options.surfaces)] if options.surfaces else []
        if options.compensation:
            contacts.append(Compensation(model))
        first = (self.wheels, self.joints, self.laws, self.machines, self.moving, self.belts)
        super().__init__(*first, *contacts, self.hands, self.sleep)
        self.native = native_steps(self.wheels, self.joints, options.timestep, options.compensation)
        """Makes whole batches of steps while all others rest; None: nobody does."""
        self._others = self.stepping(but=(WheelServos, Compensation))

    def rest(self, steps: int) -> bool:
        """Whether only wheels and compensation work in a batch of so many steps that has begun."""
        return steps <= MOST_AT_REST and all(one.rests() for one in self._others)


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """Another model, ready to replace the running one."""

    world: CompiledWorld  # the model and a state of it
    data: mujoco.MjData
    spare: mujoco.MjData  # another state, for what comes at the swap
    parts: WorldParts  # what works on it
    joints: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Old and new coordinate indices of everything that exists in both."""
    dofs: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Old and new velocity indices of everything that exists in both."""
    blueprint: Blueprint  # what the model was compiled of
    kept: tuple[int, ...]  # slots that are the same in both
    changed: tuple[int, ...]  # slots of the old model that are of another kind, or are gone

    def trees(self, old: mujoco.MjModel) -> NDArray[np.intp]:
        """The kinematic tree here of every tree of the old model, -1 for those that are gone."""
        twins = np.full(old.ntree, -1, dtype=np.intp)
        twins[old.dof_treeid[self.dofs[0]]] = self.world.model.dof_treeid[self.dofs[1]]
        return twins


class Generations:
    """Makes the models of one world, one after the other."""

    def __init__(
        self,
        scenery: Callable[[], mujoco.MjSpec],
        options: PhysicsOptions,
        fixed: FixedPart | None = None,
    ) -> None:
        """Make none yet.

        Args:
            scenery: makes a fresh specification of the world without robots.
            options: of the physics.
            fixed: geoms of the world that are not in this specification.
        """
        self._fixed = fixed
        self._scenery = scenery
        self._options = options
        self._blueprint: Blueprint | None = None
        """What the running model was compiled of, until a larger one is made of it; None of a large
        world, whose specification takes twice the memory of its model."""

    def first(self, slots: Sequence[RobotModel]) -> CompiledWorld:
        """The model that the world begins with.

        Raises:
            ValueError: if MuJoCo cannot compile it.
        """
        blueprint = Blueprint(self._scenery(), self._options)
        blueprint.add(slots)
        world = blueprint.compile(generation=0, fixed=self._fixed)
        self._keep(blueprint, world)
        return world

    def following(self, old: CompiledWorld, slots: Sequence[RobotModel]) -> Growth:
        """Compile a model with other slots than those of the running one, `old`.

        Touches nothing that lives: safe in any thread, but only one at a time may add slots and
        replace none.

        Raises:
            ValueError: if MuJoCo cannot compile the result.
        """
        slots = list(slots)
        while slots and slots[-1] is VACANT:
            slots.pop()
        blueprint = None
        if old.shared(slots) == len(old.slots):
            blueprint, self._blueprint = self._blueprint, None
        if blueprint is None:
            blueprint = Blueprint(self._scenery(), self._options)
        blueprint.add(slots[len(blueprint.slots) :])
        world = blueprint.compile(old.generation + 1, old, self._fixed)
        same = [one is other for one, other in zip(old.slots, slots, strict=False)]
        kept = tuple(n for n, equal in enumerate(same) if equal and slots[n] is not VACANT)
        changed = tuple(n for n in range(len(old.slots)) if not (n < len(same) and same[n]))
        if len(kept) == sum(slot is not VACANT for slot in slots):
            # Nobody came: let the solver work by the same rules as before, to the last bit.
            world.model.stat.meaninertia = old.model.stat.meaninertia
            kind = mujoco.mjtJacobian
            sparse = mujoco.mj_isSparse(old.model)
            world.model.opt.jacobian = int(kind.mjJAC_SPARSE if sparse else kind.mjJAC_DENSE)
        data = mujoco.MjData(world.model)
        mujoco.mj_forward(world.model, data)
        joints, dofs = matching_joints(old.model, world.model, changed)
        parts = WorldParts(world, self._options)
        spare = mujoco.MjData(world.model)
        return Growth(world, data, spare, parts, joints, dofs, blueprint, kept, changed)

    def adopted(self, growth: Growth) -> None:
        """This is the running model now."""
        self._keep(growth.blueprint, growth.world)

    def _keep(self, blueprint: Blueprint, world: CompiledWorld) -> None:
        small = mujoco.mj_sizeModel(world.model) - world.fixed <= KEPT_SIZE
        self._blueprint = blueprint if small else None


_STATM = Path("/proc/self/statm")
_GROUPS = Path("/proc/self/cgroup")
_GROUP_ROOT = Path("/sys/fs/cgroup")

MODEL_PER_DOF = 2500.0
ARENA = (15.0 * MIB, 53_000.0, 42.0)
"""Bytes of a model per degree of freedom n, and of the working memory of a state, in which there is
room for constraints between them: a + b n + c n^2. Fitted to robots of all kinds, n up to 2400,
MuJoCo 3.17."""
HEAPS = 2
LARGE = 1 << 20
"""Bytes from which on a block is a mapping of its own, given back as soon as it is free."""
_ARENA_MAX, _MMAP_THRESHOLD = -8, -3
"""M_ARENA_MAX and M_MMAP_THRESHOLD of malloc.h."""
STATES = 4
"""Copies of model and state in use: the physics, two that judge places, the cameras."""
COMPILING = 6
"""Sizes of a model that are needed beside it while it is compiled; none of what was before."""
RESERVE = 96 << 20
"""Bytes that must be left: shapes for rays, and what every connection and thread takes."""


def shortage(world: CompiledWorld, dofs: int) -> str | None:
    """What is missing for a model with so many degrees of freedom more than the present one.

    All copies of it and of its state are counted. Tells how much memory is needed, how much there
    is, and why no more; None if there is enough.
    """
    model = world.model
    size = int(mujoco.mj_sizeModel(model)) - world.fixed + MODEL_PER_DOF * dofs
    size = RESERVE + STATES * world.fixed + (STATES + COMPILING) * size
    # Few pages of the arenas are ever used, but all of them count as address space.
    least, linear, square = ARENA
    most = int(model.nv) + dofs
    arena = STATES * (least + linear * most + square * most * most)
    limits = (
        ("ulimit -v", size + arena, _room(resource.RLIMIT_AS, 0)),
        ("ulimit -d", size + arena, _room(resource.RLIMIT_DATA, 5)),
        ("the control group", size, _group_room()),
    )
    for name, needed, room in limits:
        if needed > room:
            return f"{needed / MIB:.0f} MiB needed, {max(0.0, room) / MIB:.0f} MiB left by {name}"
    return None


def share_heaps() -> None:
    """Let all threads take memory from few heaps, and large blocks from none; at the start.

    By default the C library (glibc) has up to eight heaps per processor, one thread after the
    other. A heap shrinks from its end only, and every robot that comes has a thread of its own for
    a moment: so what many of them leave behind keeps many heaps large.
    """
    set_option = getattr(_library, "mallopt", None)
    if set_option is not None:
        set_option(_ARENA_MAX, HEAPS)
        set_option(_MMAP_THRESHOLD, LARGE)


def trim() -> None:
    """Let the C library give the pages back that nothing is in; other ones do so by themselves."""
    release = getattr(_library, "malloc_trim", None)
    if release is not None:
        release(0)


def _room(limit: int, column: int) -> float:
    """Bytes left below a limit of the process, by a column of /proc/self/statm."""
    most = resource.getrlimit(limit)[0]
    if most == resource.RLIM_INFINITY:
        return math.inf
    try:
        used = int(_STATM.read_text(encoding="ascii").split()[column])
    except (OSError, ValueError, IndexError):
        return math.inf
    return float(most - used * resource.getpagesize())


def _group_room() -> float:
    """Room in the control groups (version 2) that the process is in, the narrowest of them."""
    try:
        own = _GROUPS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return math.inf
    path = next((line[3:] for line in own if line.startswith("0::/")), None)
    if path is None:
        return math.inf
    place = _GROUP_ROOT / path.lstrip("/")
    return _narrowest(one for one in (place, *place.parents) if one.is_relative_to(_GROUP_ROOT))


def _narrowest(folders: Iterable[Path]) -> float:
    room = math.inf
    for folder in folders:
        try:
            most = int((folder / "memory.max").read_text(encoding="ascii"))
            used = int((folder / "memory.current").read_text(encoding="ascii"))
            facts = (folder / "memory.stat").read_text(encoding="ascii")
        except (OSError, ValueError):
            continue  # no such group, or "max"
        # Files that were read are forgotten when there is need.
        cached = sum(
            int(line.split()[1]) for line in facts.splitlines() if line.startswith("inactive_file ")
        )
        room = min(room, most - used + cached)
    return room


try:
    _library: object = ctypes.CDLL(None)
except OSError:  # not everywhere can a process look into itself
    _library = None
