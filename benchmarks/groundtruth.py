"""How soon the wireless simulation gets its answers, and what they cost."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Sequence
from statistics import median

from benchmarks.measures import p99
from benchmarks.plan import Plan
from benchmarks.server import CarefulClosing, Load, Server, load_between
from benchmarks.team import ROBOTS, SETTLE, gather, load_figures
from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.figures import Aim, BenchError, Figure, Section, in_ms
from usarsim_client import BlockingConnection, ProtocolError, command

SECONDS = 20.0
_ANSWER_TIMEOUT = 60.0
TURN = 1.0
"""s between two rounds of questions, as the propagation models of the original have it."""

MEDIAN_AIM = Aim("<", 10.0)
TAIL_AIM = Aim("<", 100.0)
CORES_AIM = Aim("<", 0.2)


class Asker(CarefulClosing):
    """Asks like a wireless simulation whose robots all move: each second for the positions, then
    for the obstacles of every ordered pair, one question after the other. On a thread of its own.

    Attributes:
        positions, obstacles: s from question to answer.
    """

    def __init__(self, port: int, names: Sequence[str]) -> None:
        """Connect to ground truth and begin to ask about robots by their names.

        Raises:
            OSError: if nobody listens.
        """
        self._pairs = list(itertools.permutations(names, 2))
        self.positions: list[float] = []
        self.obstacles: list[float] = []
        self._failure: Exception | None = None
        self._stop = threading.Event()
        self._connection = BlockingConnection(port, patience=_ANSWER_TIMEOUT)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop asking and hang up, once the last answer is there; a second call does nothing.

        Raises:
            BenchError: if the server failed this client at any time.
        """
        self._stop.set()
        self._thread.join(_ANSWER_TIMEOUT)
        self._connection.close()
        if self._failure is not None:
            raise BenchError(f"a client of ground truth was failed: {self._failure}")

    def _run(self) -> None:
        due = time.perf_counter()
        try:
            while not self._stop.wait(max(0.0, due - time.perf_counter())):
                self._ask()
                # A client that was held up does not ask in bursts.
                due = max(due + TURN, time.perf_counter())
        except (OSError, ValueError, ProtocolError) as error:
            self._failure = error

    def _ask(self) -> None:
        self.positions.append(self._time("GETPOS", "POSITIONS {Robots "))
        # Spread over the turn, so that the answers meet the physics at all stages of its work.
        pause = 0.5 * TURN / max(1, len(self._pairs))
        for start, end in self._pairs:
            if self._stop.is_set():
                return
            head = f"NUMOBS {{From {start}}} {{To {end}}} {{ObstCount "
            self.obstacles.append(self._time(f"GETOBS {{From {start}}} {{To {end}}}", head))
            time.sleep(pause)

    def _time(self, question: str, head: str) -> float:
        begun = time.perf_counter()
        answer = self._connection.ask(command(question)).text
        if not answer.startswith(head) or "{ObstCount -1" in answer:
            raise ValueError(f"{question!r} was answered {answer!r}")
        return time.perf_counter() - begun


def measure_groundtruth(plan: Plan) -> Section:
    """A team at real time, left alone and asked about; `plan.seconds` of wall time for each."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    with Server(plan.world, robots) as server, Crowd(server.port, plan.seed, keep=False) as crowd:
        port = server.port_of("groundtruth")
        gather(crowd, robots, (DEFAULT_CLASS,))
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
        in_ms(f"{name}, median", median(taken), 2, MEDIAN_AIM),
        in_ms(f"{name}, 99th percentile", p99(taken)),
        in_ms(f"{name}, longest", max(taken), 2, TAIL_AIM),
    ]
