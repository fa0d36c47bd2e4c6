"""All robots of a world: classes become bodies, bodies get names, numbers and random streams.

A robot's battery drains evenly from the moment of spawning, whatever the robot does: the original
divides the stored energy by a moving average of the drain that starts at the nominal drain and
never leaves it, so the printed value falls by one a second (robots reference 2.10).
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from usarsim_server.actuators.effectors import Effector, create_effectors
from usarsim_server.base.logs import Log
from usarsim_server.cameras.board import CameraBoard
from usarsim_server.cameras.view import Grid
from usarsim_server.protocol.values import name_key
from usarsim_server.radio.network import Station
from usarsim_server.robots.catalog import RobotCatalog
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.sensors.base import Sensor, SensorContext, create_sensor
from usarsim_server.sessions.stuck import StuckWatch
from usarsim_server.simulation.articulation import JointModel, ToolModel
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import RobotModel
from usarsim_server.simulation.objects import ObjectFacts
from usarsim_server.simulation.simulation import BodyHandle, Simulation
from usarsim_server.simulation.slots import always
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.labels import Labels
from usarsim_server.worlds.smoke import smoke_field
from usarsim_server.worlds.surroundings import Surroundings

NO_BATTERY = 99999
"""What STA prints for a robot without a battery, and the most it prints for one with it."""

AT_HOME = 0.01
"""m: a robot that is put back so near to where it was spawned stands there."""

_SLACK = 1e-6
"""s: 1200 s less 0.3 s less 0.7 s is 1199 s, although not in binary."""


class Battery:
    """A charge that lasts `life` s of simulated time after spawning; none if that is no number."""

    def __init__(self, life: float) -> None:
        self._life = max(life, 0.0) if math.isfinite(life) else 0.0

    def remaining_seconds(self, elapsed: float) -> int:
        """Whole seconds of life left `elapsed` simulated seconds after spawning, for STA."""
        return min(int(self._remaining(elapsed) + _SLACK), NO_BATTERY)

    def empty(self, elapsed: float) -> bool:
        """Whether nothing is left: sensors fall silent and the robot stops."""
        return self._remaining(elapsed) <= _SLACK

    def share(self, elapsed: float) -> float:
        """Which part of the charge is left, 0 to 1."""
        return self._remaining(elapsed) / self._life if self._life else 0.0

    def _remaining(self, elapsed: float) -> float:
        return max(self._life - max(elapsed, 0.0), 0.0)


@dataclass(slots=True, eq=False)
class Power:
    """Battery and headlight of one robot: set by its pilot alone, read by any thread."""

    battery: Battery | None = None  # None for a robot without one
    spawned: float | None = None  # simulated time of its first snapshot; None before
    lit: bool = False
    """The headlight is on and has power; DRIVE switches it, cameras see what it shines on."""

    def seconds(self, time: float) -> int:
        """Whole seconds of life left at a simulated time (s)."""
        if self.battery is None or self.spawned is None:
            return NO_BATTERY
        return self.battery.remaining_seconds(time - self.spawned)

    def share(self, time: float) -> float | None:
        """Which part of the charge is left at a simulated time (s), 0 to 1; None: no battery."""
        if self.battery is None:
            return None
        return self.battery.share(0.0 if self.spawned is None else time - self.spawned)

    def empty(self, time: float) -> bool:
        """Whether nothing is left at a simulated time (s): it stops, its sensors fall silent."""
        if self.battery is None or self.spawned is None:
            return False
        return self.battery.empty(time - self.spawned)


@dataclass(frozen=True, slots=True, eq=False)
class Vehicle:
    """One robot in the world: its class, its body in the simulation, its sensors."""

    name: str  # label, unique in the world; from INIT, or invented
    description: RobotDescription  # its class
    body: BodyHandle  # its body in the simulation
    sensors: tuple[Sensor, ...]  # in mount order
    leave: Callable[[], None]  # takes it out of the world; a second call does nothing
    cameras: tuple[int, ...]  # keys of its cameras on the board, in mount order
    board: CameraBoard  # all cameras of the world
    home: Pose  # where it was put at first
    power: Power = field(default_factory=Power)  # its battery and headlight
    watch: StuckWatch = field(default_factory=StuckWatch)  # set by its pilot, read by any thread

    @property
    def robot(self) -> int:
        """Its number in the simulation."""
        return self.body.number


TRUE_POSE = "GroundTruth"
"""Type on the wire of all sensors that tell the true pose."""

_log = Log("fleet")


class Robots:
    """Makes and removes vehicles; safe to use from any thread."""

    def __init__(
        self,
        catalog: RobotCatalog,
        world: WorldDescription,
        simulation: Simulation,
        seed: int,
        surroundings: Surroundings | None = None,
        board: CameraBoard | None = None,
        truth: bool = True,
    ) -> None:
        """Start without robots.

        Args:
            catalog: the classes that can be asked for.
            world: the world they are put into.
            simulation: its physics.
            seed: of all sensor noise; each sensor draws from a stream of its own, chosen by the
                robot's place in the order of spawning and the sensor's place on the robot.
            surroundings: live facts that all sensors share; None: every sensor has its own.
            board: where cameras come and go with their robots; None: one of the usual size.
            truth: whether robots are mounted with sensors that tell where they really are.
        """
        self.board = board or CameraBoard(Grid())
        self._catalog = catalog
        self._world = world
        self._simulation = simulation
        self._seed = seed
        self._truth = truth
        self._surroundings = surroundings
        self._smoke = smoke_field(world.smoke)
        self._lock = threading.Lock()
        self._models: dict[str, RobotModel] = {}
        self._vehicles: dict[int, Vehicle] = {}
        self._changes = 0
        self._labels = Labels("fleet")
        self._label_of_thing: Callable[[int], str | None] = _nameless
        self._number_of_thing: Callable[[str], int | None] = _unknown
        self._order = 0

    @property
    def vehicles(self) -> tuple[Vehicle, ...]:
        """All vehicles in the world, in the order of spawning."""
        with self._lock:
            return tuple(self._vehicles.values())

    @property
    def changes(self) -> int:
        """How often a vehicle has come or gone; what remembers this keeps no vehicle that has left
        and, with it, no former model of the world."""
        with self._lock:
            return self._changes

    def classes(self) -> list[tuple[int, RobotDescription]]:
        """Number in the simulation and class of all robots, in the order of spawning."""
        return [(one.robot, one.description) for one in self.vehicles]

    def stations(self) -> list[Station]:
        """All robots of this moment as radio sees them, in the order of spawning; may block.

        A robot is a station from the moment it is spawned until its connection closes (side
        channels reference 3.2). Its battery counts as empty from its last whole second on.
        """
        # In this order: a robot that is counted is in the picture, unless it has just left.
        present = self.vehicles
        snapshot = self._simulation.look()
        layouts, places = snapshot.layouts, snapshot.xpos
        return [
            Station(
                one.name,
                tuple(places[layouts[one.robot].base].tolist()),
                one.power.seconds(snapshot.time) <= 0,
            )
            for one in present
            if one.robot in layouts
        ]

    @property
    def time(self) -> float:
        """Simulated time of this moment, s; blocks until the physics is between two steps."""
        return self._simulation.look().time

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of all classes in alphabetical order."""
        return self._catalog.names()

    def describe(self, class_name: str) -> RobotDescription | None:
        """The class that a client means, None if there is none."""
        return self._catalog.find(class_name)

    def spawn(
        self,
        description: RobotDescription,
        name: str | None,
        pose: Pose,
        wanted: Callable[[], bool] = always,
        exact_name: bool = False,
    ) -> Vehicle:
        """Put a new vehicle into the world; blocks until it is there.

        Args:
            description: its class.
            name: wanted label, made clean (`clean_name`) and unique; None: invented.
            pose: wanted pose of the reference point (simulation frame).
            wanted: asked when its turn has come; others before it may have taken long.
            exact_name: no other name will do.

        Raises:
            SpawnError: if the name cannot be had, there is no room, the pose cannot be used, or
                nobody wants it any more.
            RobotDescriptionError: if a sensor of the class cannot be made.
        """
        with self._lock:
            order = self._order
            self._order += 1
            label = self._labels.take(name, description.name, exact_name)
        try:
            sensors = tuple(self._sensors(description, order))
            robot, placed = self._simulation.spawn(self._model(description), pose, wanted)
        except BaseException:
            with self._lock:
                self._labels.give_back(label)
            raise
        with self._lock:
            # Under the lock, so that tiles are given in the order of spawning.
            cameras = self._place_cameras(description, label, robot)
            vehicle = Vehicle(
                label,
                description,
                self._simulation.body(robot),
                sensors,
                lambda: self.remove(vehicle),
                cameras,
                self.board,
                placed,
            )
            self._vehicles[robot] = vehicle
            self._changes += 1
        if placed.position != pose.position:
            _log.info("spawn place was blocked, moved", robot=label, to=placed.position)
        return vehicle

    def object_facts(self, name: str, snapshot: Snapshot) -> ObjectFacts | None:
        """Facts at a snapshot about what a ray hit; a robot bears its label. None: no such thing.

        Args:
            name: as in `RayHits.names`, or what a world controller calls an object.
            snapshot: the instant.
        """
        facts = self._simulation.object_facts(name, snapshot)
        if facts is None:
            number = self._number_of_thing(name)
            facts = None if number is None else self._simulation.object_facts(number, snapshot)
        if facts is None or facts.robot is None:
            return facts
        with self._lock:
            vehicle = self._vehicles.get(facts.robot)
        label = vehicle.name if vehicle else self._label_of_thing(facts.robot)
        return facts if label is None else replace(facts, name=label)

    def call_things(
        self, label: Callable[[int], str | None], number: Callable[[str], int | None]
    ) -> None:
        """Have facts about what is no robot name it, and found by its name.

        Args:
            label: its name, by its number in the simulation.
            number: the other way round.
        """
        self._label_of_thing, self._number_of_thing = label, number

    def find(self, name: str) -> Vehicle | None:
        """The vehicle with a label, whatever its case; None if there is none."""
        wanted = name_key(name)
        return next((one for one in self.vehicles if name_key(one.name) == wanted), None)

    def lit(self, robot: int) -> bool:
        """Whether the headlight of a robot, by its number in the simulation, is on."""
        vehicle = self._vehicles.get(robot)
        return vehicle is not None and vehicle.power.lit

    def marks(self, robot: int) -> frozenset[str]:
        """What onlookers are told of a robot, by its number: `lit` and `stuck` where it is so."""
        vehicle = self._vehicles.get(robot)
        if vehicle is None:
            return frozenset()
        marks = {"lit": vehicle.power.lit, "stuck": vehicle.watch.stuck}
        return frozenset(mark for mark, on in marks.items() if on)

    def move(self, name: str, change: Callable[[Pose], Pose]) -> bool:
        """Put a vehicle somewhere else, at rest, or beside it; whether there is one.

        Args:
            name: its label, in any case.
            change: makes the wanted pose from the present one.

        Raises:
            SpawnError: if the pose cannot be used.
        """
        vehicle = self.find(name)
        state = None if vehicle is None else vehicle.body.look()
        if vehicle is None or state is None:
            return False
        self._simulation.move(vehicle.robot, change(state.pose))
        return True

    def ways_home(self) -> list[tuple[str, Callable[[], bool]]]:
        """Names of all vehicles, and what puts each back to where it was spawned, at rest, or
        beside: whether it stands there. That raises `SpawnError` if there is no room."""

        def way(one: Vehicle) -> Callable[[], bool]:
            def go() -> bool:
                placed = self._simulation.move(one.robot, one.home)
                return math.dist(placed.position, one.home.position) < AT_HOME

            return go

        return [(one.name, way(one)) for one in self.vehicles]

    def remove(self, vehicle: Vehicle) -> None:
        """Take a vehicle out of the world; a second call does nothing."""
        with self._lock:
            if self._vehicles.pop(vehicle.robot, None) is None:
                return
            self._changes += 1
            self._labels.give_back(vehicle.name)
            self.board.remove_robot(vehicle.robot)
        self._simulation.remove(vehicle.robot)

    def _place_cameras(
        self, description: RobotDescription, label: str, robot: int
    ) -> tuple[int, ...]:
        """Put the cameras of a new robot on the board."""
        return tuple(
            self.board.add(
                camera.name,
                label,
                robot,
                camera.link,
                camera.pose,
                camera.fov,
                camera.rate,
                camera.size,
            ).key
            for camera in description.cameras
        )

    def _sensors(self, description: RobotDescription, order: int) -> list[Sensor]:
        made = [
            create_sensor(
                item,
                SensorContext(
                    robot=description,
                    world=self._world,
                    rng=self._rng(order, index),
                    objects=self.object_facts,
                    surroundings=self._surroundings,
                    smoke=self._smoke,
                ),
            )
            for index, item in enumerate(description.items)
        ]
        return [one for one in made if self._truth or one.wire_type != TRUE_POSE]

    def _rng(self, order: int, index: int) -> np.random.Generator:
        return np.random.default_rng(
            np.random.SeedSequence(entropy=self._seed, spawn_key=(order, index))
        )

    def _model(self, description: RobotDescription) -> RobotModel:
        with self._lock:
            model = self._models.get(description.model)
            if model is None:
                model = robot_model(description)
                self._models[description.model] = model
            return model


