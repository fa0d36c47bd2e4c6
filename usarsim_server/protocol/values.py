"""Values that the wire speaks: dialects, segments, vectors, and names that clients give.

Names of robots, people and objects are one token each, and no two are alike: others read these
names in lines whose fields are told apart by blanks and braces, and address each other by them. The
original took any text: a robot called `Evil Location 9,9,0` forged fields in the ground truth of
everybody else (side channels reference 3.4: robot names must not contain blanks or braces), and
engine names know no case.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Container, Iterable
from enum import Enum
from itertools import islice
from typing import NamedTuple

Vector = tuple[float, float, float]
"""Wire frame: x forward, y right, z down in metres, or roll, pitch, yaw in rad."""

Segment = tuple[str, str]
"""Key and already formatted value of one `{Key value}` pair; an empty value prints `{Key}`."""


class Dialect(Enum):
    """Shape of the server's output. `auto` is not a dialect but a way to choose one."""

    UT2004 = "ut2004"
    UDK = "udk"

    # Every line looks things up by the dialect; members are single, so identity will do.
    __hash__ = object.__hash__


class Item(NamedTuple):
    """A named item of a line (one sensor, one actuator) with its data segments in wire order."""

    name: str
    segments: tuple[Segment, ...] = ()


class Hearing:
    """What the reader of one command asked for; made only when somebody wants it explained.

    Attributes:
        asked: keys of segments, in lower case, and what was made of their texts; None: a text.
        rest: what was made of all other segments, whatever their keys; None: nothing.
        repeated: keys that may come again and again.
    """

    def __init__(self) -> None:
        self.asked: dict[str, Callable[[str], object] | None] = {}
        self.rest: Callable[[str], object] | None = None
        self.repeated: set[str] = set()

    def ask(self, key: str, read: Callable[[str], object] | None = None) -> None:
        """A segment was looked for, and read by a function."""
        name = key.lower()
        self.asked[name] = read or self.asked.get(name)


LONGEST_NAME = 64
"""Characters of a name, the number behind it included. The original set no limit of its own, its
Gazebo successor read values of 99 characters (protocol reference 1.4)."""

_DELIMITERS = re.compile(r"[\s{}]+")


def clean_name(text: str) -> str:
    """The text as one token: printable characters without blanks and braces.

    What is anything else becomes an underscore, a whole run of blanks and braces a single one;
    outside them is nothing. An empty result means that there is no name in the text.
    """
    name = _DELIMITERS.sub("_", text.strip())
    if not name.isprintable():
        name = "".join(one if one.isprintable() else "_" for one in name)
    return name


def name_key(text: str) -> str:
    """What all spellings of a name have in common: equal keys mean the same name."""
    return clean_name(text).lower()


def free_name(text: str, taken: Container[str]) -> str:
    """The name that somebody gets who wants to be called so.

    Args:
        text: the name as sent.
        taken: keys of the names that others have, see `name_key`.

    Returns:
        The clean name, with `_2`, `_3` ... behind it if others have it.

    Raises:
        ValueError: if it is empty or longer than `LONGEST_NAME`.
    """
    wanted = clean_name(text)
    if not wanted:
        raise ValueError("the name is empty")
    if len(wanted) > LONGEST_NAME:
        raise ValueError(f"the name has {len(wanted)} characters, {LONGEST_NAME} are possible")
    name, number = wanted, 1
    while name.lower() in taken:
        number += 1
        ending = f"_{number}"
        name = wanted[: LONGEST_NAME - len(ending)] + ending
    return name


def taken(name: str) -> str:
    """Why nobody else can have a name that somebody has."""
    return f"the name {name} is taken"


_LONGEST_NAME, _MOST_NAMES = 40, 200


def near(text: str, known: Iterable[str]) -> str:
    """`; did you mean X?` if a name is like what was written, else nothing."""
    spelled = {one.lower(): one for one in islice(known, _MOST_NAMES)}
    found = difflib.get_close_matches(text[:_LONGEST_NAME].lower(), spelled, n=1, cutoff=0.6)
    return f"; did you mean `{spelled[found[0]]}`?" if found else ""
