"""How long a DRIVE command takes from the client's socket to the wheels.

`python -m benchmarks.latency FILE serve ...` is `usarsim serve ...` with stopwatches: when it
ends, it writes at which moments every command passed four stations. Commands are told apart by the
wheel speed they ask for: a client that sends a speed of its own with each can put its own clock's
reading beside them, because the clock is shared by all processes of the machine (on Linux
`time.perf_counter` reads CLOCK_MONOTONIC).
"""

from __future__ import annotations

import json
import random
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.measures import p99
from benchmarks.plan import Plan
from benchmarks.server import Server, load_between
from benchmarks.team import ROBOTS, SETTLE, gather, load_figures
from usarsim_bench.crowd import DEFAULT_CLASS, DRIVE_PERIOD, Controller, Crowd
from usarsim_bench.figures import Aim, BenchError, Figure, Section, in_ms
from usarsim_server.cli import main as usarsim
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.grammar import Command
from usarsim_server.protocol.json_text import parse_json
from usarsim_server.protocol.requests import Drive
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.testing import Session

STATIONS = ("received", "posted", "target", "stepped")
"""Handed to the robot's thread; decided by it; set as the wheels' target speed between two steps of
the physics; taken up by the first step after that."""

CODE_SCALE = 1e5
"""Codes per rad/s: speeds are told apart by their first five digits after the point."""

Record = dict[str, list[tuple[int, float]]]
"""Code and moment (s, `time.perf_counter`) of every command, by station."""

Array = NDArray[np.float64]


def code(speed: float) -> int:
    """The number that a command with this wheel speed (rad/s, either sign) bears."""
    return round(abs(speed) * CODE_SCALE)


@contextmanager
def instrumented() -> Iterator[Record]:
    """While inside, every server in this process records when DRIVE commands pass the stations."""
    record: Record = {station: [] for station in STATIONS}
    waiting: list[int] = []
    patch = mock.patch.object
    with (
        patch(Session, "submit", _on_submit(Session.submit, record["received"])),
        patch(BodyHandle, "drive", _on_post(BodyHandle.drive, record["posted"])),
        patch(Engine, "drive", _on_target(Engine.drive, record["target"], waiting)),
        patch(Engine, "advance", _on_step(Engine.advance, record["stepped"], waiting)),
    ):
        yield record


Passed = list[tuple[int, float]]


def _on_submit(
    original: Callable[[Session, list[Command]], None], passed: Passed
) -> Callable[[Session, list[Command]], None]:
    def submit(session: Session, commands: list[Command]) -> None:
        moment = time.perf_counter()
        original(session, commands)
        for request in map(interpret, commands):
            if isinstance(request, Drive) and request.left is not None:
                passed.append((code(request.left), moment))

    return submit


def _on_post(
    original: Callable[[BodyHandle, Array], None], passed: Passed
) -> Callable[[BodyHandle, Array], None]:
    def drive(body: BodyHandle, targets: Array) -> None:
        passed.append((code(targets[0]), time.perf_counter()))
        original(body, targets)

    return drive


def _on_target(
    original: Callable[[Engine, int, Array], None], passed: Passed, waiting: list[int]
) -> Callable[[Engine, int, Array], None]:
    def drive(engine: Engine, robot: int, targets: Array) -> None:
        original(engine, robot, targets)
        waiting.append(code(targets[0]))
        passed.append((waiting[-1], time.perf_counter()))

    return drive


def _on_step(
    original: Callable[[Engine, int], list[int]], passed: Passed, waiting: list[int]
) -> Callable[[Engine, int], list[int]]:
    def advance(engine: Engine, steps: int) -> list[int]:
        if waiting:
            moment = time.perf_counter()
            passed.extend((number, moment) for number in waiting)
            waiting.clear()
        return original(engine, steps)

    return advance


def main(arguments: Sequence[str]) -> int:
    """Run `usarsim` with all words but the first, the file to write; returns its exit code."""
    file, *rest = arguments
    with instrumented() as record:
        result = usarsim(rest)
    Path(file).write_text(json.dumps(record))
    return result


SAMPLES = 640
"""Commands to measure unless a time is given; 99th percentiles want some hundreds."""

MEDIAN_AIM = Aim("<", 10.0)
TAIL_AIM = Aim("<", 30.0)

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
        command = ("benchmarks.latency", str(file), "serve")
        with (
            Server(plan.world, robots, serve=command) as server,
            Crowd(server.port, plan.seed, driver) as crowd,
        ):
            gather(crowd, robots, (DEFAULT_CLASS,))
            crowd.run(SETTLE)
            driver.sent.clear()
            before = server.usage()
            crowd.run(seconds)
            after = server.usage()
            sent = dict(driver.sent)
            # What was sent last has to arrive before the server ends.
            crowd.run(SETTLE / 2)
        record = parse_json(file.read_text())
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
            in_ms(f"{_NAME}, median", median(total), 2, MEDIAN_AIM),
            in_ms(f"{_NAME}, 99th percentile", p99(total), 2, TAIL_AIM),
            in_ms(f"{_NAME}, longest", max(total)),
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
            figures += [in_ms(f"{name}, median", median(found)), in_ms(f"{name}, 99th", p99(found))]
    return figures


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
