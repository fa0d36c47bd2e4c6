"""Marks of operators: which victim each one tells of.

A mark is valid if it is the first that stands within the tolerance of a victim, measured on the
floor; a later one there is a duplicate, any other is wrong. A mark that is moved is judged as a new
one, and one that is deleted stands no more: what counts is the list as it would be handed in.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from usarsim_mission import records
from usarsim_mission.model import Victim

Place = tuple[float, float, float]

VALID, DUPLICATE, WRONG = "valid", "duplicate", "wrong"


@dataclass(slots=True)
class Mark:
    """One mark.

    Attributes:
        robot: with which it was made; empty if with none.
        place: m; None if it is not known.
        verdict: one of `VALID`, `DUPLICATE`, `WRONG`.
        victim: that it tells of, if it is not wrong.
    """

    number: int | str
    robot: str
    place: Place | None
    status: str = ""
    note: str = ""
    verdict: str = WRONG
    victim: str = ""


class Marks:
    """All marks that stand, in the order in which they were set or moved last."""

    def __init__(self, victims: tuple[Victim, ...], tolerance: float) -> None:
        self._status = {victim.name: victim.status for victim in victims}
        self._tolerance = tolerance
        self._marks: dict[int | str, Mark] = {}

    def set(self, record: Mapping[str, Any], places: Mapping[str, Place]) -> Mark:
        """A new mark, judged by where the victims are now."""
        mark = Mark(
            _number(record),
            records.text(record, "robot"),
            records.place(record, "place"),
            records.text(record, "status"),
            records.text(record, "note"),
        )
        self._marks.pop(mark.number, None)
        self._judge(mark, places)
        self._marks[mark.number] = mark
        return mark

    def edit(self, record: Mapping[str, Any], places: Mapping[str, Place]) -> Mark | None:
        """A mark is changed; returned if it was moved, which is to set it anew."""
        mark = self._marks.get(_number(record))
        if mark is None:
            return None
        mark.status = records.text(record, "status") if "status" in record else mark.status
        mark.note = records.text(record, "note") if "note" in record else mark.note
        if "place" not in record:
            return None
        mark.place = records.place(record, "place")
        del self._marks[mark.number]
        self._judge(mark, places)
        self._marks[mark.number] = mark
        return mark

    def delete(self, record: Mapping[str, Any]) -> Mark | None:
        """A mark stands no more."""
        return self._marks.pop(_number(record), None)

    def heir(self, victim: str) -> Mark | None:
        """Make the oldest duplicate of a victim valid that has lost its valid mark."""
        of_it = [one for one in self._marks.values() if one.victim == victim]
        if not of_it or any(one.verdict == VALID for one in of_it):
            return None
        of_it[0].verdict = VALID
        return of_it[0]

    def valid(self) -> Iterator[Mark]:
        """Those that tell of a victim first."""
        return (one for one in self._marks.values() if one.verdict == VALID)

    def standing(self) -> list[Mark]:
        """All that were not deleted, as they would be handed in."""
        return list(self._marks.values())

    def wrong(self) -> int:
        """How many tell of nobody."""
        return sum(one.verdict == WRONG for one in self._marks.values())

    def names(self, mark: Mark) -> bool:
        """Whether a mark names its victim, as a word of its note or status."""
        words = re.findall(r"[\w.+-]+", f"{mark.note} {mark.status}".casefold())
        return mark.victim.casefold() in words

    def tells_status(self, mark: Mark) -> bool:
        """Whether a mark tells the status of its victim."""
        true = self._status.get(mark.victim, "").strip().casefold()
        return bool(true) and mark.status.strip().casefold() == true

    def _judge(self, mark: Mark, places: Mapping[str, Place]) -> None:
        mark.verdict, mark.victim = WRONG, ""
        if mark.place is None:
            return
        x, y, _ = mark.place
        gaps = {name: math.hypot(at[0] - x, at[1] - y) for name, at in places.items()}
        near = sorted((gap, name) for name, gap in gaps.items() if gap <= self._tolerance)
        if not near:
            return
        taken = {one.victim for one in self.valid()}
        # Between two victims a mark tells of the one that nobody has told of.
        mark.victim = next((name for _, name in near if name not in taken), near[0][1])
        mark.verdict = DUPLICATE if mark.victim in taken else VALID


def _number(record: Mapping[str, Any]) -> int | str:
    number = record.get("mark")
    return number if isinstance(number, int) else str(number)
