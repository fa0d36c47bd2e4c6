"""Places that operators have marked: victims as they see them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

MOST = 1000
"""Marks of a session."""


class Marks:
    """All marks, by number."""

    def __init__(self) -> None:
        self._marks: dict[int, dict[str, object]] = {}
        self._count = 0

    def set(self, fields: Mapping[str, Any], by: str, time: float) -> int:
        """Add one.

        Raises:
            ValueError: if there are too many.
        """
        if len(self._marks) >= MOST:
            raise ValueError(f"there are {MOST} marks already: delete some")
        self._count += 1
        self._marks[self._count] = {
            "id": self._count,
            "robot": fields["robot"],
            "place": list(fields["place"]),
            "status": fields.get("status", ""),
            "note": fields.get("note", ""),
            "by": by,
            "time": time,
        }
        return self._count

    def edit(self, number: int, fields: Mapping[str, Any]) -> None:
        """Change what is given of place, status and note.

        Raises:
            ValueError: if there is no such mark.
        """
        if number not in self._marks:
            raise ValueError(f"there is no mark {number}")
        for key in ("place", "status", "note"):
            if key in fields:
                value = fields[key]
                self._marks[number][key] = list(value) if key == "place" else value

    def delete(self, number: int) -> None:
        """Remove one; as `edit`."""
        if self._marks.pop(number, None) is None:
            raise ValueError(f"there is no mark {number}")

    def clear(self) -> None:
        """Remove all; numbers go on."""
        self._marks.clear()

    def row(self, number: int) -> dict[str, object]:
        """One that is there."""
        return self._marks[number]

    def rows(self) -> list[dict[str, object]]:
        """All of them, as `state` tells them."""
        return list(self._marks.values())

    def places(self) -> list[tuple[float, float]]:
        """Where they are on the map, x and y in metres."""
        places = (cast(list[float], one["place"]) for one in self._marks.values())
        return [(x, y) for x, y, *_ in places]
