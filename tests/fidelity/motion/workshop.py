"""What acceptance tests share: test scenes, special robots, measurements."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import mujoco

from motion import worlds
from motion.manoeuvres import Turn, turn_in_place
from motion.stage import Stage
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.robots.description import RobotDescription
from usarsim_server.simulation.frames import Pose
from usarsim_server.testing import Closing
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

Found = TypeVar("Found")

VARIANTS = {
    # The wheel limit of 1.3 read as turns per second (robots reference 1.2).
    "P3AT_fast": ("P3AT", {"max_wheel_speed": 8.17}),
    "P3AT_strong": ("P3AT_real", {"wheel_torque": 10.0}),
    "P3AT_brakeless": ("P3AT_real", {"parking_brake_delay": 1e6}),
}
"""Robots that differ from a shipped one: parent, and keys of its drive."""
LITERAL = ("Hummer", "Sedan", "FrontAckerman", "BasicAckermanRobot")
"""Cars that are tried with the original's rule of steering, too, under names with _literal."""


class Workshop(Closing):
    """Makes stages in a temporary folder, and remembers measurements that several tests share.

    Attributes:
        turn_seconds: simulated s that a turn in place is watched.
        script_seconds: simulated s that runs are compared bit for bit.
        every: steps from one look at a robot to the next.
    """

    def __init__(
        self, turn_seconds: float = 10.0, script_seconds: float = 60.0, every: int = 1
    ) -> None:
        self.every = every
        self.turn_seconds, self.script_seconds = turn_seconds, script_seconds
        self._folder = Path(tempfile.mkdtemp(prefix="usarsim-fidelity-"))
        self._robots = self._folder / "robots"
        self._found: dict[object, Any] = {}
        for name, (parent, drive) in VARIANTS.items():
            worlds.write_robot(self._robots, name, parent, drive)
        for name in LITERAL:
            keys = {"literal": True}
            worlds.write_robot(self._robots, f"{name}_literal", name, keys, "steering")
        self._robot_catalog = load_catalog((self._robots,))

    def world(self, scene: worlds.Scene) -> Path:
        """The folder of a test scene."""
        return worlds.write_world(self._folder / "worlds", scene)

    def scenery(self, scene: worlds.Scene) -> Callable[[], mujoco.MjSpec]:
        """What makes the specification of a test scene, for a physics without a server."""
        world = load_world(self.world(scene))
        return lambda: build_scene(world)

    def stage(
        self, scene: worlds.Scene, robot: str, timestep: float, pose: Pose | None = None
    ) -> Stage:
        """A stage with a fresh robot of a shipped class or a variant."""
        return Stage(self.world(scene), robot, timestep, pose, (self._robots,), self.every)

    def describe(self, robot: str) -> RobotDescription:
        """A shipped class or a variant."""
        found = self._robot_catalog.find(robot)
        assert found is not None, robot
        return found

    def turn(self, robot: str, timestep: float, speed: float, friction: float = 1.0) -> Turn:
        """A turn in place on level ground, measured once; the speed is cut to what it can do."""

        def drive() -> Turn:
            with self.stage(worlds.flat(friction), robot, timestep) as stage:
                return turn_in_place(stage, stage.capped(speed), self.turn_seconds)

        return self.once(("turn", robot, timestep, speed, friction), drive)

    def once(self, key: object, measure: Callable[[], Found]) -> Found:
        """What a measurement found, which is taken the first time that its key comes."""
        if key not in self._found:
            self._found[key] = measure()
        found: Found = self._found[key]
        return found

    def close(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self._folder, ignore_errors=True)
