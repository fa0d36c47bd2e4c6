"""How rows of the truth stand in a log: a mission of 16 robots tells 12000 of them.

Views that the rules do not count are left out for good: off the middle of the picture, or hidden.
What else is saved is there again when the row is read: victims that are where they were in the row
before, and the names of what is told of a robot and of a view.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from usarsim_mission.records import Record
from usarsim_mission.scoring import Rules

_LEAST = 30.0
"""Degrees off the middle of a picture: what is nearer to it is kept whatever the rules are."""
_ROBOT = ("pos", "quat", "linear", "angular", "battery")
_VIEW = ("robot", "victim", "angle", "distance", "clear")


class Thinner:
    """Leaves views out that no rule counts."""

    def __init__(self, rules: Rules) -> None:
        """Know the rules."""
        self._widest = math.radians(max(_LEAST, rules.victims.half_angle))
        self._hidden = not rules.victims.line_of_sight

    def thin(self, record: Mapping[str, Any]) -> Record:
        """A row with the views that count; what is no view is kept."""
        views = record.get("views")
        if not isinstance(views, list | tuple):
            return dict(record)
        return {**record, "views": [one for one in views if self._counts(one)]}

    def _counts(self, view: Any) -> bool:
        if not isinstance(view, Mapping):
            return True
        angle, clear = view.get("angle"), view.get("clear")
        wide = isinstance(angle, int | float) and angle > self._widest
        return not wide and (clear is not False or self._hidden)


class Packer:
    """Makes what stands in the log of rows, one after the other."""

    def __init__(self) -> None:
        self._victims: Any = None

    def pack(self, row: Record) -> Record:
        """The next row, as plain JSON has it."""
        packed = dict(row)
        if "victims" in packed and packed["victims"] == self._victims:
            del packed["victims"]
        self._victims = row.get("victims", self._victims)
        for key, (short, long) in _WAYS.items():
            if key in packed:
                told = short(packed[key])
                packed[key] = told if long(told) == packed[key] else packed[key]
        return packed


class Unpacker:
    """The rows again, of what stands in a log."""

    def __init__(self) -> None:
        self._victims: Any = None

    def unpack(self, packed: Record) -> Record:
        """The next row; one that stands there as it came stays as it is.

        Raises:
            AttributeError, TypeError, ValueError: it is none.
        """
        row = {**packed}
        if "victims" not in row and self._victims is not None:
            row["victims"] = self._victims
        self._victims = row.get("victims")
        for key, (_, long) in _WAYS.items():
            if key in row:
                row[key] = long(row[key])
        return row


def _short_robots(robots: Any) -> Any:
    """What is told of each robot, by name; what it has touched stands last, if it has."""
    short = {}
    for robot in robots if isinstance(robots, list) else ():
        if not isinstance(robot, dict) or robot.keys() != {"name", *_ROBOT, "contacts"}:
            return robots
        touched = [robot["contacts"]] if robot["contacts"] else []
        short[str(robot["name"])] = [*(robot[key] for key in _ROBOT), *touched]
    return short


def _long_robots(short: Any) -> Any:
    if not isinstance(short, dict):
        return short
    found = []
    for name, (*told, last) in short.items():
        facts = [*told, last] if len(told) < len(_ROBOT) else told
        touched = [] if len(told) < len(_ROBOT) else last
        named = dict(zip(_ROBOT, facts, strict=True))
        found.append({"name": name, **named, "contacts": touched})
    return found


def _short_views(views: Any) -> Any:
    """Angle and distance by robot and victim; a third value says that nobody is in sight."""
    short: dict[str, dict[str, list[object]]] = {}
    for view in views if isinstance(views, list) else ():
        if not isinstance(view, dict) or view.keys() != set(_VIEW):
            return views
        told = [view["angle"], view["distance"], *([] if view["clear"] is True else [False])]
        short.setdefault(str(view["robot"]), {})[str(view["victim"])] = told
    return short


def _long_views(short: Any) -> Any:
    if not isinstance(short, dict):
        return short
    return [
        dict(zip(_VIEW, (robot, victim, angle, distance, not hidden), strict=True))
        for robot, victims in short.items()
        for victim, (angle, distance, *hidden) in victims.items()
    ]


_WAYS = {"robots": (_short_robots, _long_robots), "views": (_short_views, _long_views)}
"""By what it tells of: how it is made short, and long again; kept long where that differs."""
