"""What a connection does that controls the world: CONTROL (protocol reference 3.14).

Only GetSTA answers. Whatever cannot be done is refused silently on the wire and told in the log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.numbers import read_bool, read_number, read_triple
from usarsim_server.protocol.requests import Control, Request
from usarsim_server.protocol.values import Dialect, name_key, near
from usarsim_server.sessions.robots import Robots
from usarsim_server.sessions.schedule import Role
from usarsim_server.simulation.frames import (
    Pose,
    Vector,
    flip_point,
    pose_from_wire,
    wire_from_pose,
)
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.objects.objects import WorldObjects
from usarsim_server.worlds.objects.world_object import Creation, Physics

CLASS_NAME = "worldcontroller"


def is_world_controller(class_name: str) -> bool:
    """Whether INIT with this class, without its package, makes a world controller
    (protocol 3.2)."""
    return class_name.lower() == CLASS_NAME


class WorldController(Role):
    """Carries out the CONTROL requests of one connection, in their order.

    Attributes:
        slow: what it is told to create may have to be compiled.
    """

    slow = True
    name = "WorldController"
    dialect = Dialect.UT2004

    def __init__(
        self,
        objects: WorldObjects,
        robots: Robots,
        world: WorldDescription,
        simulation: Simulation,
        clean_on_close: bool,
        log: Log,
    ) -> None:
        """Take over the objects that will be created here.

        Args:
            objects: of the world, shared with other controllers.
            robots: for moving robots.
            world: for start poses.
            simulation: for conveyors.
            clean_on_close: remove what this connection created when it goes.
            log: names the connection.
        """
        self._objects = objects
        self._robots = robots
        self._world = world
        self._simulation = simulation
        self._clean_on_close = clean_on_close
        self._log = log
        self._handlers: Mapping[str, Callable[[Control], list[str] | None]] = {
            "create": self._create,
            "kill": self._kill,
            "killall": self._kill_all,
            "absmove": self._abs_move,
            "relmove": self._rel_move,
            "rotate": self._rotate,
            "setwp": self._set_path,
            "addwp": self._add_points,
            "clearwp": self._clear_path,
            "getsta": self._status,
            "conveyor": self._conveyor,
        }

    # -- the role of a connection ------------------------------------------------------------

    def obey(self, request: Request) -> list[str]:
        if not isinstance(request, Control):
            self._log.debug("a world controller ignores", request=type(request).__name__)
            return []
        handler = self._handlers.get(request.type.lower())
        if handler is None:
            hint = near(request.type, self._handlers)
            self._log.info(f"unknown CONTROL ignored{hint}", type=request.type)
            return []
        try:
            return handler(request) or []
        except UsarsimError as error:
            self._log.info(f"CONTROL refused: {error}", type=request.type, name=_name(request))
            return []

    def leave(self) -> None:
        if self._clean_on_close:
            count = self._objects.leave(self)
            self._log.debug("objects removed with their controller", count=count)

    # -- one handler per type ----------------------------------------------------------------

    def _create(self, request: Control) -> None:
        pose = self._place(request)
        if pose is None:
            self._log.info("CONTROL refused: unknown start", start=request.get("Start"))
            return
        created = self._objects.create(
            Creation(
                class_name=(request.get("ClassName") or "").rpartition(".")[2],
                name=_name(request) or None,
                pose=pose,
                scale=_scale(_vector(request, "Scale")),
                physics=_physics(request.get("Physics")),
                material=request.get("Material") or None,
                memory=request.get("Memory") or "",
                permanent=bool(_boolean(request, "Permanent")),
            ),
            owner=self,
        )
        self._log.debug("object created", name=created.name, object_class=created.kind.name)

    def _place(self, request: Control) -> Pose | None:
        """Where an object shall be; None for an unknown start."""
        tag = request.get("Start")
        if tag:
            start = self._world.start(tag)
            return None if start is None else start.pose
        zero = (0.0, 0.0, 0.0)
        return pose_from_wire(
            _vector(request, "Location") or zero, _vector(request, "Rotation") or zero
        )

    def _kill(self, request: Control) -> None:
        self._tell_unless(self._objects.kill(_name(request)), request)

    def _kill_all(self, request: Control) -> None:
        one, other = _vector(request, "MinPos"), _vector(request, "MaxPos")
        if (one is None) != (other is None):
            # Taking half a box for none would remove everything.
            self._log.info("CONTROL refused: KillAll needs both corners, or none")
            return
        count = self._objects.kill_all(None if one is None or other is None else (one, other))
        self._log.debug("objects removed", count=count)

    def _abs_move(self, request: Control) -> None:
        location, rotation = _vector(request, "Location"), _vector(request, "Rotation")

        def change(pose: Pose) -> Pose:
            here, turned = wire_from_pose(pose)
            return pose_from_wire(
                here if location is None else location, turned if rotation is None else rotation
            )

        self._move(request, change)

    def _rel_move(self, request: Control) -> None:
        zero = (0.0, 0.0, 0.0)
        location = _vector(request, "Location") or zero
        rotation = _vector(request, "Rotation") or zero

        def change(pose: Pose) -> Pose:
            here, turned = wire_from_pose(pose)
            return pose_from_wire(_sum(here, location), _sum(turned, rotation))

        self._move(request, change)

    def _move(self, request: Control, change: Callable[[Pose], Pose]) -> None:
        name = _name(request)
        found = self._objects.move(name, change) or self._robots.move(name, change)
        self._tell_unless(found, request)

    def _rotate(self, request: Control) -> None:
        rates = _vector(request, "Speed") or (0.0, 0.0, 0.0)
        self._tell_unless(self._objects.rotate(_name(request), rates), request)

    def _set_path(self, request: Control) -> None:
        found = self._objects.set_path(
            _name(request),
            speed=_number(request, "Speed"),
            loop=_boolean(request, "Loop"),
            moving=_boolean(request, "Moving"),
            reset_on_clear=_boolean(request, "ResetOnClear"),
            clock=_number(request, "Time"),
        )
        self._tell_unless(found, request)

    def _add_points(self, request: Control) -> None:
        texts = (request.get("WP") or "").split(";")
        points = [flip_point(read_triple(text)) for text in texts if text.strip()]
        self._tell_unless(self._objects.add_points(_name(request), points), request)

    def _clear_path(self, request: Control) -> None:
        self._tell_unless(self._objects.clear_path(_name(request)), request)

    def _status(self, request: Control) -> list[str]:
        name = name_key(_name(request))
        kind = (request.get("ClassName") or "").rpartition(".")[2].strip().lower()
        entries = []
        for one, pose in self._objects.present():
            names = (one.kind.name.lower(), *(alias.lower() for alias in one.kind.aliases))
            if (not name or name_key(one.name) == name) and (not kind or kind in names):
                location, rotation = wire_from_pose(pose)
                entries.append(
                    messages.ObjectStatus(
                        name=one.name,
                        size=one.size,
                        location=location,
                        rotation=rotation,
                        memory=one.memory,
                    )
                )
        return [messages.object_status(entries)]

    def _conveyor(self, request: Control) -> None:
        factor = _number(request, "Speed")
        belts = self._simulation.run_belts(_name(request), 0.0 if factor is None else factor)
        self._tell_unless(belts > 0, request)

    def _tell_unless(self, done: bool, request: Control) -> None:
        if not done:
            name = _name(request)
            names = [one.name for one, _ in self._objects.present()]
            hint = near(name, names + [one.name for one in self._robots.vehicles])
            self._log.info(f"CONTROL ignored: no such name{hint}", type=request.type, name=name)


# -- reading segments ----------------------------------------------------------------------------


def _name(request: Control) -> str:
    return (request.get("Name") or "").strip()


def _vector(request: Control, key: str) -> Vector | None:
    """Three numbers; None if missing or empty."""
    return request.read(key, read_triple) if request.get(key) else None


def _number(request: Control, key: str) -> float | None:
    return request.read(key, read_number)


def _boolean(request: Control, key: str) -> bool | None:
    return request.read(key, read_bool)


def _scale(factors: Vector | None) -> Vector:
    """0 and missing factors stand for 1 (protocol 3.14)."""
    x, y, z = (abs(factor) or 1.0 for factor in factors or (0.0, 0.0, 0.0))
    return x, y, z


def _physics(text: str | None) -> Physics:
    """Anything unknown is none (protocol 3.14)."""
    wanted = (text or "").strip().lower()
    return next((one for one in Physics if one.value == wanted), Physics.NONE)


def _sum(one: Vector, other: Vector) -> Vector:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]
