"""From commands to typed requests (protocol reference 3).

One function per command word, found through a table. None of them raises: a number that cannot be
read is 0, a segment nobody knows is skipped, a command nobody knows is `Unknown`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from usarsim_server.protocol.grammar import IGNORED_WORDS, Command
from usarsim_server.protocol.numbers import (
    read_bool,
    read_int,
    read_number,
    read_triple,
    read_vector,
)
from usarsim_server.protocol.requests import (
    Act,
    Control,
    Drive,
    GetClosestPathNode,
    GetConf,
    GetGeo,
    GetPathNodes,
    GetStartPoses,
    Goto,
    Ignored,
    Init,
    LinkTarget,
    MisPkg,
    Move,
    MultiDrive,
    Request,
    Set,
    Sync,
    Unknown,
    WheelTarget,
)
from usarsim_server.protocol.values import Dialect, Segment, Vector

T = TypeVar("T")

_DIALECTS = {dialect.value: dialect for dialect in Dialect}
_SET_NAMES = frozenset({"type", "name", "opcode", "params"})
# Segments that name opcode and parameter at once: `{Name Cam} {FOV 0.35}` (protocol 3.7).
_OPCODE_SEGMENTS = ("fov", "zoom")
# Ticks that one SYNC may let pass; a slip of the pen must not let the world run away for ever.
_MOST_TICKS = 1_000_000
# Unknown words go to the log, and a line of 64 KiB may be one word.
_UNKNOWN_CHARACTERS = 40


def interpret(command: Command) -> Request:
    """Return the meaning of a command; never raises."""
    if reader := _READERS.get(command.word):
        return reader(command)
    if command.word in IGNORED_WORDS:
        return Ignored(command.word)
    return Unknown(command.word[:_UNKNOWN_CHARACTERS])


class _Fields:
    """First value of every segment of a command by lower case name, with typed readers."""

    __slots__ = ("_hearing", "_values")

    def __init__(self, command: Command) -> None:
        self._hearing = command.hearing
        self._values: dict[str, str] = {}
        for key, value in command.segments:
            self._values.setdefault(key.lower(), value)

    def text(self, name: str) -> str | None:
        """The value, None if missing or empty."""
        if self._hearing is not None:
            self._hearing.ask(name)
        return self._values.get(name) or None

    def read(self, name: str, read: Callable[[str], T]) -> T | None:
        """What the value means, None if missing."""
        if self._hearing is not None:
            self._hearing.ask(name, read)
        value = self._values.get(name)
        return None if value is None else read(value)

    def vector(self, name: str) -> Vector | None:
        """Three numbers; None if missing or empty, so that a default pose applies."""
        return self.read(name, read_triple) if self.text(name) is not None else None


def _init(command: Command) -> Init:
    fields = _Fields(command)
    fields.text("classname")
    spelling, qualified = next(
        (segment for segment in command.segments if segment[0].lower() == "classname"), ("", "")
    )
    package, _, class_name = qualified.rpartition(".")
    return Init(
        class_name=class_name.strip(),
        package=package.strip(),
        spelled_classname_exactly=spelling == "Classname",
        name=fields.text("name"),
        location=fields.vector("location"),
        rotation=fields.vector("rotation"),
        start=fields.text("start"),
        dialect=_DIALECTS.get((fields.text("dialect") or "").lower()),
        battery=fields.read("battery", read_number),
        team=fields.read("team", read_int),
        skin=fields.text("skin"),
        exact_name=fields.read("exactname", read_bool) or False,
        segments=command.segments,
    )


def _text(value: str) -> str | None:
    return value or None


_DRIVE: Mapping[str, tuple[str, Callable[[str], object]]] = {
    **{name: (name, read_bool) for name in ("normalized", "normalize", "light", "flip")},
    **{name: (name, read_int) for name in ("order", "steer")},
    **{name: (name, _text) for name in ("name", "bone", "axis")},
    **{
        member.replace("_", ""): (member, read_number)
        for member in (
            *("left", "right", "speed", "front_steer", "rear_steer", "value"),
            *("altitude_velocity", "linear_velocity", "lateral_velocity", "rotational_velocity"),
            *("pitch_angle", "roll_angle", "spin1", "spin2", "propeller", "rudder", "stern_plane"),
            *("p_gain", "i_gain", "d_gain", "max_torque"),
        )
    },
}
"""Segments of DRIVE in lower case: which member of the request each gives, and how it is read."""


def _drive(command: Command) -> Drive:
    members: dict[str, Any] = {}
    for key, value in command.segments:
        member, read = _DRIVE.get(key.lower(), ("", _text))
        if member and member not in members:
            members[member] = read(value)
    if command.hearing is not None:
        for name, (_, read) in _DRIVE.items():
            command.hearing.ask(name, None if read is _text else read)
    # The misspelling is accepted by protocol reference 3.4.
    misspelt = members.pop("normalize", None)
    members.setdefault("normalized", misspelt)
    return Drive(wheels=_wheels(command), **members)


_Readers = Mapping[str, Callable[[str], object]]


def _groups(command: Command, opener: str, read: _Readers) -> list[dict[str, str]]:
    """Cut segments into groups that begin at each `opener`; first value of a name wins.

    Args:
        command: the command.
        opener: name of the first segment of each group.
        read: how the caller reads which segments of a group.
    """
    groups: list[dict[str, str]] = []
    segments = command.segments
    if command.hearing is not None:
        for name, reader in read.items():
            command.hearing.ask(name, reader)
            command.hearing.repeated.add(name)
    for key, value in segments:
        name = key.lower()
        if name == opener:
            groups.append({})
        if groups:
            groups[-1].setdefault(name, value)
    return groups


_WHEEL: _Readers = {"wheelnumber": read_int, "wheelspeed": read_number, "wheelsteer": read_number}
_LINK: _Readers = {"link": read_int, "value": read_number, "order": read_int}


def _wheels(command: Command) -> tuple[WheelTarget, ...]:
    def number(group: Mapping[str, str], name: str) -> float | None:
        return read_number(group[name]) if name in group else None

    return tuple(
        WheelTarget(
            number=read_int(group["wheelnumber"]),
            speed=number(group, "wheelspeed"),
            steer=number(group, "wheelsteer"),
        )
        for group in _groups(command, "wheelnumber", _WHEEL)
    )


def _links(command: Command) -> tuple[LinkTarget, ...]:
    """Targets of the Link groups; a group without Value has none."""
    return tuple(
        LinkTarget(
            link=read_int(group["link"]),
            value=read_number(group["value"]),
            order=read_int(group.get("order", "0")),
        )
        for group in _groups(command, "link", _LINK)
        if "value" in group
    )


def _pan_tilt(fields: _Fields) -> tuple[LinkTarget, ...]:
    """Targets of the early `{Rotation 0,tilt,pan}` form: link 1 pans, link 2 tilts
    (protocol 3.6)."""
    rotation = fields.vector("rotation")
    if rotation is None:
        return ()
    order = fields.read("order", read_int) or 0
    return LinkTarget(1, rotation[2], order), LinkTarget(2, rotation[1], order)


def _sequence(fields: _Fields) -> int | None:
    sequence = fields.read("sequence", read_int)
    return fields.read("seq", read_int) if sequence is None else sequence


def _mis_pkg(command: Command) -> MisPkg:
    fields = _Fields(command)
    return MisPkg(
        name=fields.text("name") or "",
        groups=_links(command) or _pan_tilt(fields),
        gripper=fields.read("gripper", read_int),
        seq=_sequence(fields),
    )


def _act(command: Command) -> Act:
    fields = _Fields(command)
    return Act(
        name=fields.text("name") or "",
        groups=_links(command),
        gripper=fields.read("gripper", read_int),
        seq=_sequence(fields),
    )


def _multi_drive(command: Command) -> MultiDrive:
    joints: dict[str, float] = {}
    if command.hearing is not None:
        command.hearing.rest = read_number
    for key, value in command.segments:
        joints.setdefault(key.lower(), read_number(value))
    return MultiDrive(joints)


def _set(command: Command) -> Set:
    fields = _Fields(command)
    opcode, params = fields.text("opcode"), fields.text("params")
    if opcode is None and params is None:
        opcode = next((key for key in _OPCODE_SEGMENTS if fields.text(key)), None)
        params = fields.text(opcode) if opcode else None
    if params is None:
        params = _nameless(command.segments)
        if params and command.hearing is not None:
            command.hearing.ask(params)
    return Set(
        type=fields.text("type") or "",
        name=fields.text("name"),
        opcode=opcode.upper() if opcode else None,
        params=params,
        segments=command.segments,
        hearing=command.hearing,
    )


def _nameless(segments: tuple[Segment, ...]) -> str:
    """Text of a last segment of one word, which Player sends in place of Params (protocol 3.7)."""
    key, value = segments[-1] if segments else ("", "")
    return key if not value and key.lower() not in _SET_NAMES else ""


def _items(command: Command) -> tuple[str, str | None]:
    """Type and name of what is asked about."""
    fields = _Fields(command)
    return fields.text("type") or "", fields.text("name")


def _move(command: Command) -> Move:
    fields = _Fields(command)
    place = fields.text("location")
    x, y = read_vector(place or "", 2)
    return Move(
        type=fields.text("type"),
        action=fields.text("action"),
        location=(x, y) if place else None,
        pathnode=fields.text("pathnode"),
    )


def _sync(command: Command) -> Sync:
    ticks = _Fields(command).read("ticks", read_int)
    return Sync(1 if ticks is None else min(max(ticks, 1), _MOST_TICKS))


_READERS: Mapping[str, Callable[[Command], Request]] = {
    "INIT": _init,
    "GETSTARTPOSES": lambda command: GetStartPoses(
        _Fields(command).read("exactname", read_bool) or False
    ),
    "GETPATHNODES": lambda command: GetPathNodes(),
    "GETCLOSESTPATHNODE": lambda command: GetClosestPathNode(_Fields(command).vector("location")),
    "DRIVE": _drive,
    "MULTIDRIVE": _multi_drive,
    "SET": _set,
    "GETCONF": lambda command: GetConf(*_items(command)),
    "GETGEO": lambda command: GetGeo(*_items(command)),
    "MISPKG": _mis_pkg,
    "ACT": _act,
    "MOVE": _move,
    "GOTO": lambda command: Goto(_Fields(command).text("name") or ""),
    "CONTROL": lambda command: Control(
        _Fields(command).text("type") or "", command.segments, command.hearing
    ),
    "SYNC": _sync,
}
