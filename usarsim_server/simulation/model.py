"""The compiled world: fixed scenery plus numbered slots that hold robots.

Compiling takes time, so robots are not added one by one. A model carries slots for every class in
use; free slots are parked, asleep, on a shelf far above the world. Taking a slot is a matter of
writing a pose; the model is compiled again, in the background, only when a class runs out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.errors import UsarsimError
from usarsim_server.simulation.articulation import HandModel, JointModel, ToolModel, add_ties
from usarsim_server.simulation.frames import Pose, pose_of
from usarsim_server.simulation.ground import Surface
from usarsim_server.simulation.layout import RobotLayout
from usarsim_server.simulation.mailbox import yield_interpreter
from usarsim_server.simulation.midphase import improve_trees
from usarsim_server.simulation.motion_laws import LawModel
from usarsim_server.simulation.splice import FixedPart

SHELF_HEIGHT = 2000.0
"""Top of the parking shelf, m: above anything a ray, a satellite link or a camera asks for."""
SHELF_SPACING = 6.0
"""Distance between parked robots, m."""
SHELF_COLUMNS = 16
ROOT_BODY = "base"
ROOT_JOINT = "free"
SHELF_NAME = "usarsim:shelf"
SLOT = "robot"
"""What names of everything in a slot begin with; then the slot's number."""
ATTACHED_TOGETHER = 8
"""Slots that are put together before they are attached to a world."""
NOWHERE = -1
"""Stands for the base body of a slot without any."""
KINEMATIC_SHELF = 500.0
"""m above the shelf: where things hang that would push what is parked beside them."""

SERVO_TIME = 0.02
"""s: twice the time in which a wheel servo takes away 63 % of an error of wheel speed."""
SERVO_IMPEDANCE = 0.95
UNLIMITED_TORQUE = 1000.0
"""N m: stands for no limit."""

WAKE = -0.0
"""Written to a velocity of a sleeping body: equal to zero, but not byte by byte, so it wakes."""

JOINT_WIDTH = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}
"""Coordinates and velocities of a free, ball, slide and hinge joint."""


@dataclass(frozen=True, slots=True)
class PhysicsOptions:
    """Settings of the physics (robots reference 4.10)."""

    timestep: float = 0.004  # s
    impratio: float = 10.0  # ratio of frictional to normal constraint impedance
    compensation: bool = True  # contact compensation on; off only to show what it is for
    surfaces: tuple[Surface, ...] = ()  # patches of water, mud, sand, ice


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """What the simulation has to know of a robot class."""

    key: str  # identifies the class; slots of one key are interchangeable
    build: Callable[[], mujoco.MjSpec]
    """Makes a fresh MuJoCo specification whose root body is `base` with the free joint `free`;
    joints and velocity actuators of driven wheels carry the wheel's name. Gain and force range of
    such an actuator describe the wheel's servo (see `servos.py`)."""
    driven: tuple[str, ...]  # names of the driven wheels in part order
    rest_height: float  # height of the reference point above a flat floor, m
    wheel_acceleration: float = 10.0  # ramp of the wheel speed targets, rad/s^2
    brake_delay: float = 0.3  # s of zero command before the wheels are held
    wheel_deceleration: float | None = None
    """Ramp towards standstill, rad/s^2; None: as `wheel_acceleration`."""
    kinematic: bool = False
    """A thing that goes its own way (see `movers.py`): its bodies, `base` first, are mocap bodies
    without joints, beside each other in the specification."""
    robot: bool = True
    """It counts as a robot; free slots of other things may be built anew as another key."""
    joints: tuple[JointModel, ...] = ()  # drives of what is no wheel (see `joint_servos.py`)
    hands: tuple[HandModel, ...] = ()  # what takes hold of things (see `hands.py`)
    tools: tuple[ToolModel, ...] = ()
    """Further root bodies of the specification, each on a free joint of its own."""
    anchored: bool = False  # it stands fixed wherever it is put
    laws: tuple[LawModel, ...] = ()  # what moves it beside wheels and joints (see `motion_laws.py`)


