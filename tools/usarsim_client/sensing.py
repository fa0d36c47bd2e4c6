"""What a SEN line becomes: a value for each sensor, of the class that its type is known by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from usarsim_client.declared import build
from usarsim_client.segments import Message
from usarsim_server.protocol.values import Segment


@dataclass(frozen=True, slots=True)
class Reading:
    """One report of one sensor.

    Attributes:
        name: of the sensor. type: as the line spells it; SICK and Hokuyo are RangeScanner.
        time: simulated s. Types that tell no time have that of the newest line that did; NaN if
            there was none.
    """

    name: str
    type: str
    time: float


@dataclass(frozen=True, slots=True)
class Unknown(Reading):
    """A type that this client does not know, or a line without what its type must have.

    Attributes:
        segments: key and value as sent, without Type, Time and Name.
    """

    segments: tuple[Segment, ...]

    def get(self, key: str, default: str = "") -> str:
        """The first value of a key in any case."""
        return next((value for one, value in self.segments if one.lower() == key.lower()), default)


Kind = TypeVar("Kind", bound=type[Reading])

TYPES: dict[str, type[Reading]] = {}
"""What the types of sensors, in lower case, become."""


def tells(*types: str) -> Callable[[Kind], Kind]:
    """Declares which types of sensors become values of a class."""

    def enter(kind: Kind) -> Kind:
        TYPES.update(dict.fromkeys([name.lower() for name in types], kind))
        return kind

    return enter


def read_sensors(message: Message, time: float) -> list[Reading]:
    """A value for each sensor of a line; `Unknown` for what is not known or lacks something."""
    name = message.type
    kind = TYPES.get(name.lower())
    found: list[Reading] = []
    for item in message.items():
        if kind is not None:
            try:
                found.append(build(kind, item, item.name, name, time))
                continue
            except (KeyError, ValueError):
                pass
        found.append(Unknown(item.name, name, time, tuple(item.segments)))
    return found
