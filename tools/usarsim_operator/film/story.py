"""What a recording tells: who was where and when, and what cameras saw; no pictures of its own."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_client.scene import Message, Present, SceneReader, Thing
from usarsim_operator import packets
from usarsim_operator.recording import Packet, Recording, Text
from usarsim_server.protocol.scene import message

_SCENE = frozenset({"mesh", "texture", "kind", "scene", "present"})
_POSES = struct.Struct("<II")
_BACK = 1.0  # s by which time must jump back to be another world's
_JUMP = 1.0  # m between two poses beyond which a thing was put there


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Where everything was at one instant."""

    time: float  # simulated s; goes on where a server was started anew
    chapter: int  # number of the scene, from 0
    present: Present
    rows: NDArray[np.float64]  # (n, 7): x, y, z (m, z up), w, x, y, z

    def robot(self, name: str) -> Thing | None:
        """A robot that is there; None if it is not."""
        found = self.present.find(name)
        return found if found is not None and found.what == "robot" else None


@dataclass(slots=True)
class Chapter:
    """A scene, and the most things of each kind that were in it at a time."""

    scene: Message
    most: Counter[str] = field(default_factory=Counter)


@dataclass(slots=True)
class Survey:
    """What is in a recording.

    Attributes:
        chapters: scenes in their order. reader: looks of everything in them.
        first, last: simulated s of the first and the last poses.
        robots: names of those that had poses, with the times of the first and the last.
        cameras: names of robots with pictures, with the times of the first and the last.
        lower, upper: corners (m) of the box in which robots were.
    """

    chapters: list[Chapter] = field(default_factory=list)
    reader: SceneReader = field(default_factory=SceneReader)
    first: float = np.inf
    last: float = -np.inf
    robots: dict[str, tuple[float, float]] = field(default_factory=dict)
    cameras: dict[str, tuple[float, float]] = field(default_factory=dict)
    lower: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    upper: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))


class _Clock:
    """Makes one time of those of servers that were started one after the other."""

    def __init__(self) -> None:
        self._shift, self._last = 0.0, -np.inf

    def at(self, time: float) -> float:
        if time + self._shift < self._last - _BACK:
            self._shift = self._last - time
        self._last = max(self._last, time + self._shift)
        return time + self._shift


def survey(recording: Recording) -> Survey:
    """Read a recording once.

    Raises:
        RecordingError: if it is damaged.
    """
    found = Survey()
    for moment in moments(recording, found):
        found.first, found.last = min(found.first, moment.time), max(found.last, moment.time)
        most = found.chapters[moment.chapter].most
        most |= Counter(thing.kind for thing in moment.present.things)
        for thing in moment.present.things:
            if thing.what == "robot":
                since = found.robots.get(thing.name, (moment.time,))[0]
                found.robots[thing.name] = since, moment.time
                place = moment.rows[thing.first, :3]
                np.minimum(found.lower, place, out=found.lower)
                np.maximum(found.upper, place, out=found.upper)
    for name, time, _ in _pictures(recording):
        first, last = found.cameras.get(name, (time, time))
        found.cameras[name] = min(first, time), max(last, time)
    return found


def moments(recording: Recording, found: Survey | None = None) -> Iterator[Moment]:
    """All poses in their order; scenes and looks are noted in `found`."""
    found = Survey() if found is None else found
    reader, clock, chapter = found.reader, _Clock(), -1
    for entry in recording:
        if isinstance(entry, Text):
            kind = entry.fields.get("type")
            if kind in _SCENE:
                reader.feed(message(entry.fields))
            if kind == "scene":
                chapter += 1
                found.chapters.append(Chapter(dict(entry.fields)))
        elif entry.kind == packets.POSES and reader.present is not None and chapter >= 0:
            generation, count = _POSES.unpack_from(entry.contents)
            if generation == reader.present.generation and count == reader.present.count:
                rows = np.frombuffer(entry.contents, "<f4", count * 7, _POSES.size)
                placed = rows.reshape(count, 7).astype(float)
                yield Moment(clock.at(entry.time), chapter, reader.present, placed)


def pictures(recording: Recording, robot: str) -> Iterator[tuple[float, bytes]]:
    """Simulated time (s) and JPEG of each picture of a robot's camera."""
    return ((time, data) for name, time, data in _pictures(recording) if name == robot)


def _pictures(recording: Recording) -> Iterator[tuple[str, float, bytes]]:
    names: dict[int, str] = {}
    clock = _Clock()
    for entry in recording:
        if isinstance(entry, Packet) and entry.kind == packets.PICTURE and entry.robot in names:
            yield names[entry.robot], clock.at(entry.time), entry.contents
        elif isinstance(entry, Text) and entry.fields.get("type") == "state":
            names = {row["index"]: row["name"] for row in entry.fields["robots"]}


def between(before: Moment, after: Moment, time: float) -> Moment:
    """How it was between two moments; what came, went or was put elsewhere stays as before."""
    same = before.present is after.present and before.chapter == after.chapter
    span = after.time - before.time
    if not same or span <= 0.0 or time <= before.time:
        return before
    part = min(1.0, (time - before.time) / span)
    first, last = before.rows, after.rows
    last = np.where(_signs(first, last) < 0.0, np.hstack((last[:, :3], -last[:, 3:])), last)
    rows = first + part * (last - first)
    rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    jumped = np.linalg.norm(last[:, :3] - first[:, :3], axis=1) > _JUMP
    rows[jumped] = first[jumped]
    return Moment(time, before.chapter, before.present, rows)


def _signs(first: NDArray[np.float64], last: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 1): negative where the shorter way is that to the opposite quaternion."""
    products: NDArray[np.float64] = np.sum(first[:, 3:] * last[:, 3:], axis=1, keepdims=True)
    return products
