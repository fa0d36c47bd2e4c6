"""The program of one robot: port 3000, in lockstep; lines out, the newest readings in."""

from __future__ import annotations

import contextlib
import math
from typing import TypeVar

import numpy as np

from usarsim_client import BlockingConnection, HangupError, decode
from usarsim_client.commands import say
from usarsim_client.inbox import Line
from usarsim_client.readings import INS, GroundTruth, LaserScan, Odometry
from usarsim_client.reports import (
    Event,
    Geometry,
    VehicleConfiguration,
    VehicleGeometry,
)
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.localisation.poses import Pose, wrap
from usarsim_exploration.localisation.surfaces import Floats

Kind = TypeVar("Kind")
_PATIENCE = 60.0
"""s of wall time that a server may take for a tick."""
_ENTERING = 20.0
"""s of wall time within which a robot comes into the world."""
_LEVEL = 0.025
"""rad of pitch and roll from which a scanner 0.3 m above the floor sees that within 12 m."""
_TICK = b"NFO {Status Tick}"
_HEADS = {
    b"{Type RangeScanner}": "scan",
    b"{Type GroundTruth}": "truth",
    b"{Type Odometry}": "odometry",
    b"{Type INS}": "inertial",
}


class DeadError(Exception):
    """A robot has left the world, or its server has."""


