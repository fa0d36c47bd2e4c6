"""A world with machinery and its physics, without robots and server."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from world_files import HEAD, START, write_world

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Vector
from usarsim_server.simulation.machines import Machine
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.machinery.obstacles import operators_of
from usarsim_server.worlds.scene import build_scene

CRATE = (
    '<body name="{name}" pos="{x} {y} {z}"><freejoint name="{name}"/>'
    '<geom type="box" size="0.15 0.15 0.15" mass="2"/></body>'
)


def scene(*crates: Vector) -> str:
    """A floor, and cubes of 0.3 m at places: `crate0`, `crate1` and so on."""
    bodies = "".join(
        CRATE.format(name=f"crate{number}", x=x, y=y, z=z)
        for number, (x, y, z) in enumerate(crates)
    )
    floor = '<geom name="floor" type="plane" size="0 0 1" friction="1"/>'
    return f'<mujoco model="hall"><worldbody>{floor}{bodies}</worldbody></mujoco>'


class Stage:
    """A world's physics.

    Attributes:
        engine: steps it.
        machines: those of the world, in the order doors, lifts, obstacles.
    """

    def __init__(self, directory: Path, sheet: str, *crates: Vector) -> None:
        """Make a world of tables and crates."""
        folder = write_world(directory, HEAD + START + sheet, scene(*crates), "hall")
        world = load_world(folder)
        self.engine = Engine(lambda: build_scene(world), PhysicsOptions())
        operators = operators_of(world.machinery)
        self.machines: tuple[Machine, ...] = operators.machines
        self.engine.set_movers(operators.movers, operators.machines)

    def run(self, seconds: float, batch: int = 5) -> None:
        """Let time pass; nothing may diverge."""
        steps = round(seconds / self.engine.timestep)
        while steps > 0:
            count = min(batch, steps)
            assert self.engine.advance(count) == []
            steps -= count

    def place(self, body: str) -> NDArray[np.float64]:
        """Position (3,) of a body, m."""
        position: NDArray[np.float64] = self.engine.snapshot().xpos[self._body(body)]
        return position

    def yaw(self, body: str) -> float:
        """Turn of a body about z, rad."""
        w, _, _, z = self.engine.snapshot().xquat[self._body(body)].tolist()
        return float(2.0 * np.arctan2(z, w))

    def velocity(self, joint: str) -> NDArray[np.float64]:
        """Linear velocity (3,) of a free body, m/s."""
        dof = int(self.engine.world.model.joint(joint).dofadr[0])
        velocity: NDArray[np.float64] = self.engine.data.qvel[dof : dof + 3].copy()
        return velocity

    def put(self, joint: str, place: Vector) -> None:
        """Put a free body somewhere, at rest."""
        model, data = self.engine.world.model, self.engine.data
        start = int(model.joint(joint).qposadr[0])
        dof = int(model.joint(joint).dofadr[0])
        data.qpos[start : start + 3] = place
        data.qvel[dof : dof + 6] = -0.0

    def state(self) -> bytes:
        """Everything that moves, bit for bit."""
        data = self.engine.data
        return b"".join(
            part.tobytes() for part in (data.qpos, data.qvel, data.mocap_pos, data.mocap_quat)
        )

    def _body(self, name: str) -> int:
        return int(self.engine.world.model.body(name).id)
