"""The cameras of one robot as its pilot uses them: CONF, GEO, SET, and what comes unasked.

Viewports: in the original they were the parts of the screen that shows one robot. Here they are
the tiles of the robot, as many as it has cameras with a tile: viewport k is its tile number k from
the lowest on. `SingleView` shows the camera of viewport 1 on the first tile and leaves the others
black; `QuadView` shows the first four. So a client that looks at the robot's first tile sees
whatever camera it has chosen, as it did in the original.
"""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Callable, Sequence

from usarsim_server.base.logs import Log
from usarsim_server.cameras.board import CameraBoard
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import FACETS, sends_results
from usarsim_server.protocol.messages import CameraItem, SensorMount
from usarsim_server.protocol.numbers import read_number
from usarsim_server.protocol.requests import Set
from usarsim_server.protocol.values import LONGEST_NAME, Dialect
from usarsim_server.robots.description import CameraDescription, RobotDescription
from usarsim_server.robots.mounting import carried
from usarsim_server.simulation.frames import wire_from_pose
from usarsim_server.simulation.snapshot import RobotBody

_log = Log("cameras")

CAMERA = "Camera"
"""Type on the wire."""

VIEWPORTS = 4

_LENS_OPCODES = frozenset({"ZOOM", "FOV"})
_CONFIGS = {"singleview": True, "0": True, "quadview": False, "1": False}
_NOTHING = frozenset({"", "disable", "disabled", "none"})


class CameraMount:
    """Everything that is said and asked about the cameras of a robot; used by one thread."""

    def __init__(
        self,
        robot: RobotDescription,
        number: int,
        keys: Sequence[int],
        board: CameraBoard,
        look: Callable[[], RobotBody | None],
    ) -> None:
        """Take over cameras that are on the board.

        Args:
            robot: the class.
            number: of the robot in the simulation.
            keys: of its cameras on the board, in mount order.
            board: all cameras of the world.
            look: the present state; None if the robot has left the world.
        """
        self._robot = robot
        self._number = number
        self._board = board
        self._look = look
        self._keys = tuple(keys)
        self._lenses = dict(zip(self._keys, robot.cameras, strict=True))
        self._told = False
        self._single = len(self._keys) <= 1
        shown = self._keys[: min(VIEWPORTS, len(board.tiles(number)))]
        self._viewports: list[int | None] = [*shown, *[None] * (VIEWPORTS - len(shown))]

    @property
    def view(self) -> int:
        """Number of the robot's first tile for STA, -1 if it has none (protocol reference 4.3)."""
        return next(iter(self._board.tiles(self._number)), -1) if self._keys else -1

    # -- answers -----------------------------------------------------------------------------

    def configuration(self, wire_type: str, name: str | None, dialect: Dialect) -> str:
        """The answer to GETCONF, empty if there is none."""
        echo = wire_type.strip() if FACETS[dialect].camera_in_degrees else CAMERA
        found = self._find(wire_type, name)
        return messages.camera_configuration(dialect, echo, [self._item(k, dialect) for k in found])

    def geometry(self, wire_type: str, name: str | None, dialect: Dialect) -> str:
        """The answer to GETGEO, empty if there is none."""
        mounts = []
        for key in self._find(wire_type, name):
            camera = self._lenses[key]
            pose, mount, link = carried(camera.pose, camera.link, self._robot, dialect)
            mounts.append(SensorMount(camera.name, *wire_from_pose(pose), mount, link))
        return messages.sensor_geometry(dialect, CAMERA, mounts)

    def take_news(self, time: float, dialect: Dialect) -> list[str]:
        """What the client is told unasked when its cameras got their tiles; once, then nothing.

        In `udk` that is CONF, camera by camera, as in the original; `ut2004` knew no such line.
        """
        if self._told:
            return []
        self._told = True
        views = [view for view in map(self._board.get, self._keys) if view is not None]
        tiled = [view for view in views if view.tile is not None]
        if not FACETS[dialect].camera_in_degrees:
            return [messages.status_change(time, "CameraTile", CAMERA, view.name) for view in tiled]
        return [
            messages.camera_configuration(dialect, CAMERA, [self._item(view.key, dialect)])
            for view in tiled
        ]

    def _find(self, wire_type: str, name: str | None) -> list[int]:
        if wire_type.strip().lower() != CAMERA.lower():
            return []
        wanted = None if name is None else name.strip().lower()
        return [
            key
            for key, camera in self._lenses.items()
            if wanted is None or camera.name.lower() == wanted
        ]

    def _item(self, key: int, dialect: Dialect) -> CameraItem:
        camera, view, grid = self._lenses[key], self._board.get(key), self._board.grid
        tile = None if view is None else view.tile
        place = grid.region(tile or 0, camera.size)
        fov = camera.fov if view is None else view.fov
        angle = _in_whole_degrees if FACETS[dialect].camera_in_degrees else float
        return CameraItem(
            name=camera.name,
            offset=(place.x, place.y),
            resolution=(place.width, place.height),
            default_fov=angle(camera.fov),
            min_fov=angle(camera.min_fov),
            max_fov=angle(camera.max_fov),
            fov=angle(fov),
        )

    # -- SET ---------------------------------------------------------------------------------

    def set(self, request: Set, dialect: Dialect) -> list[str]:
        """Obey a SET to cameras or viewports; returns the RES lines, none if nobody is meant."""
        match request.type.strip().lower():
            case "camera":
                return self._results(self._set_camera(request, dialect), dialect)
            case "viewports" if sends_results(dialect):
                # The other generation took the command and did nothing.
                return self._set_viewports(request)
        return []

    def _set_camera(self, request: Set, dialect: Dialect) -> list[tuple[str, bool]]:
        """Names and success of what obeyed."""
        bound = bind_view(self._board, request)
        if bound is not None:
            return [((request.name or "")[:LONGEST_NAME], bound)]
        if request.opcode not in _LENS_OPCODES:
            return []
        wanted = read_number(request.params)
        found = self._find(request.type, request.name)
        for key in found:
            self._board.set_fov(key, _zoomed(self._lenses[key], wanted, dialect))
        return [(self._lenses[key].name, True) for key in found]

    def _results(self, results: Sequence[tuple[str, bool]], dialect: Dialect) -> list[str]:
        state = self._look() if results and sends_results(dialect) else None
        if state is None:
            return []
        return [messages.result(state.time, CAMERA, name or None, ok) for name, ok in results]

    # -- viewports ---------------------------------------------------------------------------

    def _set_viewports(self, request: Set) -> list[str]:
        config, known = request.get("Config"), True
        if config is not None:
            single = _CONFIGS.get(config.strip().lower())
            known = single is not None
            self._single = self._single if single is None else single
        told = [self._set_viewport(index, request) for index in range(VIEWPORTS)]
        tiles = len(self._board.tiles(self._number))
        shown = self._viewports[:1] if self._single else [*self._viewports, *self._keys[VIEWPORTS:]]
        self._board.show(self._number, shown[:tiles])
        state = self._look()
        name = "SingleView" if self._single else "QuadView"
        return [] if state is None else [messages.viewports_result(state.time, told, (name, known))]

    def _set_viewport(self, index: int, request: Set) -> tuple[str, bool]:
        """Choose what a viewport shows; returns what the reply says of it."""
        if self._single and index > 0:
            return "Disabled", True
        wanted = request.get(f"Viewport{index + 1}")
        if wanted is None:
            key = self._viewports[index]
            return ("Disabled" if key is None else self._lenses[key].name), True
        if wanted.strip().lower() in _NOTHING:
            self._viewports[index] = None
            return "Disabled", True
        found = self._find(CAMERA, wanted)
        if not found:
            return "None", False
        name = self._lenses[found[0]].name
        if index >= len(self._board.tiles(self._number)):
            return name, False
        self._viewports[index] = found[0]
        return name, True


