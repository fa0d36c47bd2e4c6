"""Who changes the world, and people who walk about in it."""

from __future__ import annotations

from collections.abc import Sequence

from usarsim_client import commands, reports
from usarsim_client.commands import say
from usarsim_client.link import only
from usarsim_client.participant import Participant
from usarsim_client.streams import Stream
from usarsim_server.protocol.values import Vector


class WorldController(Participant):
    """Creates, moves and removes objects; they leave when it is closed.

    Metres, radians, frame of the wire; places are those of the middle of an object. Servers
    refuse silently what cannot be done; `objects` tells what there is.
    """

    async def create(
        self,
        class_name: str,
        name: str,
        location: Vector,
        rotation: Vector = (0.0, 0.0, 0.0),
        *,
        scale: Vector | None = None,
        physics: str | None = None,
        memory: str | None = None,
        permanent: bool | None = None,
        material: str | None = None,
    ) -> None:
        """Make an object.

        Args:
            class_name: as Box or WCCrate.
            name: that no other object has.
            location, rotation: where.
            scale: of its three axes.
            physics: None, RigidBody, Falling or Ground.
            memory: text to find it by. permanent: survives `kill_all`. material: of its surface.
        """
        place = {"ClassName": class_name, "Name": name, "Location": location, "Rotation": rotation}
        looks = {"Scale": scale, "Physics": physics, "Permanent": permanent, "Material": material}
        await self._control("Create", **place, **looks, Memory=memory)

    async def kill(self, name: str) -> None:
        """Remove an object."""
        await self._control("Kill", Name=name)

    async def kill_all(self, corners: tuple[Vector, Vector] | None = None) -> None:
        """Remove all objects that are not permanent, or those within a box."""
        low, high = corners or (None, None)
        await self._control("KillAll", MinPos=low, MaxPos=high)

    async def move(
        self,
        name: str,
        location: Vector | None = None,
        rotation: Vector | None = None,
        relative: bool = False,
    ) -> None:
        """Put an object or a robot elsewhere; what is not given stays. relative: add instead."""
        kind = "RelMove" if relative else "AbsMove"
        await self._control(kind, Name=name, Location=location, Rotation=rotation)

    async def rotate(self, name: str, speed: Vector) -> None:
        """Turn an object for ever, roll, pitch, yaw in rad/s; zeros end it."""
        await self._control("Rotate", Name=name, Speed=speed)

    async def follow(
        self,
        name: str,
        way_points: Sequence[Vector],
        speed: float = 1.0,
        loop: bool = False,
        reset_on_clear: bool | None = None,
    ) -> None:
        """Let an object move along way points, behind those that it has, at so many m/s."""
        await self._control(
            "SetWP", Name=name, Speed=float(speed), Loop=loop, ResetOnClear=reset_on_clear
        )
        await self.link.send(commands.way_points(name, way_points))

    async def halt(self, name: str) -> None:
        """Drop the way points of an object."""
        await self._control("ClearWP", Name=name)

    async def conveyor(self, name: str, speed: float) -> None:
        """Let a belt run at so many times its usual speed."""
        await self._control("Conveyor", Name=name, Speed=float(speed))

    async def objects(
        self, name: str | None = None, class_name: str | None = None
    ) -> tuple[reports.ObjectStatus, ...]:
        """All objects there are, or those of a name or a class."""
        question = say("CONTROL", Type="GetSTA", Name=name, ClassName=class_name)
        return (await self.link.ask(question, only(reports.ObjectList))).objects

    async def _control(self, kind: str, **segments: object) -> None:
        await self.link.send(say("CONTROL", Type=kind, **segments))


class Avatar(Participant):
    """A person who walks along the path nodes of a world."""

    def statuses(self, keep: int = 0) -> Stream[reports.AvatarStatus]:
        """Where it is."""
        return self.stream(reports.AvatarStatus, keep=keep)

    async def walk(
        self, to: tuple[float, float], gait: str = "Walk_Forward", append: bool = False
    ) -> None:
        """Go to a place, x and y in m, at once or behind what it does.

        Args:
            to: where.
            gait: Walk_Forward, Walk_Backward or Run.
            append: after the way that it has.
        """
        action = "Append" if append else "New"
        await self.link.send(say("MOVE", Type=gait, Action=action, Location=to))

    async def pause(self, paused: bool = True) -> None:
        """Stand still, or go on."""
        await self.link.send(say("MOVE", Action="Pause" if paused else "Resume"))

    async def go_to(self, node: str) -> None:
        """Go to a path node."""
        await self.link.send(say("GOTO", Name=node))
