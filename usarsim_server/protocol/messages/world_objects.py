"""The answer of a world controller to GetSTA (protocol reference 4.11)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_server.protocol.messages.text import line, segment, triple
from usarsim_server.protocol.values import Vector

__all__ = ["ObjectStatus", "object_status"]

_DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectStatus:
    """One object of a world controller.

    Attributes:
        name: as it was created.
        size: extents, m, none of them negative.
        location: m, wire frame. rotation: roll, pitch, yaw, rad.
        memory: text that was given at its creation.
    """

    name: str
    size: Vector
    location: Vector
    rotation: Vector
    memory: str = ""


def object_status(objects: Sequence[ObjectStatus]) -> str:
    """STA of all objects that match; the bare head if there is none.

    Braces are balanced and sizes positive, which the original's were not; what splits at any
    brace reads both (5.2 no. 24). An empty memory keeps its blank, so that it is a key, too.
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