def bind_view(board: CameraBoard, request: Set) -> bool | None:
    """Obey `SET {Type Camera} {Robot r} {Name c} {Client address}`, which any connection may send.

    From then on the client of the picture port at that address sees this camera; without Robot it
    sees everything again. Any name means the only camera of a robot that has one. The original had
    no loopback addresses here; they are as good as others.

    Returns:
        Whether there are such a camera and such an address; None if this is another request.
    """
    client = request.get("Client")
    if request.type.strip().lower() != CAMERA.lower() or request.opcode is not None:
        return None
    if client is None:
        return None
    try:
        address = str(ipaddress.ip_address(client.strip()))
    except ValueError:
        return False
    robot = request.get("Robot")
    if not robot:
        board.bind(address, None)
        return True
    name = request.name or ""
    camera = board.find(name, robot)
    if camera is None:
        return False
    if camera.name.lower() != name.strip().lower():
        _log.info(f"no camera {name!r}: the robot's only one is taken", camera=camera.name)
    board.bind(address, camera.key)
    return True


def _in_whole_degrees(angle: float) -> float:
    """An angle (rad) in the unit of that generation's lenses (side channels reference 2.11)."""
    return math.radians(round(math.degrees(angle)))


def _zoomed(camera: CameraDescription, wanted: float, dialect: Dialect) -> float:
    """Field of view (rad) after a SET: within the limits, the default for zero."""
    if FACETS[dialect].camera_in_degrees:
        wanted = _in_whole_degrees(wanted)
    return min(max(wanted, camera.min_fov), camera.max_fov) if wanted else camera.fov
