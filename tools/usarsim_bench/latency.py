"""How long a DRIVE command takes from the client's socket to the wheels."""

from __future__ import annotations

import json
import random
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

from usarsim_bench.crowd import DEFAULT_CLASS, DRIVE_PERIOD, Controller, Crowd
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.procfs import load_between
from usarsim_bench.server import Server
from usarsim_bench.statistics import percentile
from usarsim_bench.team import ROBOTS, SETTLE, load_figures

SAMPLES = 640
"""Commands to measure unless a time is given; 99th percentiles want some hundreds."""

MEDIAN_AIM = Aim("<", 10.0)
TAIL_AIM = Aim("<", 30.0)

_INSTRUMENT = "usarsim_bench.instruments.latency"
_LEAST, _MOST = 30_000, 120_000
"""Codes used: wheel speeds from 0.3 to 1.2 rad/s in steps of 1e-5, which every class can run."""
_NAME = "DRIVE on the socket to changed target speed"
_STATIONS = {
    "received": "... until the server has read it",
    "posted": "... until the robot's thread has decided",
    "target": "... until the target speed has changed",
    "stepped": "... until a step of the physics uses it",
}
_SIGNS = ((1, 1), (1, -1), (-1, -1), (-1, 1))


class CodedDriver:
    """Drives with a wheel speed that is used once only, so that its command is known again.

    Attributes:
        sent: wall time just before sending, by code.
    """

    def __init__(self) -> None:
        self.sent: dict[int, float] = {}
        self._next = _LEAST

    def __call__(self, controller: Controller, dice: random.Random) -> None:
        """Send the next command.

        Raises:
            BenchError: once all codes have been used.
        """
        if self._next > _MOST:
            raise BenchError(f"more than {_MOST - _LEAST} commands cannot be told apart")
        number, self._next = self._next, self._next + 1
        left, right = dice.choice(_SIGNS)
        speed = number * 1e-5
        self.sent[number] = controller.send(
            f"DRIVE {{Left {left * speed:.5f}}} {{Right {right * speed:.5f}}}"
        )


def delays(sent: Mapping[int, float], passed: Sequence[tuple[int, float]]) -> list[float]:
    """Seconds from sending to passing a station, of the commands that passed it."""
    first: dict[int, float] = {}
    for number, moment in passed:
        first.setdefault(number, moment)
    return [first[number] - moment for number, moment in sent.items() if number in first]


def measure_latency(plan: Plan) -> Section:
    """Latency of DRIVE in a team at real time; `plan.seconds` of wall time are watched."""
    robots = plan.robots or ROBOTS
    seconds = plan.seconds or SAMPLES * DRIVE_PERIOD / robots
    plan.say(f"latency: {robots} robots for {seconds:g} s")
    driver = CodedDriver()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "stations.json")
        command = (_INSTRUMENT, str(file), "serve")
        with (
            Server(plan.world, robots, command) as server,
            Crowd(server.port, plan.seed, driver) as crowd,
        ):
            for _ in range(robots):
                crowd.wait_until_speaking([crowd.join()])
            crowd.run(SETTLE)
            driver.sent.clear()
            before = server.usage()
            crowd.run(seconds)
            after = server.usage()
            sent = dict(driver.sent)
            # What was sent last has to arrive before the server ends.
            crowd.run(SETTLE / 2)
        record = json.loads(file.read_text())
    total = delays(sent, record["target"])
    if not total:
        raise BenchError("no command reached the wheels")
    return Section(
        "latency",
        "Latency of DRIVE",
        f"{robots} {DEFAULT_CLASS} in {plan.world} at real time, random DRIVE commands at 2 Hz "
        f"each from another process, {seconds:g} s; medians of the stations are counted from "
        "sending.",
        (
            Figure(f"{_NAME}, median", 1e3 * median(total), "ms", 2, MEDIAN_AIM),
            Figure(f"{_NAME}, 99th percentile", 1e3 * percentile(total, 99.0), "ms", 2, TAIL_AIM),
            Figure(f"{_NAME}, longest", 1e3 * max(total), "ms"),
            Figure("Commands measured", len(total), "", 0),
            Figure("Commands lost", len(sent) - len(total), "", 0, Aim("<=", 0)),
            *_stations(sent, record),
            *load_figures(load_between(before, after)),
        ),
    )


def _stations(
    sent: Mapping[int, float], record: Mapping[str, Sequence[tuple[int, float]]]
) -> list[Figure]:
    figures = []
    for station, name in _STATIONS.items():
        found = delays(sent, record[station])
        if found:
            figures.append(Figure(f"{name}, median", 1e3 * median(found), "ms"))
            figures.append(Figure(f"{name}, 99th", 1e3 * percentile(found, 99.0), "ms"))
    return figures
