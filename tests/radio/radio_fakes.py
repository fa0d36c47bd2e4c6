"""A world for radio tests: stations that a test moves, walls at x = 1, 2, 3 and so on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from usarsim_server.base.errors import SettingsError
from usarsim_server.base.tables import Table
from usarsim_server.protocol.values import Vector
from usarsim_server.radio.models import Propagation, create_model
from usarsim_server.radio.network import RadioWorld, Station


def model(name: str = "obstacle", **keys: object) -> Propagation:
    """A model with some keys set; others that it does not know are an error."""
    parameters = Table(keys, "test", SettingsError)
    made = create_model(name, parameters, "test")
    parameters.finish()
    return made


class Walls:
    """Counts walls that stand across the x axis."""

    def __init__(self, *places: float) -> None:
        self.places = places
        self.asked = 0

    def count(self, start: Vector, end: Vector) -> int:
        """Walls between two points."""
        self.asked += 1
        low, high = sorted((start[0], end[0]))
        return sum(low < place < high for place in self.places)

    def counts(self, start: Vector, ends: Sequence[Vector]) -> list[int]:
        """The same to many points."""
        return [self.count(start, end) for end in ends]


class Field:
    """Stations by name; a test moves them, empties their batteries and lets time pass."""

    def __init__(self, *walls: float, **places: float | Vector) -> None:
        self.walls = Walls(*walls)
        self.time = 0.0
        self.empty: set[str] = set()
        self.places: dict[str, Vector] = {}
        for name, place in places.items():
            self.put(name, place)

    def put(self, name: str, place: float | Vector) -> None:
        """Put a station somewhere, on the x axis if the place is a number."""
        self.places[name] = (float(place), 0.0, 0.0) if not isinstance(place, tuple) else place

    def stations(self) -> list[Station]:
        """All stations."""
        return [Station(name, at, name in self.empty) for name, at in self.places.items()]

    def world(self, speed: float = 1.0) -> RadioWorld:
        """What a network sees."""
        return RadioWorld(self.stations, self.walls, lambda: self.time, speed)


def rows(path: Path) -> list[list[str]]:
    """Lines of a record as fields, without the local time."""
    fields = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    return [[row[0], *row[2:]] for row in fields]


def decibels(distance: float, power: float, exponent: float, reference: float) -> float:
    """The log-distance law, written once more."""
    return power - 10 * exponent * (math.log(distance / reference) / math.log(10))
