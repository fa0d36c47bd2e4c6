"""What pages cost, and what they do to each other (CON-07, CON-15, CON-22, O-38)."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from dataclasses import replace
from itertools import pairwise
from statistics import median

from benchmarks.console.arithmetic import (
    Arrival,
    growth,
    longest_queue,
    p95,
    picture_ages,
    stopping_time,
)
from benchmarks.console.browser import GL, BrowserPage, browser, chromium
from benchmarks.console.gateway import Rig
from benchmarks.console.lengths import Course, count, seconds, stay, until_interrupted
from benchmarks.console.programs import (
    PICTURE,
    POSES,
    SLOW_RATE,
    PageProgram,
    driving,
    hostile_page,
    page,
    raw_page,
)
from benchmarks.measures import p99
from benchmarks.plan import Plan
from benchmarks.server import Usage, load_between
from usarsim_bench.figures import Aim, BenchError, Figure, in_ms

MIB = 2.0**20
ONE_AIM, EIGHT_AIM, NONE_AIM = Aim("<=", 0.10), Aim("<=", 0.20), Aim("<", 0.01)
MEMORY_AIM = Aim("<=", 5.0)
STOP_AIM = Aim("<", 100.0)
STATE_AIM, RATE_AIM = Aim("<", 1000.0), Aim(">=", 0.95)
AGE_AIM, GROWTH_AIM, QUEUE_AIM = Aim("<", 150.0), Aim("<=", 1.2), Aim("<=", 1)
TEXTS = 256 * 1024
"""Bytes that may wait for a page beside a picture of each tile."""
_SETTLE = 2.0


async def pages(rig: Rig, plan: Plan) -> list[Figure]:
    """CON-07: processors of gateway and feed, and memory, for 0, 1 and 8 pages of instructors.

    The pages have declined pictures, which cost what they cost; the feed is what the server uses
    more than without a page.
    """
    length = seconds(plan, 20.0, 8.0)
    figures: list[Figure] = []
    spans: dict[int, tuple[float, float]] = {}
    memory: dict[int, int] = {}
    async with contextlib.AsyncExitStack() as stack:
        present = 0
        for number in (0, 1, 8):
            while present < number:
                await stack.enter_async_context(page(rig, "instructor", pictures=False))
                present += 1
            plan.say(f"{number} pages for {length:g} s")
            spans[number], memory[number] = await _cost(rig, length)
    idle_gateway, idle_server = spans[0]
    for number, aim in ((0, NONE_AIM), (1, ONE_AIM), (8, EIGHT_AIM)):
        gateway, server = spans[number]
        name = f"gateway and feed, {number} page{'' if number == 1 else 's'}"
        feed = max(0.0, server - idle_server)
        figures.append(Figure(name, gateway + feed, "cores", 3, aim))
        figures.append(Figure("... of it the feed", feed, "cores", 3))
        if server > 0.0:
            figures.append(Figure("... gateway by server", gateway / server, "", 3))
    for number in (1, 8):
        added = spans[number][0] - idle_gateway
        figures.append(Figure(f"gateway, added by {number} of them", added, "cores", 3))
    grown = (memory[8] - memory[1]) / 7 / MIB
    figures.append(Figure("memory of the gateway per page", grown, "MiB", 2, MEMORY_AIM))
    async with page(rig, "instructor") as looking:
        for robot in rig.robots[4:]:
            await looking.say("camera", robot=robot, on=False)
        (gateway, _), _ = await _cost(rig, length)
    figures.append(Figure("gateway, 1 page with 4 tiles", gateway, "cores", 3))
    return _unique(figures)


def _unique(figures: list[Figure]) -> list[Figure]:
    """Figures whose name begins with dots get that of the one before them."""
    found: list[Figure] = []
    head = ""
    for one in figures:
        if one.name.startswith("... "):
            one = replace(one, name=f"{head}: {one.name[4:]}")
        else:
            head = one.name
        found.append(one)
    return found


async def _cost(rig: Rig, length: float) -> tuple[tuple[float, float], int]:
    """Processors of gateway and server over a span, and the gateway's memory at its end."""
    await asyncio.sleep(min(_SETTLE, length))
    before = rig.usage(), rig.server.usage()
    await asyncio.sleep(length)
    after = rig.usage(), rig.server.usage()
    gateway, server = (_cores(*ends) for ends in zip(before, after, strict=True))
    return (gateway, server), after[0].resident


def _cores(before: Usage, after: Usage) -> float:
    return load_between(before, after).process


async def emergency_stop(rig: Rig, plan: Plan) -> list[Figure]:
    """CON-15: from the stop of a page to a zero DRIVE for every robot, while all are driven, one
    page sends 1 MB/s and another reads nothing."""
    times = []
    number = count(plan, 200, 40, 0.7)
    course = Course(plan, "stops", number)
    async with (
        driving(rig, rig.robots),
        hostile_page(rig),
        raw_page(rig, "instructor", 0.0),
        page(rig, pictures=False, scans=False) as stopper,
    ):
        for done in range(number):
            await stopper.until(lambda state: _moving(state) == len(rig.robots), "all robots move")
            begun = time.perf_counter()
            await stopper.ask("estop")
            await asyncio.sleep(0.1)
            while math.isinf(took := stopping_time(begun, len(rig.robots), rig.notes(begun).wired)):
                if time.perf_counter() > begun + 5.0:
                    break
                await asyncio.sleep(0.05)
            times.append(took)
            await stopper.ask("estop_reset")
            course.at(done + 1)
    return [
        in_ms("stop to the last zero DRIVE, median", median(times)),
        in_ms("stop to the last zero DRIVE, 99th percentile", p99(times), 2, STOP_AIM),
        in_ms("stop to the last zero DRIVE, longest", max(times)),
        Figure("stops", len(times), "", 0),
    ]


