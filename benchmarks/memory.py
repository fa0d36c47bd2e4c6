"""Memory of a team, and what is left behind by robots that come and go."""

from __future__ import annotations

import random
import time
from dataclasses import dataclass

from benchmarks.measures import trend
from benchmarks.plan import Plan
from benchmarks.server import Server, Usage
from benchmarks.swarm import TOGETHER
from benchmarks.team import MIB, SETTLE, gather
from usarsim_bench.crowd import DEFAULT_CLASS, Controller, Crowd
from usarsim_bench.figures import Aim, Figure, Section

ROBOTS = 64
SECONDS = 600.0
CLASSES = (DEFAULT_CLASS, "P2AT")
"""Classes that come and go; more than one, so that the model has to grow for each."""
PAUSE = 0.25
"""s between a departure and the next arrival, and the other way round."""
SPEAKING = 2.0
"""s after INIT by which a robot should have said something."""
QUIET = 1.0
"""s without a new thread, descriptor or MiB by which a server that started has found its place:
the renderer of its cameras gets ready after READY."""
PATIENCE = 5.0
"""s after the last departure in which threads and descriptors have to be given back."""

RESIDENT_AIM = Aim("<", 700.0)
LEFT_AIM = Aim("<=", 0)
TREND_AIM = Aim("<", 0.2)
"""MiB/min: flat, but for what an allocator takes now and then."""
LEAST_TREND = 60.0
"""s of coming and going before there is an aim for the trend: the model still grows at first."""


@dataclass(frozen=True, slots=True)
class Churn:
    """What coming and going did."""

    spawned: int  # robots that came
    silent: int  # those of them that never said anything before they left again
    resident: list[tuple[float, float]]  # bytes of memory over wall time, since it began


def churn(server: Server, crowd: Crowd, seconds: float, seed: int) -> Churn:
    """Let robots leave and others come, one at a time, for some wall time.

    Raises:
        BenchError: if the server fails a client.
    """
    dice = random.Random(seed)
    start = time.perf_counter()
    resident: list[tuple[float, float]] = []
    spawned = silent = 0
    while (now := time.perf_counter()) < start + seconds:
        resident.append((now - start, server.usage().resident))
        leaving = dice.choice(crowd.controllers)
        silent += _is_silent(leaving, now)
        crowd.leave(leaving)
        crowd.run(PAUSE)
        crowd.join(dice.choice(CLASSES))
        spawned += 1
        crowd.run(PAUSE)
    silent += sum(_is_silent(one, time.perf_counter()) for one in crowd.controllers)
    return Churn(spawned, silent, resident)


def _is_silent(controller: Controller, now: float) -> bool:
    return not controller.speaking and controller.joined < now - SPEAKING


def slope(resident: list[tuple[float, float]], seconds: float) -> float:
    """Bytes per second that memory grew by in the second half of so many seconds."""
    settled = [sample for sample in resident if sample[0] >= seconds / 2.0]
    return trend(settled) if len(settled) > 1 else 0.0


def measure_memory(plan: Plan) -> Section:
    """Memory of a team and after churn; robots come and go for `plan.seconds` of wall time."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"memory: {robots} robots, coming and going for {seconds:g} s")
    with Server(plan.world, robots) as server:
        with Crowd(server.port, plan.seed, keep=False) as crowd:
            empty = _wait_until_settled(server, crowd)
            gather(crowd, robots, (DEFAULT_CLASS,), TOGETHER)
            crowd.run(SETTLE)
            full = server.usage()
            turnover = churn(server, crowd, seconds, plan.seed)
        left = _wait_until_back(server, empty)
    highest = max(octets for _, octets in turnover.resident)
    grown = 60.0 * slope(turnover.resident, seconds) / MIB
    descriptors = left.descriptors - empty.descriptors
    trend_aim = TREND_AIM if seconds >= LEAST_TREND else None
    return Section(
        "memory",
        "Memory, and robots coming and going",
        f"{robots} {DEFAULT_CLASS} with all their sensors in {plan.world}; then every "
        f"{2 * PAUSE:g} s one leaves and another comes ({', '.join(CLASSES)}), for {seconds:g} s; "
        "the trend is that of the second half.",
        (
            Figure("Memory without robots", empty.resident / MIB, "MiB", 0),
            Figure(f"Memory with {robots} robots", full.resident / MIB, "MiB", 0, RESIDENT_AIM),
            Figure("Memory while they come and go, highest", highest / MIB, "MiB", 0, RESIDENT_AIM),
            Figure("Memory after coming and going", left.resident / MIB, "MiB", 0),
            Figure("Trend of memory while they come and go", grown, "MiB/min", 2, trend_aim),
            Figure("Robots that came", turnover.spawned, "", 0),
            Figure("Robots that never spoke", turnover.silent, "", 0, LEFT_AIM),
            Figure("Threads left behind", left.threads - empty.threads, "", 0, LEFT_AIM),
            Figure("Descriptors left behind", descriptors, "", 0, LEFT_AIM),
        ),
    )


def _wait_until_settled(server: Server, crowd: Crowd) -> Usage:
    """What the server uses once it needs no more to get ready, or at the end of our patience."""
    deadline = time.perf_counter() + PATIENCE
    since = now = server.usage()
    while now.wall < min(since.wall + QUIET, deadline):
        crowd.run(0.1)
        now = server.usage()
        same = (now.threads, now.descriptors) == (since.threads, since.descriptors)
        if not same or now.resident > since.resident + MIB:
            since = now
    return now


def _wait_until_back(server: Server, empty: Usage) -> Usage:
    """What the server uses once it has given everything back, or at the end of our patience."""
    deadline = time.perf_counter() + PATIENCE
    while True:
        now = server.usage()
        back = now.threads <= empty.threads and now.descriptors <= empty.descriptors
        if back or now.wall > deadline:
            return now
        time.sleep(0.1)
