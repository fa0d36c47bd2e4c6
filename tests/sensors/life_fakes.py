"""A stage for the tests of sensors of life: people made as in the server, walls, true rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from sensor_fakes import FakeRobot, describe_item, describe_robot, describe_world

from usarsim_server.sensors.base import SensorContext, create_sensor
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.worlds.description import Victim
from usarsim_server.worlds.surroundings import Surroundings
from usarsim_server.worlds.victims import PELVIS_HEIGHT, add_victim

Wall = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Opposite corners of a box, m, simulation frame."""


def person(
    name: str,
    x: float,
    y: float = 0.0,
    posture: str = "standing",
    status: str = "Alive",
    yaw: float = np.pi,
    **properties: Any,
) -> Victim:
    """Somebody on the floor at z = -1, so that a sensor in the origin looks at chests."""
    pose = Pose((x, y, PELVIS_HEIGHT[posture] - 1.0), quaternion_from_rpy(0.0, 0.0, yaw))
    return Victim(name, pose, posture, status, properties)


def wall(x: float, low: float = -10.0, high: float = 10.0) -> Wall:
    """A thin wall across the x axis, between two heights."""
    return (x, -10.0, low), (x + 0.05, 10.0, high)


class Stage:
    """A world with its surroundings; answers ray fans against people and walls.

    Attributes:
        world: the description.
        surroundings: shared by all sensors made here.
        asked: number of rays that sensors asked for.
    """

    def __init__(self, *victims: Victim, walls: Sequence[Wall] = (), **facts: Any) -> None:
        self.world = replace(describe_world(), victims=victims, **facts)
        self.surroundings = Surroundings(self.world)
        self.asked = 0
        spec = mujoco.MjSpec()
        for victim in victims:
            add_victim(spec, victim)
        for number, (low, high) in enumerate(walls):
            middle, half = (np.array(low) + high) / 2, (np.array(high) - low) / 2
            box = mujoco.mjtGeom.mjGEOM_BOX
            spec.worldbody.add_geom(name=f"wall_{number}", type=box, pos=middle, size=half)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)

    def make(self, kind: str, name: str = "item", *, seed: int = 1, **rest: Any) -> Any:
        """A sensor in this world; `rest` goes to `describe_item`."""
        context = SensorContext(
            describe_robot(),
            self.world,
            np.random.default_rng(seed),
            surroundings=self.surroundings,
        )
        return create_sensor(describe_item(kind, name, **rest), context)

    def read(self, sensor: Any, robot: FakeRobot | None = None) -> bool:
        """Let a sensor take one reading."""
        robot = robot or FakeRobot()
        fans = sensor.rays(robot)
        return bool(sensor.measure(robot, self.cast(fans, robot.time)))

    def cast(self, fans: Sequence[RayFan], time: float) -> list[RayHits]:
        """Answer fans as the world is at a time."""
        for mover in self.surroundings.movers:
            index = self._model.body(mover.body).mocapid[0]
            pose = mover.pose(time)
            self._data.mocap_pos[index] = pose.position
            self._data.mocap_quat[index] = pose.quaternion
        mujoco.mj_kinematics(self._model, self._data)
        return [self._answer(fan) for fan in fans]

    def _answer(self, fan: RayFan) -> RayHits:
        count = len(fan.directions)
        self.asked += count
        distances, geoms = np.full(count, -1.0), np.full(count, -1, dtype=np.int32)
        if self._model.ngeom:
            mujoco.mj_multiRay(
                self._model,
                self._data,
                fan.origin,
                np.ascontiguousarray(fan.directions).reshape(-1),
                None,
                1,
                -1,
                geoms,
                distances,
                None,
                count,
                fan.max_range,
            )
        names = tuple(None if geom < 0 else self._model.geom(int(geom)).name for geom in geoms)
        free = np.where(geoms < 0, np.inf, distances)
        return RayHits(free, None, names if fan.identify else None)
