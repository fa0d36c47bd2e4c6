"""How soon the wireless simulation gets its answers, and what they cost."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

import numpy as np

from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.server import BenchError, CarefulClosing, Load, Server, load_between
from usarsim_bench.team import ROBOTS, SETTLE, load_figures
from usarsim_client import BlockingConnection, ProtocolError, command

SECONDS = 20.0
TURN = 1.0
"""s between two rounds of questions, as the propagation models of the original have it."""

MEDIAN_AIM = Aim("<", 10.0)
TAIL_AIM = Aim("<", 100.0)
CORES_AIM = Aim("<", 0.2)

_PATIENCE = 10.0


@dataclass(slots=True)
class _Answers:
    positions: list[float] = field(default_factory=list)
    obstacles: list[float] = field(default_factory=list)


class Asker(CarefulClosing):
    """Asks like a wireless simulation whose robots all move: each second for the positions, then
    for the obstacles of every ordered pair, one question after the other. On a thread of its own.

    Attributes:
        positions, obstacles: s from question to answer.
    """

    def __init__(self, port: int, names: Sequence[str]) -> None:
        """Connect and begin.

        Args:
            port: of ground truth.
            names: of the robots.

        Raises:
            BenchError: if nobody listens.
        """
        self._pairs = list(itertools.permutations(names, 2))
        self._answers = _Answers()
        self._failure: str | None = None
        self._stopping = threading.Event()
        try:
            self._connection = BlockingConnection(port, patience=_PATIENCE)
        except OSError as error:
            raise BenchError(f"ground truth cannot be reached: {error}") from None
        self._thread = threading.Thread(target=self._run, name="asker", daemon=True)
        self._thread.start()

    @property
    def positions(self) -> list[float]:
        """s from GETPOS to its answer."""
        return list(self._answers.positions)

    @property
    def obstacles(self) -> list[float]:
        """s from GETOBS to its answer."""
        return list(self._answers.obstacles)

    def finish(self) -> None:
        """Stop asking and hang up; a second call does nothing.

        Raises:
            BenchError: if an answer was missing or wrong.
        """
        self._stopping.set()
        self._thread.join(_PATIENCE)
        self._connection.close()
        if self._failure is not None:
            raise BenchError(self._failure)

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                begun = time.perf_counter()
                self._round()
                self._stopping.wait(max(0.0, TURN - (time.perf_counter() - begun)))
        except (OSError, ValueError, ProtocolError) as error:
            self._failure = f"ground truth does not answer: {error}"

    def _round(self) -> None:
        self._answers.positions.append(self._ask("GETPOS", "POSITIONS {Robots "))
        # Spread over the turn, so that the answers meet the physics at all stages of its work.
        pause = 0.5 * TURN / max(1, len(self._pairs))
        for start, end in self._pairs:
            if self._stopping.is_set():
                return
            head = f"NUMOBS {{From {start}}} {{To {end}}} {{ObstCount "
            taken = self._ask(f"GETOBS {{From {start}}} {{To {end}}}", head)
            self._answers.obstacles.append(taken)
            time.sleep(pause)

    def _ask(self, question: str, head: str) -> float:
        begun = time.perf_counter()
        answer = self._connection.ask(command(question)).text
        if not answer.startswith(head) or "{ObstCount -1" in answer:
            raise ValueError(f"{question!r} was answered {answer!r}")
        return time.perf_counter() - begun

    def close(self) -> None:
        """See `finish`."""
        self.finish()


def measure_groundtruth(plan: Plan) -> Section:
    """A team at real time, left alone and asked about; `plan.seconds` of wall time for each."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    with Server(plan.world, robots) as server, Crowd(server.port, plan.seed, keep=False) as crowd:
        port = server.ports.get("groundtruth")
        if port is None:
            raise BenchError("the server has no ground truth")
        for _ in range(robots):
            crowd.wait_until_speaking([crowd.join()])
        crowd.run(SETTLE)
        plan.say(f"groundtruth: {robots} robots, left alone, for {seconds:g} s")
        alone = _load(server, crowd, seconds)
        plan.say(f"groundtruth: asked about, for {seconds:g} s")
        with Asker(port, [one.name for one in crowd.controllers]) as asker:
            crowd.run(min(TURN, seconds / 4))
            asked_before = len(asker.obstacles)
            asked = _load(server, crowd, seconds)
            rate = (len(asker.obstacles) - asked_before) / seconds
    if not asker.positions:
        raise BenchError("nothing was answered")
    return Section(
        "groundtruth",
        "Ground truth for wireless simulation",
        f"{robots} {DEFAULT_CLASS} in {plan.world} at real time with random DRIVE commands; one "
        f"client asks each second for all positions and for the obstacles of every ordered pair, "
        f"one question after the other, {seconds:g} s.",
        (
            *_times("GETPOS", asker.positions),
            *_times("GETOBS", asker.obstacles),
            Figure("GETOBS answered", rate, "/s", 0),
            Figure("Cost of all answers", asked.process - alone.process, "cores", 3, CORES_AIM),
            *load_figures(asked),
        ),
    )


def _load(server: Server, crowd: Crowd, seconds: float) -> Load:
    before = server.usage()
    crowd.run(seconds)
    return load_between(before, server.usage())


def _times(question: str, taken: Sequence[float]) -> list[Figure]:
    if not taken:
        return []
    name = f"{question} to its answer"
    return [
        Figure(f"{name}, median", 1e3 * median(taken), "ms", 2, MEDIAN_AIM),
        Figure(f"{name}, 99th percentile", 1e3 * float(np.percentile(taken, 99.0)), "ms"),
        Figure(f"{name}, longest", 1e3 * max(taken), "ms", 2, TAIL_AIM),
    ]