class Controller:
    """Drives one robot, or keeps a station in the world.

    Attributes:
        name: on the wire. mount: m that the scanner sits ahead of the middle.
        top: fastest speed, m/s; NaN: it does not say. ranges, angles: of the newest scan, m and rad
            to the right; none before the first. fresh: they came in the last tick, level.
    """

    def __init__(self, host: str, port: int, name: str, kind: str, skid: float) -> None:
        """Connect; `enter` brings it into the world.

        Args:
            kind: class of the robot. skid: it turns as if its track were so much wider.
        """
        self.name, self._kind, self._skid = name, kind, skid
        self.mount, self.top = 0.0, math.nan
        self._radius, self._track = 0.098, 0.36
        self.ranges: Floats = np.empty(0)
        self.angles: Floats = np.empty(0)
        self.fresh = False
        self._lines: dict[str, list[tuple[bytes, bytes]]] = {}  # by kind: time and line
        self._seen = b""
        self.link = BlockingConnection(port, host, _PATIENCE)

    def enter(self, x: float, y: float, z: float, yaw: float) -> None:
        """Come into the world, and wait for the tick. x, y, z: m. yaw: rad, all of the wire.

        Raises:
            ExplorationError: the server does not let it in.
        """
        init = say("INIT", ClassName=f"USARBot.{self._kind}", Name=self.name,
                   Location=(x, y, z), Rotation=(0.0, 0.0, yaw))  # fmt: skip
        try:
            self.link.send(init)
            self.link.socket.settimeout(_ENTERING)  # who is refused is often told nothing
            self._hear()
            self.link.socket.settimeout(_PATIENCE)
        except (DeadError, OSError) as error:
            cure = f"has the server a class {self._kind}, is there room, is it in lockstep?"
            problem = f"{self.name} did not come into the world"
            raise ExplorationError(f"{problem}: {error} ({cure})") from error

    def learn(self) -> None:
        """Ask what the robot is; answers come before the next tick."""
        for what in ("GETCONF {Type Robot}", "GETGEO {Type Robot}", "GETGEO {Type RangeScanner}"):
            self.link.send(f"{what}\r\n".encode())

    def release(self, speed: float = 0.0, turn: float = 0.0, *, drive: bool = True) -> None:
        """Give the wheels a speed, m/s and rad/s to the right, and let the world go on."""
        text = b""
        if drive:
            across = turn * self._skid * self._track / 2
            left, right = (speed + across) / self._radius, (speed - across) / self._radius
            text = say("DRIVE", Left=round(left, 4), Right=round(right, 4), Normalized=False)
        try:
            self.link.send(text + b"SYNC\r\n")
        except OSError as error:
            raise DeadError(str(error)) from error

    def collect(self) -> None:
        """Read up to the next tick.

        Raises:
            DeadError: the robot or the server is gone.
        """
        self._lines.clear()
        self._hear()
        self.fresh = False
        if "scan" in self._lines:
            self._seen, newest = self._lines["scan"][-1]
            self.fresh = self._upright()
            scan = _one(newest, LaserScan)
            if len(scan.ranges) != len(self.angles):
                self.angles = np.asarray(scan.bearings)
            self.ranges = np.asarray(scan.ranges)

    def truth(self, *, seen: bool = False) -> Pose | None:
        """Where it truly is, in the frame of the wire; None: it was not told.

        Args:
            seen: at the time of the newest scan, not now.
        """
        line = self._line("truth", seen=seen)
        if line is None:
            return None
        told = _one(line, GroundTruth)
        return told.location[0], told.location[1], told.orientation[2]

    def odometry(self, *, seen: bool = False) -> Pose | None:
        """Where its wheels say that it is, as seen from its start; else as `truth`."""
        line = self._line("odometry", seen=seen)
        if line is None:
            return None
        told = _one(line, Odometry)
        return told.x, told.y, told.theta

    def inertial(self) -> Pose | None:
        """Where its INS says that it was at the newest scan, in a frame of its own."""
        told = self._ins()
        if told is None:
            return None
        return told.location[0], told.location[1], told.orientation[2]

    def align(self) -> None:
        """Have its INS begin where it is; unasked, that waits until the robot stands still."""
        told = self._ins()
        if told is not None:
            pose = (*told.location, *told.orientation)
            line = say("SET", Type="INS", Name=told.name, Opcode="POSE", Params=pose)
            self.link.send(line)

    def _upright(self) -> bool:
        """Whether the newest scan was level; who bumps into others pitches, and sees the floor."""
        told = self._ins()
        return told is None or max(abs(wrap(angle)) for angle in told.orientation[:2]) < _LEVEL

    def _ins(self) -> INS | None:
        line = self._line("inertial", seen=True)
        return None if line is None else _one(line, INS)

    def _line(self, kind: str, *, seen: bool) -> bytes | None:
        lines = self._lines.get(kind, [])
        if seen:
            lines = [one for one in lines if one[0] == self._seen]
        return lines[-1][1] if lines else None

    def close(self) -> None:
        """Leave the world."""
        with contextlib.suppress(OSError):
            self.link.close()

    def _hear(self) -> None:
        time = b""
        try:
            while not (raw := self.link.line().raw).startswith(_TICK):
                time = _time(raw) or time  # an INS tells none: that of the line before
                kind = next((name for mark, name in _HEADS.items() if mark in raw[:60]), "")
                if raw.startswith(b"SEN") and kind:
                    self._lines.setdefault(kind, []).append((time, raw))
                elif raw[:4] in (b"CONF", b"GEO ", b"NFO "):
                    self._told(Line(raw))
        except (HangupError, OSError) as error:
            raise DeadError(str(error)) from error

    def _told(self, line: Line) -> None:
        for value in decode(line.raw.rstrip()):
            match value:
                case VehicleConfiguration(max_speed=speed) if speed > 0.0:
                    self.top = speed * self._radius
                case VehicleGeometry(wheel_radius=radius, wheel_separation=track) if radius > 0.0:
                    self.top *= radius / self._radius
                    self._radius, self._track = radius, track
                case Geometry(type=kind, items=items) if kind == "RangeScanner" and items:
                    self.mount = items[0].location[0]
                case Event(event=event, reason=reason) if reason or "Battery" in event:
                    raise DeadError(reason or event)
                case _:
                    pass


def _time(line: bytes) -> bytes:
    """The value of Time, as it is written."""
    return line.partition(b"{Time ")[2].partition(b"}")[0]


def _one(line: bytes, kind: type[Kind]) -> Kind:
    for value in decode(line.rstrip()):
        if isinstance(value, kind):
            return value
    raise DeadError(f"the server says {line[:80]!r}")