def _unknown(name: str) -> int | None:
    return None


def _nameless(number: int) -> str | None:
    """Labels of a world that holds robots only."""
    return None


def robot_model(description: RobotDescription) -> RobotModel:
    """What the simulation has to know of a class.

    Raises:
        RobotDescriptionError: if an effector's type or parameters are wrong.
    """
    effectors = create_effectors(description)
    family = description.family
    return RobotModel(
        key=description.model,
        build=lambda: build_spec(description),
        driven=tuple(wheel.name for wheel in description.driven_wheels),
        rest_height=description.rest_height,
        wheel_acceleration=description.drive.wheel_acceleration,
        brake_delay=description.drive.parking_brake_delay,
        wheel_deceleration=description.drive.wheel_deceleration,
        joints=tuple(
            JointModel(
                link.joint, link.max_speed, link.max_torque if link.coupling is None else 0.0
            )
            for link in description.links
        ),
        hands=tuple(effector.hand() for effector in effectors),
        tools=tuple(
            _tool(effector, effectors) for effector in effectors if effector.description.detached
        ),
        anchored=family.anchored,
        laws=family.laws(description),
    )


def _tool(tool: Effector, effectors: Sequence[Effector]) -> ToolModel:
    """A loose effector lies where its file says, or sits where it is held from the start."""
    for holder in effectors:
        if holder.first_tool == tool.name:
            item = holder.description.item
            place = tool.robot.home_pose(item.link) @ item.pose @ holder.hand().tip
            return ToolModel(tool.name, place, holder.name)
    return ToolModel(tool.name, tool.description.item.pose)
