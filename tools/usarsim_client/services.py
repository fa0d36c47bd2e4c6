"""What the wireless simulation and the truth port answer (side channels reference 4, 6)."""

from __future__ import annotations

import re
from dataclasses import dataclass

from usarsim_client.inbox import Line, ProtocolError

_ROAD = re.compile(r"DNSREPLY \{Robot ([^{}]*)\} \{Port (-?\d+)\}")


def road(answer: Line | str, name: str) -> int:
    """Port of the wireless simulation that leads to a robot, by the answer to DNS; 0 or less if
    there is none, or it is out of reach.

    Raises:
        ProtocolError: if it is no such answer.
    """
    found = _ROAD.match(str(answer))
    if found is None or found[1] != name:
        raise ProtocolError(f"no DNSREPLY with a port: {str(answer)!r}")
    return int(found[2])


@dataclass(frozen=True, slots=True)
class Actor:
    """A line of the truth port.

    Attributes:
        name: of the actor. class_name: of it, as told.
        time: simulated s.
        location: m. rotation: roll, pitch, yaw, rad; both in the frame of the wire.
    """

    name: str
    class_name: str
    time: float
    location: tuple[float, ...]
    rotation: tuple[float, ...]


def actor(line: Line) -> Actor | None:
    """The actor that a line of a listing tells of; None at its end."""
    if line.text == "{End}":
        return None
    return Actor(
        line.get("Name", "") or "",
        line.get("Class", "") or "",
        line.time,
        line.numbers("Location"),
        line.numbers("Rotation"),
    )
