"""A client of the image stream as a check needs it (side channels reference 2)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from usarsim_client.inbox import ProtocolError
from usarsim_client.pictures import FULL_FRAME, HEADER, Picture, header, rectangle
from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.lines import Line
from usarsim_conformance.places import LEAVES, Place
from usarsim_conformance.registry import Crowded, Failed, Inconclusive, NotApplicable
from usarsim_conformance.wire import Hangup, Wire

FRAME_WITHIN = 60.0
"""s of simulated time for a frame; a server that draws without a graphics card may need long."""
FRAME_LEAST_WALL = 15.0
"""s of wall time that it has at least: pictures are drawn in real time, also where a minute of
simulated time passes in a second."""

Pixels = NDArray[np.uint8]


class Frame(Picture):
    """One reply; the check fails that looks into a payload that is no picture."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        try:
            return super().size
        except ProtocolError as error:
            raise Failed(str(error)) from None

    @cached_property
    def pixels(self) -> Pixels:
        """(height, width, 3), red first, top row first."""
        try:
            return super().pixels
        except ProtocolError as error:
            raise Failed(str(error)) from None


class WrongLength(Failed):
    """The length in a header is not that of what follows it."""


_TILES_TAKEN = 10.0
"""s of simulated time for which a check waits while robots of others have all tiles."""
_MARKED = (9, 7)
"""Pixels of a picture that no check asks for: its answer marks a place in the stream of answers."""
_MARK = rectangle(0, 0, *_MARKED)
_LOOKS = 3
_QUIET = 0.5
"""s of simulated time after which nothing more is expected."""


@dataclass(frozen=True, slots=True)
class Facts:
    """What kind of stream it is.

    Attributes:
        pushes: whether a picture comes before the first request (legacy mode, side channels 2.8).
        marks: whether rectangles are answered, so that one can mark where answers begin.
        kind: the type byte.
        width: of the full frame, pixels. height: likewise.
    """

    pushes: bool
    marks: bool
    kind: int
    width: int
    height: int


class ImageClient:
    """A client without narrow habits.

    Attributes:
        facts: about the stream.
        wire: the connection.
    """

    def __init__(self, wire: Wire, facts: Facts) -> None:
        self.wire = wire
        self.facts = facts

    @classmethod
    async def open(cls, case: Case) -> ImageClient:
        """Connect; pictures that nobody asked for are read and dropped.

        Legacy mode sends one at once; others send one to clients that seem to say nothing, and the
        kit may be slow. What follows the answer to the first request was asked for.
        """
        facts = await facts_of(case)
        client = cls(await case.open("images"), facts)
        if facts.marks:
            await client.send(_MARK)
            await _up_to_mark(client.wire)
        elif facts.pushes:
            await client.frame()
        return client

    async def send(self, data: bytes) -> None:
        """Send bytes."""
        await self.wire.send(data)

    async def frame(self, within: float | None = None) -> Frame:
        """The next reply.

        Raises:
            Failed: if it does not come whole in time.
        """
        return await read_frame(self.wire, within)

    async def ask(self, request: bytes = FULL_FRAME, within: float | None = None) -> Frame:
        """Send a request and read its reply."""
        await self.send(request)
        return await self.frame(within)

    async def silent(self, seconds: float, after: str) -> None:
        """Fail if anything comes within a time.

        Args:
            seconds: of simulated time.
            after: what came before, for the report.
        """
        data = await self.wire.silence(seconds)
        if data:
            raise Failed(
                f"{len(data)} bytes came after {after}, not 0, beginning {data[:12].hex(' ')}"
            )

    async def ends(self, after: str) -> None:
        """Fail if more than the replies read so far is on its way.

        Half a second of simulated time can pass sooner than a picture is drawn, so a last request
        marks the end where rectangles are answered.

        Args:
            after: what came before, for the report.
        """
        await self.silent(_QUIET, after)
        if self.facts.marks:
            await self.send(_MARK)
            more = len(await _up_to_mark(self.wire))
            if more:
                raise Failed(f"{more} more frames came after {after}, not 0")


async def read_frame(wire: Wire, within: float | None = None) -> Frame:
    """The next reply on a connection."""
    within = FRAME_WITHIN if within is None else within
    head = await wire.read_exactly(HEADER.size, within, FRAME_LEAST_WALL)
    kind, length = HEADER.unpack(head)
    other = int.from_bytes(head[1:], "little")
    told = f"the length in the header, {head[1:].hex(' ')}, is {length}"
    try:
        header(head)
    except ProtocolError:
        raise WrongLength(
            f"{told} big-endian, as it should be, which no picture has, and {other} little-endian"
        ) from None
    try:
        return Frame(kind, await wire.read_exactly(length, within, FRAME_LEAST_WALL))
    except Hangup:
        raise
    except Failed:
        raise WrongLength(
            f"{told}, but {wire.waiting} bytes of payload follow it in {within:g} s"
        ) from None


async def facts_of(case: Case) -> Facts:
    """What kind of stream it is, found out once per run."""
    own = case.transcript
    try:
        found = await case.shared("the image stream", _look_at_lengths, dialect="")
        if isinstance(found, WrongLength):
            raise found
        return found
    except Inconclusive as error:
        # Nothing can be said of a stream that has no frames, but that it breaks the rules.
        raise Failed(str(error)) from None
    finally:
        case.transcript = own


async def _look_at_lengths(case: Case) -> Facts | WrongLength:
    try:
        return await _look(case)
    except WrongLength as error:
        return error  # whatever is asked of the stream then, that is what is wrong


