"""What one reading of every type of sensor costs, from the robot's state to the line of text.

Robots of a class that carries one sensor of each type drive around in a world without sockets. Now
and then all of them read one sensor, as the thread that serves them does it for robots whose
reports fall due together: the rays of all (`rays`), one batch of casting (`cast`), readings and
text of all (`text`). Times are processor times, so that other programs disturb them little, and
medians.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

import numpy as np

from usarsim_server.app import Assembly, assemble
from usarsim_server.protocol.values import Dialect
from usarsim_server.sensors.base import Sensor, sensor_types
from usarsim_server.sensors.report import Survey
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.settings import Settings
from usarsim_server.simulation.rays.cast import RayQuery
from usarsim_server.simulation.rays.query import RayHits

ROBOT_CLASS = "P3AT"
CARRIER = "SensorCarrier"
SETTLE = 1.0
PAUSE = 0.2
"""Simulated s between two rounds in which every sensor is read once."""
PLACE = "position = [0.2, 0, -0.3]"
"""Above the deck (wire frame), where there is something to see."""
NEEDED = {"Encoder": "wheel = 0"}
"""Keys without which a type cannot be used."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One type; us of processor time per reading.

    Attributes:
        type: as robot files name it.
        count: rays of a reading, at the most.
        rays, cast, text: see the module.
        alone: all three, for one robot whose report falls due alone.
    """

    type: str
    count: int
    rays: float
    cast: float
    text: float
    alone: float

    @property
    def whole(self) -> float:
        """All three together."""
        return self.rays + self.cast + self.text


def measure(world: str, robots: int, rounds: int) -> list[Reading]:
    """Read every type so often; dearest first. Types that never had anything to say are left out.

    Raises:
        UsarsimError: if the world cannot be used.
    """
    with tempfile.TemporaryDirectory() as name:
        _write_carrier(Path(name))
        assembly = _assembly(world, Path(name), robots)
    try:
        vehicles = assembly.fleet.vehicles
        found = [_Timed(index, label) for index, label in _distinct(vehicles[0].sensors)]
        for round_ in range(rounds + 1):
            assembly.simulation.run_until(SETTLE + PAUSE * round_)
            for one in found:
                # The first round warms up.
                one.read(assembly, vehicles, keep=round_ > 0)
    finally:
        assembly.stop()
    return sorted(
        (one.summed_up() for one in found if one.lines), key=lambda reading: -reading.whole
    )


class _Timed:
    """The times of one sensor, by its place in the robot file.

    Attributes:
        lines: written so far.
    """

    def __init__(self, index: int, label: str) -> None:
        self.lines = 0
        self._index, self._label = index, label
        self._count = 0
        self._parts: list[tuple[float, float, float]] = []
        self._alone: list[float] = []

    def read(self, assembly: Assembly, vehicles: Sequence[Vehicle], keep: bool) -> None:
        """Read it on all robots together, then on the first alone."""
        parts = self._read(assembly, vehicles)
        alone = sum(self._read(assembly, vehicles[:1]))
        if keep:
            self._parts.append(parts)
            self._alone.append(alone)

    def _read(self, assembly: Assembly, vehicles: Sequence[Vehicle]) -> tuple[float, float, float]:
        snapshot = assembly.simulation.look()
        states = [(one, state) for one in vehicles if (state := one.state(snapshot)) is not None]
        moments = [time.thread_time()]
        surveys = [Survey([one.sensors[self._index]], state) for one, state in states]
        queries = [
            RayQuery(survey.fans, one.robot)
            for survey, (one, _) in zip(surveys, states, strict=True)
        ]
        moments.append(time.thread_time())
        hits: Sequence[Sequence[RayHits]] = [()] * len(queries)
        if any(query.fans for query in queries):
            hits = assembly.simulation.cast_all(queries, snapshot)
        moments.append(time.thread_time())
        for survey, answers in zip(surveys, hits, strict=True):
            for line in survey.lines(answers, Dialect.UDK):
                line.encode("latin-1")
                self.lines += 1
        moments.append(time.thread_time())
        counts = (sum(len(fan.directions) for fan in query.fans) for query in queries)
        self._count = max(self._count, *counts, 0)
        a, b, c, d = (moment / len(states) for moment in moments)
        return b - a, c - b, d - c

    def summed_up(self) -> Reading:
        """The medians."""
        rays, cast, text = (1e6 * median(part) for part in zip(*self._parts, strict=True))
        return Reading(self._label, self._count, rays, cast, text, 1e6 * median(self._alone))


def _distinct(sensors: Sequence[Sensor]) -> list[tuple[int, str]]:
    """Place and best name of one sensor of each kind: many types are other spellings."""
    found: dict[type[Sensor], list[tuple[int, str]]] = {}
    types = frozenset(sensor_types())
    for index, sensor in enumerate(sensors):
        if sensor.name not in types:
            continue  # inherited from the class that the carrier extends
        found.setdefault(type(sensor), []).append((index, sensor.name))
    return [
        next((one for one in many if one[1].lower() == kind.__name__.lower()), many[0])
        for kind, many in found.items()
    ]


def _write_carrier(folder: Path) -> None:
    rows = [
        f'{{ type = "{one}", name = "{one}", {", ".join(filter(None, (PLACE, NEEDED.get(one))))} }}'
        for one in sensor_types()
    ]
    sensors = "".join(f"    {row},\n" for row in rows)
    text = f'extends = "{ROBOT_CLASS}"\nsensor = [\n{sensors}]\n'
    (folder / f"{CARRIER}.toml").write_text(text, encoding="utf-8")


def _assembly(world: str, folder: Path, robots: int) -> Assembly:
    assembly = assemble(
        Settings(
            world=world,
            robots=(folder,),
            max_robots=robots,
            speed=math.inf,
            port=None,
            image_port=None,
            groundtruth_port=None,
            wireless_port=None,
            truth_port=None,
        )
    )
    carrier = assembly.fleet.describe(CARRIER)
    assert carrier is not None  # just written
    starts = assembly.world.starts
    for number in range(robots):
        vehicle = assembly.fleet.spawn(carrier, None, starts[number % len(starts)].pose)
        wheels = carrier.driven_wheels
        vehicle.drive(np.array([0.6 if wheel.side == "left" else 1.2 for wheel in wheels]))
    return assembly


def main(arguments: Sequence[str]) -> int:
    """Measure, and print one JSON object per type, dearest first."""
    parser = argparse.ArgumentParser(prog="python -m usarsim_bench.instruments.readings")
    parser.add_argument("--world", default="arena", help="name or folder (default arena)")
    parser.add_argument("--robots", type=int, default=16, help="that read together (default 16)")
    parser.add_argument("--rounds", type=int, default=20, help="readings of each (default 20)")
    given = parser.parse_args(arguments)
    for reading in measure(given.world, given.robots, given.rounds):
        print(json.dumps({**asdict(reading), "whole": reading.whole}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
