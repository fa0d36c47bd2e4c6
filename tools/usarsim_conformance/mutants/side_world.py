"""The world behind the side channels: robots that stand still, and a control port to make them."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from usarsim_conformance.mutants.ticks import Ticks

Handler = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]

_STATUS_PERIOD = 0.05
"""s between two status lines."""
_SPEED = 4.0
"""Simulated s per s, at most."""
_STARTS = {f"Start{n}": (float(3 * n), 0.0, -0.2) for n in range(1, 9)}
_SEGMENT = re.compile(r"\{([^{}]*)\}")


def groups_of(text: str) -> dict[str, str]:
    """Keys in lower case and values of what stands in braces; the first of equals counts."""
    found: dict[str, str] = {}
    for body in _SEGMENT.findall(text):
        key, _, value = body.strip().partition(" ")
        found.setdefault(key.lower(), value.strip())
    return found


@dataclass(eq=False)
class MiniRobot:
    """A robot that stands where it was put.

    Attributes:
        name: of INIT. class_name: without package.
        location: wire frame, m. index: of its object name. tile: number in the frame.
        fov: degrees.
    """

    name: str
    class_name: str
    location: tuple[float, float, float]
    index: int
    tile: int
    fov: float = 80.0


@dataclass
class MiniWorld:
    """Robots, time, and what is wrong.

    Attributes:
        faults: names of faults, as in `side_faults.FAULTS`.
        robots: in spawn order.
        ticks: simulated time.
    """

    faults: frozenset[str] = frozenset()
    robots: list[MiniRobot] = field(default_factory=list)
    ticks: Ticks = field(default_factory=lambda: Ticks(_STATUS_PERIOD, _SPEED))
    _made: int = 0

    def has(self, fault: str) -> bool:
        """Whether a fault is wanted."""
        return fault in self.faults

    @property
    def time(self) -> float:
        """Simulated s."""
        return self.ticks.time

    def named(self, name: str) -> MiniRobot | None:
        """A robot by its name in any case."""
        fits = [robot for robot in self.robots if robot.name.lower() == name.lower()]
        if self.has("groundtruth-lookup-case"):
            fits = [robot for robot in fits if robot.name == name]
        return fits[0] if fits else None

    async def control(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one controller."""
        writer.write(b"NFO {Gametype BotDeathMatch} {Level mini} {TimeLimit 0}\r\n")
        robot: MiniRobot | None = None
        status: asyncio.Task[None] | None = None
        try:
            while line := (await reader.readline()).decode("latin-1").strip():
                if line.startswith("INIT") and robot is None:
                    robot = self._spawn(groups_of(line))
                    writer.write(_conf(robot))
                    status = asyncio.create_task(self._report(robot, writer))
                elif line.startswith("GETSTARTPOSES"):
                    poses = " ".join(f"{tag} {_text(at)} 0,0,0" for tag, at in _STARTS.items())
                    writer.write(f"NFO {{StartPoses {len(_STARTS)}}} {{{poses}}}\r\n".encode())
                elif line.startswith("GETCONF") and robot is not None:
                    writer.write(_conf(robot))
        finally:
            if status is not None:
                status.cancel()
            if robot is not None and not self.has("keeps-leavers"):
                self.robots.remove(robot)

    def _spawn(self, groups: dict[str, str]) -> MiniRobot:
        location = _STARTS.get(groups.get("start", ""), (0.0, 0.0, -0.2))
        if "location" in groups:
            x, y, z = (float(part) for part in groups["location"].split(","))
            location = x, y, z
        taken = {robot.tile for robot in self.robots}
        tile = next(number for number in range(64) if number not in taken)
        class_name = groups.get("classname", "").rpartition(".")[2]
        robot = MiniRobot(groups.get("name", "Unnamed"), class_name, location, self._made, tile)
        self._made += 1
        self.robots.append(robot)
        return robot

    async def _report(self, robot: MiniRobot, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while True:
                now = f"{self.time:.4f}"
                writer.write(
                    f"STA {{Time {now}}} {{Type GroundVehicle}} {{Battery 1200}}\r\n"
                    f"SEN {{Time {now}}} {{Type GroundTruth}} {{Name GroundTruth}} "
                    f"{{Location {_text(robot.location)}}} {{Orientation 0,0,0}}\r\n".encode()
                )
                await writer.drain()
                await self.ticks.next()


def _text(values: tuple[float, ...]) -> str:
    return ",".join(f"{value:.6f}" for value in values)


def _conf(robot: MiniRobot) -> bytes:
    x, y = robot.tile % 2 * 64, robot.tile // 2 * 48
    return (
        f"CONF {{Type Camera}} {{Name Camera}}{{TextureOffsetX {x}}}{{TextureOffsetY {y}}}"
        f"{{TextureResolutionX 64}}{{TextureResolutionY 48}}{{CameraDefFov 80.0000}}"
        f"{{CameraMinFov 20.0000}}{{CameraMaxFov 120.0000}}{{CameraFov {robot.fov:.4f}}}\r\n"
    ).encode()


def truncated(value: float, digits: int = 4) -> str:
    """A number cut off behind some digits."""
    scale = 10**digits
    return f"{math.copysign(math.floor(abs(value) * scale + 1e-6) / scale, value):.{digits}f}"


async def serve_lines(
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    answer: Callable[[str], str | None],
    *,
    one_per_read: bool = False,
    end: str = "\r\n",
) -> None:
    """Answer the lines of one client.

    Args:
        reader: from it. writer: to it.
        answer: the reply to a line, without line end; None for none.
        one_per_read: a fault: only the first line of what one read brings is answered.
        end: of replies.
    """
    held = b""
    while data := await reader.read(65536):
        *lines, held = (held + data).split(b"\n")
        for line in lines[:1] if one_per_read else lines:
            reply = answer(line.decode("latin-1").rstrip("\r"))
            if reply is not None:
                writer.write((reply + end).encode("latin-1"))
        await writer.drain()
