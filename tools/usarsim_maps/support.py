"""What readers do with the elements, types and extensions of their formats.

A reader declares a table for each list of its format's specification (`Reader.support`) and acts by
it; docs/import.md repeats the tables, and a test holds both together.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import TypeAlias


class Support(StrEnum):
    """What happens to an element of a format; the value is the column's head in docs/import.md."""

    READ = "Read"
    """It has its effect in the world."""
    LEFT_OUT = "Left out, with a line"
    """The map is imported without it, and the report counts it (`Findings.skip`)."""
    REFUSED = "Refused"
    """The import ends with an error that names it and the cure."""


SupportTable: TypeAlias = Mapping[str, Support]
"""Support by the name that the format's specification gives to the element."""


def support_table(read: str = "", left_out: str = "", refused: str = "") -> dict[str, Support]:
    """A table from names separated by white space.

    Raises:
        ValueError: a name stands in two columns.
    """
    table: dict[str, Support] = {}
    columns = ((Support.READ, read), (Support.LEFT_OUT, left_out), (Support.REFUSED, refused))
    for support, names in columns:
        for name in names.split():
            if table.setdefault(name, support) is not support:
                raise ValueError(f"{name} is both {table[name]!r} and {support!r}")
    return table
