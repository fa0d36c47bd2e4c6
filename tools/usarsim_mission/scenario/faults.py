"""Finds all faults of a scenario file at once, where reading it would end with the first.

Whenever something is wrong, it is noted and taken out, and the file is read again without it: a
key, or a whole entry that cannot do without that key. What is only wrong because of that is not
told.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

from usarsim_mission.errors import MissionError
from usarsim_mission.scenario.check import findings
from usarsim_mission.scenario.description import SCHEMA, Scenario
from usarsim_mission.scenario.reader import scenario_of
from usarsim_mission.scenario.staging import Staged
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.toml import parse_toml, read_text

MOST = 100
"""Faults that are told."""
MOST_READ = 16 << 20
"""Characters that are read for that in all: of a large file fewer faults are told."""
_STAND_INS: dict[str, Any] = {"schema": SCHEMA, "title": "-", "world": "empty"}
"""What a file cannot do without."""
_ANYWHERE = {
    "name": "-",
    "position": [0.0, 0.0, 0.12],
    "polygon": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
    "x": [0.0, 1.0],
    "y": [0.0, 1.0],
}
"""What an entry cannot do without: its place then means nothing, and is not looked at."""
_PLACE = frozenset({*_ANYWHERE, "start", "yaw_degrees", "place"})

Spot = tuple[str | int, ...]


def faults(path: Path, stage: Callable[[Scenario], Staged]) -> tuple[list[UsarsimError], Staged]:
    """Everything that is wrong with a scenario file, in the order of its lines.

    Args:
        path: of the file. stage: puts a scenario into its world.

    Returns:
        The faults, and if there is none, the scenario in its world.

    Raises:
        MissionError: it cannot be read, is no TOML or says nothing; or the only fault.
    """
    text = read_text(path, MissionError)
    content = deepcopy(dict(parse_toml(text, path, MissionError, "robot")))
    found: list[UsarsimError] = []
    gone = _Gone(content)
    most = max(1, min(MOST, MOST_READ // len(text)))
    while len(found) < most:
        try:
            scenario = scenario_of(content, text, path)
            if "world" in gone.top:
                break
            staged = stage(scenario)
        except UsarsimError as error:
            if not gone.explains(error):
                found.append(error)
            if not gone.take_out(error.spot):
                break
        else:
            found += [one for one in findings(staged) if not gone.explains(one)]
            return sorted(found, key=_line), staged
    if not found:
        raise MissionError(f"{path}: cannot be read (mend it)")
    raise FaultsError(sorted(found, key=_line))


def _line(error: UsarsimError) -> float:
    told = re.search(r": line (\d+): ", str(error))
    return float(told[1]) if told else math.inf


class FaultsError(MissionError):
    """Several faults; without a scenario that could be put into its world."""

    def __init__(self, all: list[UsarsimError]) -> None:
        super().__init__("\n".join(map(str, all)))
        self.all = all


class _Gone:
    """What was taken out of a file."""

    def __init__(self, content: dict[str, Any]) -> None:
        self._content = content
        self._spots: set[Spot] = set()
        self._names: set[str] = set()
        self._moved: set[Spot] = set()
        self.top: set[str] = set()
        """Keys of the top that have stand-ins."""

    def explains(self, error: UsarsimError) -> bool:
        """Whether something is wrong only because of what was taken out."""
        spot = error.spot
        if any(one[: len(spot)] == spot for one in self._spots if spot):
            return len(spot) != 1 or spot in self._spots or spot[0] in ("victim", "robot", "place")
        if any(repr(name) in str(error) for name in self._names):
            return True
        about = spot[-1] if spot and isinstance(spot[-1], str) else "place"
        return spot[:2] in self._moved and about in _PLACE

    def take_out(self, spot: Spot) -> bool:
        """Take out what is there, or what cannot do without it; False if that is the file."""
        if not spot:
            return False
        holder: Any = self._content
        for part in spot[:-1]:
            holder = holder[part]
        key, again = spot[-1], spot in self._spots
        self._spots.add(spot)
        if key == "start":
            holder.pop(key, None)
            key = "position"
        if not again and len(spot) == 3 and key in _ANYWHERE:
            holder[key] = f"entry {spot[1]}" if key == "name" else _ANYWHERE[str(key)]
            self._moved.add(spot[:2])
        elif not again and isinstance(key, str) and key in holder and key not in _STAND_INS:
            del holder[key]
        elif len(spot) > 1 and isinstance(spot[1], int):
            self._take_entry(spot[:2])
        elif key in _STAND_INS and key not in self.top:
            self.top.add(str(key))
            holder[key] = _STAND_INS[str(key)]
        else:
            return False
        return True

    def _take_entry(self, entry: Spot) -> None:
        entries = self._content[str(entry[0])]
        if isinstance(name := entries[entry[1]].get("name"), str):
            self._names.add(name)
        entries[entry[1]] = None
        self._spots.add(entry)