def _moving(state: dict[str, object]) -> int:
    robots = state["robots"]
    assert isinstance(robots, list)
    return sum(row["holder"] is not None for row in robots)


async def slow_page(rig: Rig, plan: Plan) -> list[Figure]:
    """CON-22: a page that reads 20 kB/s beside another."""
    length = seconds(plan, 30.0, 10.0)
    async with driving(rig, rig.robots), page(rig, "instructor") as other:
        await asyncio.sleep(min(_SETTLE, length))
        plan.say(f"another page alone for {length:g} s")
        alone = await _rates(other, length)
        begun = time.perf_counter()
        async with raw_page(rig, "instructor", SLOW_RATE) as slow:
            await asyncio.sleep(min(_SETTLE, length))
            plan.say(f"beside a slow one for {length:g} s")
            beside = await _rates(other, length)
            waited = [size for _, id, size in rig.notes(begun).waiting if id > other.id]
            states = list(slow.states)
        largest = len(rig.robots) * other.largest + TEXTS
    if not states:
        raise BenchError("the slow page got no state")
    ages = [age for _, age in states]
    gaps = [later - earlier for (earlier, _), (later, _) in pairwise(states)]
    ratios = {kind: beside[kind] / rate if rate else math.nan for kind, rate in alone.items()}
    return [
        in_ms("age of state at the slow page, longest", max(ages), 0, STATE_AIM),
        in_ms("between two states there, longest", max(gaps, default=math.nan), 0),
        Figure("rate of the other's pictures, by that alone", ratios[PICTURE], "", 3, RATE_AIM),
        Figure("rate of the other's poses, by that alone", ratios[POSES], "", 3, RATE_AIM),
        Figure("rate of the other's states, by that alone", ratios[0], "", 3, RATE_AIM),
        Figure(
            "waiting for the slow page, most",
            max(waited, default=0) / 1e3,
            "kB",
            0,
            Aim("<=", round(largest / 1e3)),
        ),
    ]


async def _rates(looking: PageProgram, length: float) -> dict[int, float]:
    before, begun = looking.counts.copy(), time.perf_counter()
    await asyncio.sleep(length)
    gone = time.perf_counter() - begun
    kinds = (0, PICTURE, POSES)
    return {kind: (looking.counts[kind] - before[kind]) / gone for kind in kinds}


async def long_look(rig: Rig, plan: Plan) -> list[Figure]:
    """O-38: two pages look at all tiles for ten minutes; interrupted, what has come is told."""
    length = seconds(plan, 600.0, 60.0)
    told = f"two pages look at {len(rig.robots)} tiles for {length:g} s"
    begun = time.perf_counter()
    found: list[tuple[list[Arrival], float]] = []
    async with driving(rig, rig.robots), contextlib.AsyncExitStack() as stack:
        if chromium() is None:
            programs = [await stack.enter_async_context(page(rig)) for _ in range(2)]
            plan.say(told)
            with until_interrupted():
                await stay(plan, length)
            found = [(one.arrivals, 0.0) for one in programs]
        else:
            shown = await stack.enter_async_context(browser(rig, *GL))
            looking = [await stack.enter_async_context(shown.page("operator")) for _ in range(2)]
            plan.say(told)
            with until_interrupted():
                await _collecting(looking, plan, length)
            found = [(one.arrivals, one.clock_error) for one in looking]
    pictures = rig.notes(begun).shown
    ages = [sorted(picture_ages(arrivals, pictures)) for arrivals, _ in found]
    every = [age for one in ages for _, age in one]
    if not every:
        raise BenchError("no picture came")
    queue = max(longest_queue(arrivals, pictures, error) for arrivals, error in found)
    return [
        in_ms("picture's age at the page, median", median(every), 1),
        in_ms("picture's age at the page, 95th percentile", p95(every), 1, AGE_AIM),
        in_ms("picture's age at the page, longest", max(every), 1),
        Figure(
            "age in the last tenth by the first, the worse page",
            max(map(growth, ages)),
            "",
            2,
            GROWTH_AIM,
        ),
        Figure("pictures behind another on the way, most", queue, "", 0, QUEUE_AIM),
        Figure(
            "pictures per page and tile",
            len(every) / _span(every, ages) / 2 / len(rig.robots),
            "1/s",
            2,
        ),
    ]


def _span(every: list[float], ages: list[list[tuple[float, float]]]) -> float:
    moments = [moment for one in ages for moment, _ in one]
    return max(moments) - min(moments) or math.nan


async def _collecting(looking: list[BrowserPage], plan: Plan, length: float) -> None:
    course, begun = Course(plan, "s", length), time.perf_counter()
    while (gone := time.perf_counter() - begun) < length:
        course.at(gone)
        await asyncio.sleep(min(1.0, length - gone))
        for one in looking:
            await one.collect()
