"""Lines about world and game.

NFO and DIE (protocol reference 4.2 and 4.12), the answer of a world controller to GetSTA
(protocol 4.11), STA and BSTA of people who walk about (protocol 4.4 and 4.13), RES, which only
`ut2004` has (protocol 4.10).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.messages.text import (
    count,
    flag,
    line,
    segment,
    time_segment,
    token,
    triple,
)
from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Segment, Vector

_DIGITS = 4
_COARSE = 2
"""Digits of places and angles of people."""
_RESULT_DIGITS = FACETS[Dialect.UT2004].time_digits
_LEVEL_INFO = re.compile(r"\.levelinfo.*", re.IGNORECASE | re.DOTALL)


def greeting(game_type: str, level: str, time_limit: int) -> str:
    """The one line a client gets on accept.

    Args:
        game_type: game class without package, `BotDeathMatch` in both eras.
        level: map name; a trailing `.LevelInfo` and what follows it is cut off.
        time_limit: minutes, 0 for none.
    """
    return line(
        "NFO",
        segment("Gametype", game_type),
        segment("Level", _LEVEL_INFO.sub("", level)),
        count("TimeLimit", time_limit),
    )


def start_poses(poses: Sequence[tuple[str, Vector, Vector]]) -> str:
    """The start positions in the flat form that every client reads.

    Args:
        poses: tag, location (m) and roll, pitch, yaw (rad) in the wire frame. Blanks in a tag
            become underscores.
    """
    return _tagged_poses("StartPoses", poses)


def path_nodes(nodes: Sequence[tuple[str, Vector, Vector]]) -> str:
    """The nodes of the walking graph, in the same form as the start positions."""
    return _tagged_poses("PathNodes", nodes)


def closest_path_node(tag: str, location: Vector) -> str:
    """The path node nearest to the place a client asked about; location in m."""
    return line("NFO", segment("Pathnode", token(tag)), triple("Location", location, _DIGITS))


def refused(reason: str) -> str:
    """INIT failed, told to who asked for it by `ExactName`; no server of old says so."""
    return line("NFO", segment("Status", "Refused"), segment("Reason", reason))


def exact_names() -> str:
    """This server knows the segment ExactName; no server of old says so."""
    return line("NFO", segment("Status", "ExactNames"))


def die(killer: str, damage_type: str) -> str:
    """The game killed the robot.

    Args:
        killer: name of whoever did it, `None` for the world itself.
        damage_type: engine class of the damage, for example `DmgType_Fell`.
    """
    return line("DIE", segment("Killer", killer), segment("DamageType", damage_type))


def status_change(time: float, event: str, wire_type: str, name: str) -> str:
    """The configuration of a robot has changed by itself, for example a battery is empty.

    Sent once, unasked. The original had nothing of the kind; the head is one that every client
    knows and the keys are ones that none looks for, so old parsers pass over it.

    Args:
        time: simulated s.
        event: one word: BatteryEmpty, CameraTile, ItemAttached, ItemReleased, ToolAttached,
            ToolReleased.
        wire_type: type of the item that changed. name: its name.
    """
    return line(
        "NFO",
        segment("Status", token(event)),
        time_segment(time, _DIGITS),
        segment("Type", wire_type),
        segment("Name", name),
    )


def tick(time: float) -> str:
    """A tick of lockstep has passed: everything that was due is said, and the world stands still.

    Args:
        time: simulated s.
    """
    return line("NFO", segment("Status", "Tick"), time_segment(time, _DIGITS))


def _tagged_poses(key: str, poses: Sequence[tuple[str, Vector, Vector]]) -> str:
    head = line("NFO", count(key, len(poses)))
    if not poses:
        return head
    groups = [
        f"{token(tag)} {vector(location, _DIGITS)} {vector(rotation, _DIGITS)}"
        for tag, location, rotation in poses
    ]
    return f"{head} {{{' '.join(groups)}}}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectStatus:
    """One object of a world controller."""

    name: str  # as it was created
    size: Vector  # extents, m, none of them negative
    location: Vector  # m, wire frame
    rotation: Vector  # roll, pitch, yaw, rad
    memory: str = ""  # text that was given at its creation


def object_status(objects: Sequence[ObjectStatus]) -> str:
    """STA of all objects that match; the bare head if there is none.

    Braces are balanced and sizes positive, which the original's were not; what splits at any
    brace reads both (protocol 5.2 no. 24). An empty memory keeps its blank, so that it is a key,
    too.
    """
    body: list[str] = []
    for one in objects:
        body += (
            segment("Name", one.name),
            triple("Size", [abs(extent) for extent in one.size], _DIGITS),
            triple("Location", one.location, _DIGITS),
            segment("Memory", one.memory or " ").replace("  ", " "),
            triple("Rotation", one.rotation, _DIGITS),
        )
    return line("STA", *body)


@dataclass(frozen=True, slots=True, kw_only=True)
class AvatarStatus:
    """Where an avatar is."""

    time: float  # simulated s
    class_name: str  # its class without package
    name: str  # the name of its INIT
    location: Vector  # m, wire frame
    orientation: Vector  # roll, pitch, yaw, rad
    walking: bool  # whether it is under way


def avatar_status(status: AvatarStatus) -> str:
    """STA of an avatar."""
    return line(
        "STA",
        time_segment(status.time, _DIGITS),
        segment("Type", status.class_name),
        segment("Name", status.name),
        triple("Location", status.location, _COARSE),
        triple("Orientation", status.orientation, _COARSE),
        flag("Walking", status.walking),
    )


def avatar_bones(time: float, name: str, bones: Sequence[tuple[str, Vector]]) -> str:
    """BSTA of an avatar.

    Args:
        time: simulated s.
        name: the name of its INIT.
        bones: name and rotation (roll, pitch, yaw, rad, relative to the body) of its arm bones.
    """
    body: list[str] = []
    for bone, rotation in bones:
        body += (segment("Bone", bone), triple("Rotation", rotation, _COARSE))
    return line("BSTA", time_segment(time, _DIGITS), segment("Name", name), *body)


# RDK reads the lower case spelling for these, MOAST the other for the rest (protocol 5.2 no. 19).
_LOWER_CASE_STATUS = frozenset({"RFID", "RFIDReleaser"})


def result(
    time: float, wire_type: str, name: str | None, ok: bool, extra: Sequence[Segment] = ()
) -> str:
    """RES of a SET.

    Args:
        time: simulated s.
        wire_type: Type, canonical spelling.
        name: item name, None to leave it out.
        ok: whether the item obeyed.
        extra: segments behind the status, for example ID and Mem of an RFID tag.
    """
    status = "status" if wire_type in _LOWER_CASE_STATUS else "Status"
    return line(
        "RES",
        time_segment(time, _RESULT_DIGITS),
        segment("Type", wire_type),
        *(() if name is None else (segment("Name", name),)),
        segment(status, _verdict(ok)),
        *(segment(key, value) for key, value in extra),
    )


def viewports_result(
    time: float,
    viewports: Sequence[tuple[str, bool]],
    config: tuple[str, bool] | None = None,
) -> str:
    """RES of `SET {Type Viewports}`.

    Args:
        time: simulated s.
        viewports: camera (or Disabled, None) and success of each viewport.
        config: SingleView or QuadView, and success (side channels reference 2.11).
    """
    body: list[str] = []
    if config is not None:
        body += (segment("Config", config[0]), segment("Status", _verdict(config[1])))
    for index, (camera, ok) in enumerate(viewports, start=1):
        body += (segment(f"Viewport{index}", camera), segment("Status", _verdict(ok)))
    stamp = time_segment(time, _RESULT_DIGITS)
    return line("RES", stamp, segment("Type", "Viewports"), *body)


def _verdict(ok: bool) -> str:
    return "OK" if ok else "Failed"
