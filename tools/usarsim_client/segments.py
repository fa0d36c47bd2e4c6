"""From a line of the server to the items that it tells of; nothing interpreted, nothing raised.

Both generations fit into one shape. What `ut2004` batches, `{Name F1 Range 1.98} {Name F2 Range
2.33}`, and what `udk` tells in segments of their own, `{Name F1} {Range 1.98}`, are items with a
name and segments. Every function is linear in the length of its text, whatever that is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.values import Segment, Vector

Array = NDArray[np.float64]

# Possessive, so that a brace which is never closed costs one look at what follows it.
_SEGMENT = re.compile(r"\{[ \t]*+([^{}\s]++)[ \t]*+([^{}]*+)\}")
_SEPARATORS = re.compile(r"[,\s]+")
_HEAD = re.compile(r"\s*([A-Za-z]{0,16})")
_OF_OBJECTS = frozenset({"name", "size", "location", "memory", "rotation"})
_FALSE = frozenset({"false", "0", "no", "off", ""})


@dataclass(frozen=True, slots=True)
class Item:
    """What a line says of one named thing, a sensor or an actuator.

    Attributes:
        name: of the item; empty if the line names none.
        segments: key and value in the order of the line, spelled as sent, without the name.
        fields: the first value of each key, by the key in lower case.
    """

    name: str
    segments: Sequence[Segment]
    fields: dict[str, str]


class Message:
    """A line in its parts.

    Attributes:
        head: word before the first brace, upper case: STA, SEN, MISSTA, NFO ...
        segments: all of them, as sent.
    """

    __slots__ = ("_fields", "head", "segments")

    def __init__(self, head: str, segments: Sequence[Segment]) -> None:
        self.head = head
        self.segments = segments
        self._fields: dict[str, str] | None = None

    @property
    def fields(self) -> dict[str, str]:
        """The first value of each key of the line, by the key in lower case."""
        if self._fields is None:
            self._fields = fields_of(self.segments)
        return self._fields

    @property
    def item(self) -> Item:
        """The whole line as one item."""
        return Item(self.first("name"), self.segments, self.fields)

    def first(self, name: str) -> str:
        """The first value of a key in lower case; empty without one."""
        for key, value in self.segments:  # what is looked for most stands first
            if key.lower() == name:
                return value
        return ""

    @property
    def type(self) -> str:
        """What the segment Type says; empty without one."""
        return self.first("type")

    def time(self, otherwise: float) -> float:
        """Simulated s of the segment Time; `otherwise` without a readable one."""
        time = number(self.first("time"))
        return otherwise if math.isnan(time) else time

    def items(self) -> list[Item]:
        """What the line tells of, cut at each Name; one without a name if there is no Name.

        Type and Time are of the whole line and in no item.
        """
        items: list[Item] = []
        name, held, fields = "", list[Segment](), dict[str, str]()
        for key, value in _unpacked(self.segments):
            lower = key.lower()
            if lower == "name":
                if name or held:
                    items.append(Item(name, held, fields))
                name, held, fields = value, [], {}
            elif items or name or held or lower not in ("type", "time"):
                held.append((key, value))
                fields.setdefault(lower, value)
        items.append(Item(name, held, fields))
        return items


def read(line: bytes) -> Message:
    """Take a line without its end apart."""
    text = line.decode("latin-1")
    head = _HEAD.match(text)
    assert head is not None  # the pattern matches the empty string
    return Message(head[1].upper(), _SEGMENT.findall(text))


def read_unbalanced(line: bytes) -> Message:
    """Take a line apart whose braces do not match.

    What UDK answers to GetSTA closes some segments never: `{Location 1,2,3 {Memory {red}`. Any
    brace ends a segment here, and what follows an empty Memory is its text if it is no other
    segment of an object.
    """
    head, *parts = re.split(r"[{}]", line.decode("latin-1"))
    segments: list[Segment] = []
    for part in parts:
        key, _, value = part.strip().partition(" ")
        bare = bool(segments) and segments[-1] == ("Memory", "") and key.lower() not in _OF_OBJECTS
        if key and bare:
            segments[-1] = ("Memory", part.strip())
        elif key:
            segments.append((key, value.strip()))
    return Message(head.strip().upper()[:16], segments)


def fields_of(segments: Sequence[Segment]) -> dict[str, str]:
    """The first value of each key, by the key in lower case."""
    return {key.lower(): value for key, value in reversed(segments)}


def groups(item: Item, openers: Container[str]) -> list[Item]:
    """Repeated groups of an item, such as `{ID 1} {Mem 0} {ID 2} {Mem 1}`.

    Args:
        item: to cut.
        openers: keys in lower case with which a group begins; what stands before is left out.
    """
    found: list[list[Segment]] = []
    for segment in item.segments:
        if segment[0].lower() in openers:
            found.append([])
        if found:
            found[-1].append(segment)
    return [Item("", group, fields_of(group)) for group in found]


def _unpacked(segments: Sequence[Segment]) -> Iterator[Segment]:
    """All segments, those of `ut2004` that hold a name and further pairs as several."""
    for key, value in segments:
        if " " in value and key.lower() == "name":
            name, *words = value.split()
            keys, values = words[::2], words[1::2]
            if keys and len(keys) == len(values) and _is_value(values[0]):
                yield key, name
                yield from zip(keys, values, strict=True)
                continue
        yield key, value


def _is_value(word: str) -> bool:
    """Whether a word can be a number, a vector or a boolean; names of two words end in none."""
    return word[0] in "+-.0123456789" or word.lower() in ("true", "false")


def number(text: str) -> float:
    """A finite number; NaN if the text is none."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def integer(text: str) -> int:
    """A whole number, a decimal one truncated; 0 if the text is none."""
    try:
        return int(text)
    except ValueError:
        value = number(text)
        return 0 if math.isnan(value) else int(value)


def boolean(text: str) -> bool:
    """False for `False`, `0`, `no`, `off` and nothing, in any case; True for all else."""
    return text.strip().lower() not in _FALSE


def numbers(text: str) -> tuple[float, ...]:
    """Numbers between commas or blanks; NaN in the place of what is none."""
    return tuple(number(part) for part in _SEPARATORS.split(text.strip(" \t,")) if part)


def vector(text: str) -> Vector:
    """Three numbers; NaN in the place of what is missing or none."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        x = math.nan
    if math.isnan(x) or not math.isfinite(x + y + z):
        x, y, z = (*numbers(text)[:3], math.nan, math.nan, math.nan)[:3]
    return x, y, z


def array(text: str) -> Array:
    """Numbers between commas as an array (n,) that nobody can write to; NaN as in `numbers`."""
    parts = text.rstrip(", \t").split(",")
    try:
        values = np.fromiter(map(float, parts), np.float64, len(parts))
    except ValueError:
        values = np.array(numbers(text), np.float64)
    values.setflags(write=False)
    return values


def points(text: str) -> Array:
    """Points `[x,y,z][x,y,z]`, `x,y,z;x,y,z` or `x,y,z x,y,z` as an array (n, 3)."""
    rows = [vector(part) for part in re.split(r"[\[\]; \t]+", text) if part]
    values = np.array(rows, np.float64).reshape(-1, 3)
    values.setflags(write=False)
    return values
