"""Values that declare with each field which segment it is; one function makes them of a line."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

from usarsim_client.segments import Item, groups
from usarsim_server.protocol.values import Vector

Kind = TypeVar("Kind")
Part = Callable[[Item], Any]
"""Makes a field of what a line says of an item; `KeyError` or `ValueError` if it cannot."""

NOWHERE: Vector = (math.nan, math.nan, math.nan)
_NEEDED = object()


def wire(read: Callable[[str], Any], *keys: str, default: Any = _NEEDED) -> Any:
    """A field that stands in a segment, the first of some keys in any case.

    Args:
        read: makes the field of the text.
        keys: of the segment in the generations.
        default: without it; a value whose item lacks a segment without default cannot be made.
    """
    lower = tuple(key.lower() for key in keys)

    def part(item: Item) -> Any:
        for key in lower:
            if key in item.fields:
                return read(item.fields[key])
        if default is _NEEDED:
            raise KeyError(lower)
        return default

    return whole(part)


def many(kind: type, *openers: str) -> Any:
    """A field of several values, each of a group of segments that begins with one of some keys."""
    lower = frozenset(opener.lower() for opener in openers)
    return whole(lambda item: tuple(build(kind, group) for group in groups(item, lower)))


def whole(part: Part) -> Any:
    """A field made of all that a line says of an item."""
    return dataclasses.field(metadata={"part": part})


def build(kind: type[Kind], item: Item, *first: object) -> Kind:
    """Make a value.

    Args:
        kind: a dataclass that declares its fields as above.
        item: of which.
        first: fields before those that are declared so.

    Raises:
        KeyError: if a segment is missing.
        ValueError: if one cannot be read.
    """
    parts = _PARTS.get(kind)
    if parts is None:
        declared = (field.metadata.get("part") for field in dataclasses.fields(cast(Any, kind)))
        parts = _PARTS[kind] = tuple(part for part in declared if part is not None)
    return kind(*first, *[part(item) for part in parts])


_PARTS: dict[type, tuple[Part, ...]] = {}
"""What makes the fields of each kind; remembered, since there are many lines."""


def text(value: str) -> str:
    """A segment as it is."""
    return value