VACANT = RobotModel(
    key="", build=mujoco.MjSpec, driven=(), rest_height=0.0, kinematic=True, robot=False
)
"""The class of a slot that was given back: its number stays, there is nothing in it."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class CompiledWorld:
    """One generation of the model with everything that is looked up once per generation."""

    generation: int
    model: mujoco.MjModel
    slots: tuple[RobotModel, ...]
    layouts: tuple[RobotLayout, ...]
    parking: NDArray[np.float64]
    """Free-joint coordinates (slots, 7) of the parking places."""
    masks: NDArray[np.int32]
    """Contact type and affinity (2, nbody) of all bodies; those of parked ones in the running
    model are zero (see `engine.py`)."""
    fixed: int = 0  # bytes of the model that were compiled once for all generations

    def weight(self, slot: int) -> int:
        """Bodies that a slot adds to the model."""
        return len(self.layouts[slot].bodies)

    def shared(self, slots: Sequence[RobotModel]) -> int:
        """How many slots from the first one on are the same in another model of this world.

        What is in them, and in the scenery, has the same numbers (of bodies, geoms, joints,
        coordinates, actuators) in both: each slot comes behind those before.
        """
        pairs = enumerate(zip(self.slots, slots, strict=False))
        return next(
            (n for n, (one, other) in pairs if one is not other), min(len(self.slots), len(slots))
        )


def check_mujoco_version(version: str = mujoco.__version__) -> None:
    """Refuse releases that are known to be wrong.

    Raises:
        UsarsimError: for 4.0.0, whose sparse factorisation diverges as soon as six robots exist
            and two of them touch, and for releases older than the mechanisms used here.
    """
    parts = tuple(int(part) for part in version.split(".")[:2] if part.isdigit())
    if parts >= (4, 0):
        raise UsarsimError(
            f"MuJoCo {version} is not supported: release 4.0.0 diverges when robots touch "
            "(cure: pip install 'mujoco>=3.16,<4')"
        )
    if parts < (3, 16):
        raise UsarsimError(
            f"MuJoCo {version} is too old (cure: pip install --upgrade 'mujoco>=3.16,<4')"
        )


class Blueprint:
    """The specification of a world with its slots, of which models are compiled; it can grow.

    MuJoCo goes through all of a specification, and keeps the interpreter meanwhile, whenever
    something is attached to it: so some robots at a time are put together apart and attached as a
    whole, and what has been attached stays for the next model.

    Attributes:
        slots: the class of every slot; slot numbers are indices into this list.
    """

    def __init__(self, spec: mujoco.MjSpec, options: PhysicsOptions) -> None:
        """Make one without slots of the specification of a world without robots, which is used."""
        self.slots: list[RobotModel] = []
        self._spec = spec
        _set_options(spec, options)
        self._shelf = spec.worldbody.add_geom(
            name=SHELF_NAME,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            rgba=[0.0, 0.0, 0.0, 0.0],
            **_shelf_place(0),
        )

    def add(self, slots: Sequence[RobotModel]) -> None:
        """Add slots behind those that there are."""
        first = len(self.slots)
        self.slots += slots
        place = _shelf_place(len(self.slots))
        self._shelf.size, self._shelf.pos = place["size"], place["pos"]
        for begin in range(first, len(self.slots), ATTACHED_TOGETHER):
            self._attach(range(begin, min(begin + ATTACHED_TOGETHER, len(self.slots))))
            yield_interpreter()

    def _attach(self, numbers: Sequence[int]) -> None:
        together = mujoco.MjSpec()
        for slot in numbers:
            robot = self.slots[slot]
            if robot is VACANT:
                continue
            frame = together.worldbody.add_frame(pos=_parking_place(slot, robot)[:3])
            built = robot.build()
            for body in list(built.worldbody.bodies):
                if not robot.kinematic:
                    body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_INIT
                frame.attach_body(body, slot_prefix(slot).removeprefix(SLOT), "")
        self._spec.attach(together, prefix=SLOT, frame=self._spec.worldbody.add_frame())
        for slot in numbers:  # to the world: that has another name inside
            robot = self.slots[slot]
            add_ties(self._spec, slot_prefix(slot), ROOT_BODY, robot.hands, robot.anchored)

    def compile(
        self, generation: int, older: CompiledWorld | None = None, fixed: FixedPart | None = None
    ) -> CompiledWorld:
        """Compile a model.

        Args:
            generation: number of this compilation.
            older: another one of the same world, of which is used again what is the same here.
            fixed: more geoms of the world, which are compiled already.

        Raises:
            ValueError: if MuJoCo cannot compile it.
        """
        model = self._spec.compile()
        improve_trees(model, apart=model.geom(SHELF_NAME).id)
        if fixed is not None:
            model = fixed.into(model)
        slots = tuple(self.slots)
        parking = np.zeros((len(slots), 7))
        for slot, robot in enumerate(slots):
            parking[slot] = _parking_place(slot, robot)
        layouts = list(older.layouts[: older.shared(slots)]) if older is not None else []
        names = [model.body(body).name for body in range(model.nbody)]
        for slot in range(len(layouts), len(slots)):
            layouts.append(_layout(model, slot, slots[slot], names))
        for layout in layouts:
            _convert_servos(model, layout)
        masks = np.array([model.body_contype, model.body_conaffinity])
        size = 0 if fixed is None else fixed.size
        return CompiledWorld(generation, model, slots, tuple(layouts), parking, masks, size)


def compile_world(
    scenery: Callable[[], mujoco.MjSpec],
    slots: Sequence[RobotModel],
    options: PhysicsOptions,
    generation: int,
) -> CompiledWorld:
    """Compile scenery and robot slots into one model, see `Blueprint`.

    Args:
        scenery: makes a fresh specification of the world without robots.
        slots: the class of every slot.
        options: of the physics. generation: number of this compilation.

    Raises:
        ValueError: if MuJoCo cannot compile the result.
    """
    blueprint = Blueprint(scenery(), options)
    blueprint.add(slots)
    return blueprint.compile(generation)


def _convert_servos(model: mujoco.MjModel, layout: RobotLayout) -> None:
    """Turn the velocity actuators of the driven wheels into friction losses (see `servos.py`).

    At the speed error e the solver exerts the torque e B d / ((1 - d) A), B and d being the
    constraint's damping and impedance and A the inverse inertia that the wheel feels; d is chosen
    so that this is e times the gain of the actuator.
    """
    for actuator, dof in zip(layout.wheel_actuators, layout.wheel_dof, strict=True):
        gain = float(model.actuator_gainprm[actuator, 0])
        limited = bool(model.actuator_forcelimited[actuator])
        torque = float(model.actuator_forcerange[actuator, 1]) if limited else UNLIMITED_TORQUE
        if gain <= 0.0 or torque <= 0.0:
            name = model.actuator(actuator).name
            raise ValueError(f"wheel servo {name}: gain {gain:g} and torque {torque:g} must be > 0")
        ratio = gain * float(model.dof_invweight0[dof]) * SERVO_IMPEDANCE * SERVO_TIME / 2.0
        model.dof_frictionloss[dof] = torque
        model.dof_solref[dof] = (SERVO_TIME, 1.0)
        model.dof_solimp[dof] = (ratio / (1.0 + ratio), SERVO_IMPEDANCE, 0.001, 0.5, 2.0)
        model.actuator_gainprm[actuator, 0] = 0.0
        model.actuator_biasprm[actuator, :3] = 0.0


def root_qpos(pose: Pose) -> NDArray[np.float64]:
    """Free-joint coordinates (7,) of a pose."""
    return np.array([*pose.position, *pose.quaternion])


def put(
    world: CompiledWorld, data: mujoco.MjData, slot: int, coordinates: NDArray[np.float64]
) -> None:
    """Write the free-joint coordinates (7,) of a slot; other bodies of kinematic things follow."""
    layout = world.layouts[slot]
    if not layout.mocap.size:
        data.qpos[layout.qpos : layout.qpos + 7] = coordinates
        return
    model = world.model
    base = pose_of(coordinates[:3], coordinates[3:])
    for body in layout.mocap:
        offset = model.body_pos[body] - world.parking[slot, :3]
        pose = base @ pose_of(offset, model.body_quat[body])
        index = model.body_mocapid[body]
        data.mocap_pos[index], data.mocap_quat[index] = pose.position, pose.quaternion


def _set_options(spec: mujoco.MjSpec, options: PhysicsOptions) -> None:
    option = spec.option
    option.timestep = options.timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = options.impratio
    option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    # One diverging robot must not reset the whole world; the engine contains it instead.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET


def _shelf_place(slots: int) -> dict[str, list[float]]:
    """Size and place of a shelf for so many slots, m."""
    rows = max(1, math.ceil(slots / SHELF_COLUMNS))
    return {
        "size": [SHELF_SPACING * SHELF_COLUMNS / 2, SHELF_SPACING * rows / 2, 5.0],
        "pos": [-SHELF_SPACING / 2, SHELF_SPACING * (rows - 1) / 2, SHELF_HEIGHT - 5.0],
    }


def _parking_place(slot: int, robot: RobotModel) -> NDArray[np.float64]:
    row, column = divmod(slot, SHELF_COLUMNS)
    x = (column - SHELF_COLUMNS / 2) * SHELF_SPACING
    y = row * SHELF_SPACING
    z = SHELF_HEIGHT + robot.rest_height + (KINEMATIC_SHELF if robot.kinematic else 0.0)
    return np.array([x, y, z, 1.0, 0.0, 0.0, 0.0])


def slot_prefix(slot: int) -> str:
    return f"{SLOT}{slot}:"


def _layout(
    model: mujoco.MjModel, slot: int, robot: RobotModel, names: Sequence[str]
) -> RobotLayout:
    prefix = slot_prefix(slot)
    base = NOWHERE if robot is VACANT else int(model.body(prefix + ROOT_BODY).id)
    qpos = dof = -1
    if robot.kinematic:
        bodies = [body for body, name in enumerate(names) if name.startswith(prefix)]
    else:
        bodies = np.flatnonzero(model.body_rootid == base).tolist()
        free = model.joint(prefix + ROOT_JOINT)
        qpos, dof = int(free.qposadr[0]), int(free.dofadr[0])
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, bodies)).tolist()
    joints = [joint for joint in joints if model.jnt_dofadr[joint] != dof]
    wheels = np.array([model.joint(prefix + name).id for name in robot.driven], dtype=np.intp)
    drives = [model.actuator(prefix + name).id for name in robot.driven]
    mocap = [body for body in bodies if robot.kinematic and model.body_mocapid[body] >= 0]

    def plain(name: str) -> str:
        return name.removeprefix(prefix).lower()

    return RobotLayout(
        slot=slot,
        base=base,
        qpos=qpos,
        dof=dof,
        links={plain(names[body]): body for body in bodies if body != base},
        joint_qpos={plain(model.joint(j).name): int(model.jnt_qposadr[j]) for j in joints},
        joint_dof={plain(model.joint(j).name): int(model.jnt_dofadr[j]) for j in joints},
        wheel_qpos=model.jnt_qposadr[wheels].astype(np.intp),
        wheel_dof=model.jnt_dofadr[wheels].astype(np.intp),
        wheel_actuators=np.array(drives, dtype=np.intp),
        bodies=frozenset(bodies),
        geoms=np.flatnonzero(np.isin(model.geom_bodyid, bodies)),
        mocap=np.array(mocap, dtype=np.intp),
    )


def matching_joints(
    old: mujoco.MjModel, new: mujoco.MjModel, changed: Collection[int] = ()
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Where the joints of one model lie in another one of the same scenery.

    Those that it lacks, or that are in slots of another kind now (`changed`), are left out.

    Returns:
        Coordinate indices in the old and the new model, then velocity indices in both.
    """
    target = {key: joint for joint, key in enumerate(_joint_keys(new))}
    others = tuple(slot_prefix(slot) for slot in changed)
    positions: tuple[list[int], list[int]] = ([], [])
    velocities: tuple[list[int], list[int]] = ([], [])
    for joint, key in enumerate(_joint_keys(old)):
        twin = target.get(key, -1)
        if twin < 0 or key.removeprefix("@").startswith(others):
            continue
        nq, nv = JOINT_WIDTH[int(old.jnt_type[joint])]
        for model, j, q, v in (
            (old, joint, positions[0], velocities[0]),
            (new, twin, positions[1], velocities[1]),
        ):
            q.extend(range(model.jnt_qposadr[j], model.jnt_qposadr[j] + nq))
            v.extend(range(model.jnt_dofadr[j], model.jnt_dofadr[j] + nv))
    as_index = [np.array(part, dtype=np.intp) for part in (*positions, *velocities)]
    return (as_index[0], as_index[1]), (as_index[2], as_index[3])


def _joint_keys(model: mujoco.MjModel) -> list[str]:
    """A name for every joint that survives recompilation; unnamed ones count per body."""
    keys = []
    seen: dict[str, int] = {}
    for joint in range(model.njnt):
        name = model.joint(joint).name
        if not name:
            body = model.body(model.jnt_bodyid[joint]).name
            seen[body] = seen.get(body, 0) + 1
            name = f"@{body}#{seen[body]}"
        keys.append(name)
    return keys
