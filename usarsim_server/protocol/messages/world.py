"""Lines about world and game: NFO and DIE (protocol reference 4.2 and 4.12)."""

from __future__ import annotations

import re
from collections.abc import Sequence

from usarsim_server.protocol.messages.text import count, line, segment, time_segment, token, triple
from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Vector

__all__ = [
    "closest_path_node",
    "die",
    "greeting",
    "path_nodes",
    "start_poses",
    "status_change",
    "tick",
]

_POSE_DIGITS = 4
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
    return line("NFO", segment("Pathnode", token(tag)), triple("Location", location, _POSE_DIGITS))


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
        time_segment(time, _POSE_DIGITS),
        segment("Type", wire_type),
        segment("Name", name),
    )


def tick(time: float) -> str:
    """A tick of lockstep has passed: everything that was due is said, and the world stands still.

    Args:
        time: simulated s.
    """
    return line("NFO", segment("Status", "Tick"), time_segment(time, _POSE_DIGITS))


def _tagged_poses(key: str, poses: Sequence[tuple[str, Vector, Vector]]) -> str:
    head = line("NFO", count(key, len(poses)))
    if not poses:
        return head
    groups = [
        f"{token(tag)} {vector(location, _POSE_DIGITS)} {vector(rotation, _POSE_DIGITS)}"
        for tag, location, rotation in poses
    ]
    return f"{head} {{{' '.join(groups)}}}"
