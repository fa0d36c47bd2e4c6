"""What people who walk about report: STA and BSTA (protocol reference 4.4 and 4.13)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_server.protocol.messages.text import flag, line, segment, time_segment, triple
from usarsim_server.protocol.values import Vector

__all__ = ["AvatarStatus", "avatar_bones", "avatar_status"]

_TIME_DIGITS = 4
_DIGITS = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class AvatarStatus:
    """Where an avatar is.

    Attributes:
        time: simulated s.
        class_name: its class without package. name: the name of its INIT.
        location: m, wire frame. orientation: roll, pitch, yaw, rad.
        walking: whether it is under way.
    """

    time: float
    class_name: str
    name: str
    location: Vector
    orientation: Vector
    walking: bool


def avatar_status(status: AvatarStatus) -> str:
    """STA of an avatar."""
    return line(
        "STA",
        time_segment(status.time, _TIME_DIGITS),
        segment("Type", status.class_name),
        segment("Name", status.name),
        triple("Location", status.location, _DIGITS),
        triple("Orientation", status.orientation, _DIGITS),
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
        body += (segment("Bone", bone), triple("Rotation", rotation, _DIGITS))
    return line("BSTA", time_segment(time, _TIME_DIGITS), segment("Name", name), *body)
