"""Machines that laws move, for the tests of this room: an aircraft, a submarine, a recorder."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray
from sim_fakes import Scenery, floor, pose_at, run

from usarsim_server.simulation import diving, flight
from usarsim_server.simulation.diving import Diving, Hull
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.flight import FlightLimits, VelocityHold
from usarsim_server.simulation.model import PhysicsOptions, RobotModel
from usarsim_server.simulation.motion_laws import Law, LawModel

Array = NDArray[np.float64]


def build_craft(
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0), size: float = 0.2, mass: float = 1.0
) -> mujoco.MjSpec:
    """A box without weight in its surroundings; its mass centre may lie beside the origin."""
    spec = mujoco.MjSpec()
    base = spec.worldbody.add_body(name="base", gravcomp=1.0)
    base.add_freejoint(name="free")
    base.sleep = mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED
    half = [size, size, size / 4.0]
    base.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=offset, mass=mass)
    return spec


def _machine(key: str, build: partial[mujoco.MjSpec], *laws: LawModel) -> RobotModel:
    return RobotModel(key=key, build=build, driven=(), rest_height=0.2, laws=laws)


def aircraft(limits: FlightLimits | None = None, key: str = "craft", **body: object) -> RobotModel:
    """An aircraft of 1 kg; `body` as for `build_craft`."""
    hold = LawModel(
        lambda model, prefix: VelocityHold(model, f"{prefix}base", limits or FlightLimits()),
        flight.CHANNELS,
    )
    return _machine(key, partial(build_craft, **body), hold)  # type: ignore[arg-type]


def submarine(hull: Hull | None = None, mass: float = 300.0) -> RobotModel:
    """A submarine of 300 kg."""
    dive = LawModel(
        lambda model, prefix: Diving(model, f"{prefix}base", hull or Hull()), diving.CHANNELS
    )
    return _machine("submarine", partial(build_craft, size=0.5, mass=mass), dive)


class Counter(Law):
    """Remembers how often it was asked and the last command; pushes nothing."""

    def __init__(self, model: mujoco.MjModel, prefix: str) -> None:
        self.prefix = prefix
        self.memory = np.zeros(2)
        model.body(f"{prefix}base")  # it exists

    def prepare(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        """Count."""
        self.memory[0] += 1.0

    def push(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        """Remember."""
        self.memory[1] = command.sum()

    def release(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Forget."""
        self.memory[:] = 0.0

    def state(self) -> Array:
        """Both numbers."""
        return self.memory.copy()

    def restore(self, state: Array) -> None:
        """Both numbers."""
        self.memory[:] = state


def engine_of(
    *models: RobotModel,
    height: float = 2.0,
    scenery: Scenery | None = None,
    timestep: float = 0.004,
    spare: Sequence[RobotModel] = (),
) -> Engine:
    """One robot of each model in a row along y, 3 m apart, numbered from 0, at a height."""
    engine = Engine(scenery or floor(), PhysicsOptions(timestep=timestep), [*models, *spare])
    for number in range(len(models)):
        engine.occupy(number, number, pose_at(0.0, 3.0 * number, height))
    return engine


def command(engine: Engine, *values: float, robot: int = 0, seconds: float = 0.0) -> None:
    """Command the law of a robot and let time pass."""
    engine.command_law(robot, np.array(values, dtype=float))
    run(engine, seconds)


def velocity(engine: Engine, robot: int = 0) -> Array:
    """Velocity of a robot's reference point in the world, m/s."""
    dof = engine.world.layouts[engine.active[robot]].dof
    return np.array(engine.data.qvel[dof : dof + 3])


def spin(engine: Engine, robot: int = 0) -> Array:
    """Turning rate of a robot in its own frame, rad/s."""
    dof = engine.world.layouts[engine.active[robot]].dof
    return np.array(engine.data.qvel[dof + 3 : dof + 6])


def place(engine: Engine, robot: int = 0) -> Array:
    """Reference point of a robot, m."""
    start = engine.world.layouts[engine.active[robot]].qpos
    return np.array(engine.data.qpos[start : start + 3])


def axes(engine: Engine, robot: int = 0) -> Array:
    """Columns: the robot's axes ahead, to the left and up, in the world."""
    start = engine.world.layouts[engine.active[robot]].qpos
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, engine.data.qpos[start + 3 : start + 7])
    frame: Array = matrix.reshape(3, 3)
    return frame
