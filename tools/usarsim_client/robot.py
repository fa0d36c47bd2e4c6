"""A robot in the world: what it senses, what it is, and what it shall do."""

from __future__ import annotations

import math
import weakref
from collections.abc import Awaitable, Callable, Mapping

from usarsim_client import commands, readings, reports
from usarsim_client.cameras import Pictures, Tile
from usarsim_client.commands import say
from usarsim_client.link import Address, Link, Retry, only
from usarsim_client.participant import Participant
from usarsim_client.streams import Stream
from usarsim_server.protocol.values import Dialect


class Robot(Participant):
    """A robot; it leaves the world when it is closed.

    All values are in m, rad, s and the frame of the wire (x forward, y right, z down; `frames`
    converts). What a command makes a robot do it does until the next one: nothing in this
    protocol stops a robot whose program thinks, but `close` does.

    A command is sent when its method returns, not carried out; servers do not confirm it.
    All methods that send raise `HangupError` if the connection is gone, `TimeoutError` if the
    server takes nothing, and `ValueError` for what cannot be said.

    Attributes:
        class_name: as asked for.
    """

    def __init__(
        self, link: Link, name: str, class_name: str, images: Address, retry: Retry | None
    ) -> None:
        super().__init__(link, name)
        self.class_name = class_name
        self._images = images
        self._pictures = weakref.WeakSet[Pictures]()
        self._retry = retry
        self._stop = say("DRIVE", Left=0.0, Right=0.0, Normalized=False)

    @property
    def dialect(self) -> Dialect | None:
        """What the server speaks with this robot; None before its first status."""
        return self.state.dialect

    # -- sensing ------------------------------------------------------------------------------

    def scans(self, name: str = "", keep: int = 0) -> Stream[readings.LaserScan]:
        """Flat laser scans; arguments of all of these as in `stream`."""
        return self.stream(readings.LaserScan, name, keep)

    def odometry(self, name: str = "", keep: int = 0) -> Stream[readings.Odometry]:
        """Poses by the wheels."""
        return self.stream(readings.Odometry, name, keep)

    def truth(self, name: str = "", keep: int = 0) -> Stream[readings.GroundTruth]:
        """True poses."""
        return self.stream(readings.GroundTruth, name, keep)

    def statuses(self, keep: int = 0) -> Stream[reports.Status]:
        """Battery, light, steering, joints."""
        return self.stream(reports.Status, keep=keep)

    def missions(self, name: str = "", keep: int = 0) -> Stream[reports.MissionState]:
        """Positions of arms and pan-tilts."""
        return self.stream(reports.MissionState, name, keep)

    def sensors(self, name: str = "", keep: int = 1000) -> Stream[readings.Reading]:
        """Whatever any sensor reports, in order."""
        return self.stream(readings.Reading, name, keep)

    def pictures(self, camera: str = "", rate: float = 0.0, tile: Tile | None = None) -> Pictures:
        """What a camera sees, from the image port: `async for picture in robot.pictures()`.

        Args:
            camera: its name; empty: the first one.
            rate: pictures per s of wall time at most; 0: as fast as they come.
            tile: part of the picture of the image port; None: what the camera's CONF says, or all
                of it where that tells none (`ut2004`). A robot without such a camera makes the
                first picture fail with `NoAnswerError`.
        """

        async def find() -> Tile | None:
            return tile or (await self.camera(camera)).tile

        return self.through(find, rate)

    def through(self, find: Callable[[], Awaitable[Tile | None]], rate: float = 0.0) -> Pictures:
        """As `pictures`, of a tile that a function finds when it is needed."""
        pictures = Pictures(self._images, find, rate, self._retry)
        self._pictures.add(pictures)
        return pictures

    async def close(self) -> None:
        """Hang up; it leaves the world, and its pictures end."""
        for pictures in list(self._pictures):
            await pictures.close()
        await super().close()

    # -- what it is ---------------------------------------------------------------------------

    async def configuration(self, kind: str, name: str | None = None) -> reports.Configuration:
        """GETCONF of sensors, actuators or effectors.

        Args:
            kind: type, as `RangeScanner`, `MisPkg`, `Gripper`.
            name: of the item; None: all of the type.

        Raises:
            NoAnswerError: if the robot has none.
        """
        question = say("GETCONF", Type=kind, Name=name)
        return await self.link.ask(question, only(reports.Configuration))

    async def geometry(self, kind: str, name: str | None = None) -> reports.Geometry:
        """GETGEO of sensors, actuators or effectors; as `configuration`."""
        return await self.link.ask(say("GETGEO", Type=kind, Name=name), only(reports.Geometry))

    async def vehicle(self) -> reports.VehicleConfiguration:
        """GETCONF of the robot itself."""
        question = say("GETCONF", Type="Robot")
        return await self.link.ask(question, only(reports.VehicleConfiguration))

    async def dimensions(self) -> reports.VehicleGeometry:
        """GETGEO of the robot itself."""
        return await self.link.ask(say("GETGEO", Type="Robot"), only(reports.VehicleGeometry))

    async def camera(self, name: str = "") -> reports.CameraConfiguration:
        """GETCONF of a camera; of the first one without a name.

        Raises:
            NoAnswerError: if the robot has no such camera.
        """

        def accept(value: object) -> reports.CameraConfiguration | None:
            if isinstance(value, reports.CameraConfigurations):
                for one in value.cameras:
                    if one.name.lower() == name.lower() or not name:
                        return one
            return None

        return await self.link.ask(say("GETCONF", Type="Camera", Name=name or None), accept)

    # -- driving ------------------------------------------------------------------------------

    async def drive(
        self,
        *,
        left: float | None = None,
        right: float | None = None,
        speed: float | None = None,
        front_steer: float | None = None,
        rear_steer: float | None = None,
        normalized: bool = False,
    ) -> None:
        """Turn the wheels: skid steered robots with left and right, cars with speed and steering.

        Args:
            left, right: wheel speed of each side, rad/s, forward positive.
            speed: wheel speed of a car, rad/s.
            front_steer, rear_steer: rad, to the right positive; 0 if not given.
            normalized: speeds are parts of the greatest one, -1 to 1.
        """
        data = commands.drive(left, right, speed, front_steer, rear_steer, normalized)
        if speed is None:
            self._stop = say("DRIVE", Left=0.0, Right=0.0, Normalized=False)
        else:
            self._stop = commands.drive(None, None, 0.0, 0.0, 0.0, False)
        await self.link.send(data)

    async def stop(self) -> None:
        """Let the robot stand, or hover, by the form of command that drove it last."""
        await self.link.send(self._stop)

    async def wheels(
        self, targets: Mapping[int, tuple[float | None, float | None]], normalized: bool = False
    ) -> None:
        """Drive wheels that are steered one by one.

        Args:
            targets: speed (rad/s) and steering angle (rad) by wheel, from 0; None leaves it.
            normalized: speeds are parts of the greatest one, -1 to 1.
        """
        self._stop = commands.wheels(dict.fromkeys(targets, (0.0, None)), False)
        await self.link.send(commands.wheels(targets, normalized))

    async def fly(
        self,
        forward: float = 0.0,
        right: float = 0.0,
        up: float = 0.0,
        turn: float = 0.0,
        normalized: bool = False,
    ) -> None:
        """Fly; all zero hovers.

        Args:
            forward, right, up: m/s.
            turn: rad/s, clockwise seen from above. The dialects say it in different units:
                before the first status the `udk` one is assumed, in which aircraft were known.
            normalized: parts of the greatest speeds instead, -1 to 1.
        """
        degrees = not normalized and self.dialect is not Dialect.UT2004
        unit = 100.0 if normalized else 1.0
        self._stop = self._flight(0.0, 0.0, 0.0, 0.0, False)
        turned = math.degrees(turn) if degrees else turn * unit
        await self.link.send(
            self._flight(forward * unit, right * unit, up * unit, turned, normalized)
        )

    @staticmethod
    def _flight(forward: float, right: float, up: float, turn: float, normalized: bool) -> bytes:
        return say(
            "DRIVE",
            AltitudeVelocity=up,
            LinearVelocity=forward,
            LateralVelocity=right,
            RotationalVelocity=turn,
            Normalized=normalized,
        )

    async def dive(
        self,
        propeller: float = 0.0,
        rudder: float = 0.0,
        stern_plane: float = 0.0,
        normalized: bool = False,
    ) -> None:
        """Drive under water. propeller: rad/s, or -1 to 1. rudder, stern_plane: rad."""
        self._stop = say("DRIVE", Propeller=0.0, Rudder=0.0, SternPlane=0.0)
        unit = 100.0 if normalized else 1.0
        planes = {"Rudder": float(rudder), "SternPlane": float(stern_plane)}
        data = say("DRIVE", Propeller=propeller * unit, **planes, Normalized=normalized)
        await self.link.send(data)

    async def joint(self, name: str, value: float, order: int = 0) -> None:
        """Move a joint by name (DRIVE, `ut2004`). order: 0 rad or m, 1 their rates, 2 N m or N."""
        await self.link.send(say("DRIVE", Name=name, Value=float(value), Order=order))

    async def joints(self, targets: Mapping[str, float]) -> None:
        """Move joints by name at once (MULTIDRIVE): flippers `FRFlipper FLFlipper RRFlipper
        RLFlipper` and the like, rad."""
        values = {name: float(value) for name, value in targets.items()}
        await self.link.send(say("MULTIDRIVE", **values))

    async def leg(self, joint: str, angle: float) -> None:
        """Move a joint of a legged machine (SET, `udk`), rad; `AllJoints` moves all."""
        await self.set("Joint", joint, "Angle", float(angle))

    async def flip(self) -> None:
        """Put an overturned robot back on its wheels (`ut2004`)."""
        await self.link.send(say("DRIVE", Flip=True))

    async def light(self, on: bool) -> None:
        """Switch the headlight."""
        await self.link.send(say("DRIVE", Light=on))

    # -- items --------------------------------------------------------------------------------

    async def actuate(self, package: str, targets: Mapping[int, float], order: int = 0) -> None:
        """Move an arm, a pan-tilt, a mission package (MISPKG, in the form that all obey).

        Args:
            package: its name.
            targets: by link, from 1: rad or m.
            order: 0 positions, 1 speeds, 2 torques or forces.
        """
        await self.link.send(commands.links(package, targets, order))

    async def grip(self, name: str, closed: bool = True, kind: str = "Gripper") -> None:
        """Close or open a gripper, grab or release a tool (`kind="ToolChanger"`)."""
        await self.set(kind, name, "CLOSE" if closed else "OPEN")

    async def zoom(self, fov: float, camera: str | None = None) -> None:
        """Give a camera a field of view, rad; 0: its usual one."""
        await self.set("Camera", camera, "Zoom", float(fov))

    async def scan(self, name: str | None = None, kind: str = "RangeScanner") -> None:
        """Ask for one measurement now: scanners, Acoustic, and a whole RangeImager picture."""
        await self.set(kind, name, "SCAN")

    async def reset(self, name: str | None = None, kind: str = "Odometry") -> None:
        """Set counters to zero: Odometry, Encoder, Tachometer."""
        await self.set(kind, name, "RESET")

    async def set(
        self,
        kind: str,
        name: str | None = None,
        opcode: str | None = None,
        params: object = None,
    ) -> None:
        """SET in general. params: a number, a text, or numbers that are sent with commas."""
        await self.link.send(say("SET", Type=kind, Name=name, Opcode=opcode, Params=params))

    async def set_result(
        self,
        kind: str,
        name: str | None = None,
        opcode: str | None = None,
        params: object = None,
    ) -> reports.Result:
        """SET, and what became of it: only `ut2004` tells, as of reading and writing tags.

        Raises:
            NoAnswerError: if the server tells nothing.
        """
        question = say("SET", Type=kind, Name=name, Opcode=opcode, Params=params)
        return await self.link.ask(question, only(reports.Result))

    async def trace(
        self, on: bool = True, interval: float | None = None, color: str | None = None
    ) -> None:
        """Draw the way of the robot in the viewer of the original (`ut2004`). interval: s."""
        await self.link.send(say("TRACE", On=on, Interval=interval, Color=color))