async def _look(case: Case) -> Facts:
    unasked = []
    for _ in range(_LOOKS):
        wire = await case.open("images")
        await wire.send(FULL_FRAME + _MARK)
        try:
            unasked.append(len(await _up_to_mark(wire, FRAME_WITHIN / 3.0)) - 1)
        except Failed:
            return await _look_without_mark(case)
        if unasked[-1] <= 0:
            break  # legacy mode sends one every time, others only if the kit is slow
    await wire.send(FULL_FRAME)
    frame = await read_frame(wire)
    width, height = frame.size
    return Facts(min(unasked) > 0, True, frame.kind, width, height)


async def _look_without_mark(case: Case) -> Facts:
    wire = await case.open("images")
    pushes = bool(await wire.silence(1.0))
    if pushes:
        frame = await read_frame(await case.open("images"))
    else:
        await wire.send(FULL_FRAME)
        try:
            frame = await read_frame(wire, FRAME_WITHIN / 3.0)
        except WrongLength:
            raise
        except Failed:
            # One server in the field wants a line end; a check says so, the others go on.
            await wire.send(b"\r\n")
            frame = await read_frame(wire)
    width, height = frame.size
    return Facts(pushes, False, frame.kind, width, height)


async def _up_to_mark(wire: Wire, within: float | None = None) -> list[Frame]:
    """Replies before that to the mark."""
    found: list[Frame] = []
    while (frame := await read_frame(wire, within)).size != _MARKED:
        found.append(frame)
        if len(found) > _LOOKS:
            raise Failed(f"a rectangle of {_MARKED} pixels was not answered by a picture of them")
    return found


@dataclass(frozen=True, slots=True)
class Tile:
    """Where a camera is in the full frame, as CONF tells (side channels 2.10); pixels, degrees."""

    name: str
    x: int
    y: int
    width: int
    height: int
    default_fov: float
    least_fov: float
    most_fov: float
    fov: float

    @property
    def request(self) -> bytes:
        """The request for its picture."""
        return rectangle(self.x, self.y, self.width, self.height)

    def cut(self, pixels: Pixels) -> Pixels:
        """Its part of a full frame."""
        return pixels[self.y : self.y + self.height, self.x : self.x + self.width]


_TILE = re.compile(
    r"\{Name ([^{}]*)\}\s*"
    + r"\s*".join(rf"\{{Texture{name} (\d+)\}}" for name in ("OffsetX", "OffsetY", "ResolutionX"))
    + r"\s*\{TextureResolutionY (\d+)\}"
    + "".join(rf"\s*\{{Camera{name}Fov ([\d.]+)\}}" for name in ("Def", "Min", "Max", ""))
)


def tiles_of(text: str) -> list[Tile]:
    """Tiles that a CONF of cameras names."""
    return [
        Tile(name, *(int(word) for word in words[:4]), *(float(word) for word in words[4:]))
        for name, *words in _TILE.findall(text)
    ]


@dataclass
class CameraRobot:
    """A robot with a camera."""

    robot: Robot  # the robot
    tiles: list[Tile]  # of its cameras
    conf: str  # the line that told them

    @property
    def tile(self) -> Tile:
        """Of its first camera."""
        return self.tiles[0]


async def ask_conf(robot: Robot, extra: str = "") -> str:
    """The answer to GETCONF of cameras; empty if the robot has none.

    Raises:
        Failed: if it has one, by what it has said unasked, and does not answer.
    """
    client, camera = robot.client, "CONF {Type Camera}"
    command = f"GETCONF {{Type Camera}}{extra}"
    known = any(line.text.startswith(camera) for line in client.lines)
    # Nothing is said of what is not there: the question behind it tells that it is not.
    await robot.send(command, "GETSTARTPOSES")
    found = ""
    while not (line := await client.wait(_told(camera), what=command)).text.startswith("NFO"):
        found = found or line.text
    if known and not found:
        raise Failed(f"{command} was not answered, although there is a camera")
    return found


def _told(camera: str) -> Callable[[Line], bool]:
    return lambda line: line.text.startswith((camera, "NFO {StartPoses"))


async def camera_robot(case: Case, class_name: str = "", place: Place | None = None) -> CameraRobot:
    """A robot whose camera has a tile.

    Args:
        case: the check.
        class_name: class; that of most checks by default.
        place: where; a free one by default.

    Raises:
        NotApplicable: if robots have no cameras, or CONF names no tiles.
        Crowded: if no tile becomes free.
    """
    # Tiles are told in this dialect only; a legacy server passes the segment over.
    segment = case.survey.dialects.get("udk", "")
    place, latest = place or await case.place(), case.clock.after(_TILES_TAKEN)
    holder: Robot | None = None
    while True:
        try:
            robot = await case.spawn(class_name=class_name, place=place, extra=segment)
        except Inconclusive:
            if class_name:
                raise NotApplicable(f"no {class_name} can be spawned") from None
            raise
        conf = await ask_conf(robot)
        if not conf:
            raise NotApplicable(
                f"{robot.class_name} has no camera; name another class with --robot"
            )
        tiles = tiles_of(conf)
        if not tiles:
            raise NotApplicable(f"CONF names no tiles: {conf[:120]}")
        if class_name or not case.clock.followed or (tiles[0].x, tiles[0].y) != (0, 0):
            if holder is not None:
                holder.close()
                await case.clock.sleep(LEAVES)
            return CameraRobot(robot, tiles, conf)
        # The robot that tells the time has a camera too, and usually this tile, which the server
        # also names when all tiles are taken.
        if case.clock.now > latest:
            raise Crowded("the robot has no tile of its own: they may have run out")
        robot.close()
        await case.clock.sleep(LEAVES)
        if holder is None and not case.run.is_beside:
            # No other check runs, so this tile may be free: the robot that tells the time has
            # come anew and taken another one. A second robot holds it meanwhile.
            holder = await case.spawn(extra=segment)
