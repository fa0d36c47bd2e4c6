"""The kinds of records of a run, and values of a record that was written by another program."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from usarsim_server.base.tables import shown

Record = dict[str, Any]
"""A line of a log: `seq`, `t_sim` (s), `t_wall` (s since the run began), `kind`, and facts."""

DERIVED = frozenset(
    {
        "zone",
        "collision",
        "victim_visible_begin",
        "victim_visible_end",
        "found",
        "credit",
        "duplicate",
        "wrong",
        "lost",
        "score",
    }
)
"""What the referee makes of the others; ignored when a run is scored again, and compared."""


def number(record: Mapping[str, Any], key: str) -> float:
    """A finite number.

    Raises:
        ValueError: it is none.
    """
    value = record.get(key)
    if isinstance(value, int | float) and math.isfinite(value):
        return float(value)
    raise _wrong(record, key, "a number")


def text(record: Mapping[str, Any], key: str) -> str:
    """A text, empty if it is absent.

    Raises:
        ValueError: it is something else.
    """
    value = record.get(key)
    if value is None or isinstance(value, str):
        return value or ""
    raise _wrong(record, key, "text")


def place(record: Mapping[str, Any], key: str) -> tuple[float, float, float] | None:
    """A place, m; None if it is not wholly known. Without z that is 0.

    Raises:
        ValueError: it is no list of two or three numbers.
    """
    value = record.get(key)
    if value is None or (isinstance(value, list | tuple) and None in value):
        return None
    good = isinstance(value, list | tuple) and len(value) in (2, 3)
    if not good or not all(isinstance(one, int | float) for one in value or ()):
        raise _wrong(record, key, "two or three numbers")
    x, y, z = (*value, 0.0)[:3]
    return (x, y, z) if all(map(math.isfinite, (x, y, z))) else None


def rows(record: Mapping[str, Any], key: str) -> Iterator[Mapping[str, Any]]:
    """A list of objects, empty if it is absent.

    Raises:
        ValueError: it is something else.
    """
    value = record.get(key) or ()
    if not isinstance(value, list | tuple) or not all(isinstance(one, Mapping) for one in value):
        raise _wrong(record, key, "a list of objects")
    yield from value


def _wrong(record: Mapping[str, Any], key: str, wanted: str) -> ValueError:
    return ValueError(f"{key}: {shown(record.get(key))} is not {wanted}")
