"""A server with stopwatches on the way of a DRIVE command.

`python -m usarsim_bench.instruments.latency FILE serve ...` is `usarsim serve ...` that writes,
when it ends, at which moments every command passed four stations. Commands are told apart by the
wheel speed they ask for: a client that sends a speed of its own with each can put its own clock's
reading beside them, because the clock is shared by all processes of the machine (on Linux
`time.perf_counter` reads CLOCK_MONOTONIC).
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_server.cli import main as usarsim
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.grammar import Command
from usarsim_server.protocol.requests import Drive
from usarsim_server.sessions.session import RobotAgent
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.simulation import BodyHandle

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
    originals = (
        (RobotAgent, "submit", RobotAgent.submit),
        (BodyHandle, "drive", BodyHandle.drive),
        (Engine, "drive", Engine.drive),
        (Engine, "advance", Engine.advance),
    )
    waiting: list[int] = []
    try:
        setattr(RobotAgent, "submit", _on_submit(RobotAgent.submit, record["received"]))  # noqa: B010
        setattr(BodyHandle, "drive", _on_post(BodyHandle.drive, record["posted"]))  # noqa: B010
        setattr(Engine, "drive", _on_target(Engine.drive, record["target"], waiting))  # noqa: B010
        setattr(Engine, "advance", _on_step(Engine.advance, record["stepped"], waiting))  # noqa: B010
        yield record
    finally:
        for owner, name, original in originals:
            setattr(owner, name, original)


def _on_submit(
    original: Callable[[RobotAgent, list[Command]], None], passed: list[tuple[int, float]]
) -> Callable[[RobotAgent, list[Command]], None]:
    def submit(agent: RobotAgent, commands: list[Command]) -> None:
        moment = time.perf_counter()
        original(agent, commands)
        for command in commands:
            request = interpret(command)
            if isinstance(request, Drive) and request.left is not None:
                passed.append((code(request.left), moment))

    return submit


def _on_post(
    original: Callable[[BodyHandle, Array], None], passed: list[tuple[int, float]]
) -> Callable[[BodyHandle, Array], None]:
    def drive(body: BodyHandle, targets: Array) -> None:
        passed.append((code(targets[0]), time.perf_counter()))
        original(body, targets)

    return drive


def _on_target(
    original: Callable[[Engine, int, Array], None],
    passed: list[tuple[int, float]],
    waiting: list[int],
) -> Callable[[Engine, int, Array], None]:
    def drive(engine: Engine, robot: int, targets: Array) -> None:
        original(engine, robot, targets)
        number = code(targets[0])
        passed.append((number, time.perf_counter()))
        waiting.append(number)

    return drive


def _on_step(
    original: Callable[[Engine, int], list[int]],
    passed: list[tuple[int, float]],
    waiting: list[int],
) -> Callable[[Engine, int], list[int]]:
    def advance(engine: Engine, steps: int) -> list[int]:
        if waiting:
            moment = time.perf_counter()
            passed.extend((number, moment) for number in waiting)
            waiting.clear()
        return original(engine, steps)

    return advance


def main(arguments: Sequence[str]) -> int:
    """Run a subcommand of `usarsim` with stopwatches; returns its exit code.

    Args:
        arguments: the file to write, then those of `usarsim`.
    """
    file, *rest = arguments
    with instrumented() as record:
        result = usarsim(rest)
    Path(file).write_text(json.dumps(record))
    return result


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
