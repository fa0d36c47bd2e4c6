"""A robot class on an endless floor: what clients are told of it, how it stands and drives.

This is how authors of robot files see what they have written before any client does. The robot is
alone in its world; what it touches and how far it leans is measured every step.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.actuators.effectors import create_effectors
from usarsim_server.base.errors import RobotDescriptionError, UsarsimError, at
from usarsim_server.base.logs import Log
from usarsim_server.cameras.backend import Quality
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.spectators import extent, portrait_view
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.requests import GetConf, GetGeo
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sessions.robot_role import RobotRole, RobotRoleOptions
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.layout import RobotLayout
from usarsim_server.simulation.model import PhysicsOptions, compile_world
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.testing import Closing, Rehearsal
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.scene import build_scene


@dataclass(frozen=True, slots=True)
class Contacts:
    """What one robot touches at one instant."""

    wheels: int  # number of its driven wheels that touch anything
    depth: float  # deepest overlap of the robot with anything else, m
    own: bool  # whether two of its own parts touch each other


class ContactProbe:
    """Finds contacts in snapshots, with a model of its own that never steps."""

    def __init__(self, world: WorldDescription, robot: RobotDescription) -> None:
        """Compile the world with one robot of a class, as the simulation does."""
        compiled = compile_world(
            lambda: build_scene(world), (robot_model(robot),), PhysicsOptions(), generation=0
        )
        self.model = compiled.model
        # Awake, so that contacts of resting bodies are found too.
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._data = mujoco.MjData(self.model)
        layout = compiled.layouts[0]
        self._robot = np.zeros(self.model.ngeom, dtype=bool)
        self._robot[layout.geoms] = True
        self._wheels = np.full(self.model.ngeom, -1)
        for number, dof in enumerate(layout.wheel_dof):
            body = self.model.dof_bodyid[dof]
            self._wheels[self.model.geom_bodyid == body] = number

    def look(self, snapshot: Snapshot) -> Contacts:
        """The contacts of the robot in a snapshot of the same world with that robot alone."""
        data = self._data
        data.qpos[:] = snapshot.qpos
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_collision(self.model, data)
        touching = data.contact.dist <= 0.0
        pairs = data.contact.geom[touching]
        members = self._robot[pairs].sum(axis=1)
        wheels = self._wheels[pairs]
        distances = data.contact.dist[touching][members == 1]
        return Contacts(
            wheels=len(set(wheels[wheels >= 0].tolist())),
            depth=float(-distances.min()) if distances.size else 0.0,
            own=bool((members == 2).any()),
        )


def tilt(state: RobotBody) -> float:
    """Angle (rad) between the robot's own z axis and the vertical."""
    return math.acos(max(-1.0, min(1.0, state.pose.rotate((0.0, 0.0, 1.0))[2])))


DROP = 0.3
"""m above its rest height from which a robot is let down."""
SETTLE = 4.0
"""Simulated s until it has to be at rest (robots reference 5.1 #17 gives it 3 s)."""
WATCH = 1.0
"""Simulated s for which it is watched then."""
LOOK = 0.5
"""Simulated s between two looks at a robot that gathers speed."""
LONGEST_RUN = 40.0
LISTEN, TICK = 2.0, 0.1
"""Simulated s for which its lines are read, and between two readings."""
STEADY = 0.01
"""Share of its speed by which a robot may still gain within a look."""

# Beyond these a robot does not do what its file promises.
LEANS = math.radians(10.0)
CREEPS = 0.005  # m/s
SINKS = 0.01  # m
OFF_HEIGHT = 0.02  # m
STUCK = 1e-3  # m/s

_PICTURE = Quality(shadows=4096, multisample=4)
_STREAM = re.compile(r"\{(?:Type|Name) [^}]*")
_log = Log("garage")


@dataclass(frozen=True, slots=True)
class Rest:
    """How a robot stands that was let down onto a level floor; what floats stays where it is."""

    height: float  # of its reference point above the floor, m
    tilt: float  # rad
    drift: float  # of its reference point, m/s
    depth: float  # of its deepest overlap with the floor, m


