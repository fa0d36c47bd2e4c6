"""What a planted fault is, and how all are found."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Edit:
    """One change of a file."""

    file: str  # path from the folder that holds `usarsim_server`, `robots` and `worlds`
    old: str  # text that stands there exactly once
    new: str  # what is put in its place


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One wrong number or sign."""

    name: str  # words joined by points, the area first: `sensors.gps.north-halved`
    edits: tuple[Edit, ...]  # of the server's files
    notices: tuple[str, ...]  # identifiers of the checks that have to fail, every one
    field: str  # pattern that their message fits, the name of the field that is wrong
    robot: str  # class that the checks take
    dialect: str | None  # to judge in; None for all that the server speaks


_FAULT = re.compile(
    r"@@ (?P<name>[a-z0-9]+(?:\.[a-z0-9-]+)+) @@"
    r"(?: robot=(?P<robot>\w+))?(?: dialect=(?P<dialect>\w+))?\n"
    r" (?P<notices>[\w.-]+(?:, [\w.-]+)*): (?P<field>.+)\n"
    r"(?P<edits>(?:(?:-.*\n)+(?:\+.*\n)+)+)"
)
_EDIT = re.compile(r"((?:-.*\n)+)((?:\+.*\n)+)")


def all_faults() -> tuple[Fault, ...]:
    """Every fault of the files `*.diff` beside this one, in their order.

    Raises:
        ValueError: if one is malformed, or its name is taken.
    """
    found: dict[str, Fault] = {}
    for path in sorted(Path(__file__).parent.glob("*.diff")):
        for fault in read_faults(path.read_text(encoding="utf-8")):
            if fault.name in found:
                raise ValueError(f"{path}: {fault.name} is taken")
            found[fault.name] = fault
    return tuple(found.values())


def read_faults(text: str) -> Iterator[Fault]:
    """The faults of a text; see the package for what one looks like.

    Raises:
        ValueError: if one is malformed.
    """
    file = ""
    for part in re.split(r"\n\n+", text.strip("\n")):
        if part.startswith("--- "):
            file = part.removeprefix("--- ")
        elif not part.startswith("#"):
            found = _FAULT.fullmatch(part + "\n")
            if found is None or not file:
                raise ValueError(f"no fault of a file: {part!r}")
            dialect = found["dialect"] or "ut2004"
            yield Fault(
                name=found["name"],
                edits=tuple(
                    Edit(file, _bare(old), _bare(new)) for old, new in _EDIT.findall(found["edits"])
                ),
                notices=tuple(found["notices"].split(", ")),
                field=found["field"],
                robot=found["robot"] or "P2AT",
                dialect=None if dialect == "any" else dialect,
            )


def _bare(lines: str) -> str:
    """Lines of a difference without the sign before each."""
    return "\n".join(line[1:] for line in lines.removesuffix("\n").split("\n"))