@dataclass(frozen=True, slots=True)
class Problem:
    """Something that a robot does otherwise than its file promises, and what may help."""

    text: str
    cure: str


def full_speed(robot: RobotDescription) -> str:
    """The command that makes a robot go straight ahead as fast as it can; empty if none does."""
    match robot.kind:
        case "ackerman":
            return "DRIVE {Speed 100} {FrontSteer 0} {RearSteer 0} {Normalized True}"
        case "omni":
            groups = "".join(
                f" {{WheelNumber {number}}} {{WheelSpeed 100}} {{WheelSteer 0}}"
                for number in range(len(robot.driven_wheels))
            )
            return f"DRIVE{groups} {{Normalized True}}"
        case "aerial":
            return "DRIVE {LinearVelocity 100} {Normalized True}"
        case "underwater":
            return "DRIVE {Propeller 100} {Rudder 0} {SternPlane 0} {Normalized True}"
    return "DRIVE {Left 100} {Right 100} {Normalized True}" if robot.driven_wheels else ""


class TestDrive(Closing):
    """One robot alone in the world `empty`, in lockstep.

    Attributes:
        robot: its class.
        vehicle: the robot itself.
    """

    __test__ = False  # for pytest, which takes the name for that of a test

    def __init__(self, robot: RobotDescription) -> None:
        """Build the robot and put it a little above the floor.

        Raises:
            RobotDescriptionError: if it cannot be built.
            SpawnError: if there is no room for it.
        """
        self.robot = robot
        self._floats = robot.family.anchored or robot.kind in ("aerial", "underwater")
        self._rehearsal = Rehearsal(world="empty", max_robots=1)
        try:
            self._probe = self._build()
            height = robot.rest_height + (0.0 if self._floats else DROP)
            robots = self._rehearsal.assembly.robots
            self.vehicle = robots.spawn(robot, None, Pose((0.0, 0.0, height)))
        except BaseException:
            self._rehearsal.close()
            raise

    def _build(self) -> ContactProbe:
        try:
            return ContactProbe(self._rehearsal.assembly.world, self.robot)
        except ValueError as error:
            problem = " ".join(str(error).split())
            raise RobotDescriptionError(
                at(
                    self.robot.source,
                    f"MuJoCo cannot build it: {problem}",
                    "check sizes, masses and places",
                )
            ) from None

    # -- what clients are told ---------------------------------------------------------------

    def lines(self, dialect: Dialect) -> Iterator[str]:
        """The answers to GETCONF and GETGEO about the robot and everything that it carries."""
        role = self._role(dialect)
        for wire_type in ("Robot", *self._wire_types(dialect)):
            yield from role.obey(GetConf(wire_type))
            yield from role.obey(GetGeo(wire_type))

    def reports(self, dialect: Dialect) -> list[str]:
        """The first line of each stream, STA and SEN among them; lets `LISTEN` s pass."""
        role = self._role(dialect)
        found: dict[str, str] = {}
        for _ in range(round(LISTEN / TICK)):
            snapshot = self._state().snapshot
            reading = role.read(snapshot, role.schedule.take_due(snapshot.time))
            if reading is not None:
                for line in reading.finish(self.vehicle.body.cast(reading.fans, snapshot)):
                    found.setdefault("".join((line[:3], *_STREAM.findall(line)[:2])), line)
            self._rehearsal.run(TICK)
        return list(found.values())

    def _wire_types(self, dialect: Dialect) -> list[str]:
        robot = self.robot
        kinds = [sensor.wire_type for sensor in self.vehicle.sensors]
        if any(actuator.package for actuator in robot.actuators):
            kinds.append(FACETS[dialect].package_type)
        kinds += [effector.wire_type for effector in create_effectors(robot)]
        kinds += ["Camera"] if robot.cameras else []
        return list(dict.fromkeys(kinds))

    def _role(self, dialect: Dialect) -> RobotRole:
        return RobotRole(self.vehicle, dialect, RobotRoleOptions(), None, _log)

    # -- what it does ------------------------------------------------------------------------

    def rest(self) -> Rest:
        """Let the robot settle, then watch it for a while.

        Raises:
            UsarsimError: if the robot is lost.
        """
        self._rehearsal.run(SETTLE)
        before = self._state()
        self._rehearsal.run(WATCH)
        after = self._state()
        return Rest(
            height=after.pose.position[2],
            tilt=tilt(after),
            drift=math.dist(before.pose.position, after.pose.position) / WATCH,
            depth=self._probe.look(after.snapshot).depth,
        )

    def top_speed(self) -> float | None:
        """Speed (m/s) that it reaches when told to go straight ahead at full speed.

        Returns:
            None if no command makes this kind of robot go.

        Raises:
            UsarsimError: if the robot is lost.
        """
        command = full_speed(self.robot)
        if not command:
            return None
        role = self._role(self.robot.dialect)
        for parsed in parse_line(command.encode("ascii")):
            role.obey(interpret(parsed))
        speed = 0.0
        for _ in range(round(LONGEST_RUN / LOOK)):
            start = self._state().pose.position
            self._rehearsal.run(LOOK)
            last, speed = speed, math.dist(start, self._state().pose.position) / LOOK
            if 0.0 < speed <= (1.0 + STEADY) * last:
                break
        return speed

    def problems(self, rest: Rest, speed: float | None) -> list[Problem]:
        """What is wrong with how it stood and drove."""
        return list(self._problems(rest, speed))

    def _problems(self, rest: Rest, speed: float | None) -> Iterator[Problem]:
        if rest.tilt > LEANS:
            yield Problem(
                f"it leans by {math.degrees(rest.tilt):.0f} degrees at rest",
                "put masses lower, or what it stands on further apart",
            )
        if rest.drift > CREEPS:
            yield Problem(
                f"it does not come to rest, but moves at {1000 * rest.drift:.0f} mm/s",
                "give its wheels and joints more torque, or something to stand on",
            )
        if rest.depth > SINKS:
            yield Problem(
                f"it sinks {1000 * rest.depth:.0f} mm into the floor",
                "make it lighter, or let more parts bear it",
            )
        off = rest.height - self.robot.rest_height
        if abs(off) > OFF_HEIGHT and not self._floats:
            yield Problem(
                f"it rests {1000 * abs(off):.0f} mm {'above' if off > 0 else 'below'} rest_height",
                f"write rest_height = {rest.height:.3f}, or move what it stands on",
            )
        if speed is not None and speed < STUCK:
            yield Problem(
                "it does not move at full speed",
                "check max_wheel_speed and wheel_torque, and that its wheels touch the floor",
            )

    def _state(self) -> RobotBody:
        state = self.vehicle.body.look()
        if state is None:
            raise UsarsimError(f"{self.robot.source}: the robot was lost from the world")
        return state

    # -- what it looks like ------------------------------------------------------------------

    def size(self) -> tuple[float, float, float]:
        """Length, width and height of what can be seen of it at this moment, m."""
        low, high = extent(*self._stage())
        length, width, height = np.subtract(high, low).tolist()
        return length, width, height

    def visible(self) -> bool:
        """Whether there is anything to be seen of it."""
        return any(self.size())

    def portrait(self, width: int, height: int, renderer: str = "auto") -> NDArray[Any]:
        """Its picture, (height, width, 3), as OpenGL draws it, or else as rays do."""
        stage, layout = self._stage()
        simulation = self._rehearsal.assembly.simulation
        painter = Painter(simulation.compiled, PainterOptions(renderer, _PICTURE))
        try:
            view = portrait_view(stage, layout, width, height)
            return painter.picture(view, self._state().snapshot)
        finally:
            painter.close()

    def _stage(self) -> tuple[Stage, RobotLayout]:
        state = self._state()
        stage = Stage(self._rehearsal.assembly.simulation.compiled(state.snapshot))
        stage.show(state.snapshot)
        return stage, state.layout

    # -- the end -----------------------------------------------------------------------------

    def close(self) -> None:
        """End its world."""
        self._rehearsal.close()
