"""A long run with everything that a server can have: what it leaves behind."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import mean

from benchmarks.apart import all_classes
from benchmarks.measures import trend
from benchmarks.plan import Plan
from benchmarks.server import Server, Usage, load_between
from benchmarks.soak_visitors import GUESTS, Visitors
from benchmarks.tally import Tally, intervals
from benchmarks.team import MIB, SETTLE, gather
from usarsim_bench.crowd import DEFAULT_CLASS, Controller, Crowd
from usarsim_bench.figures import Aim, Figure, Section
from usarsim_bench.watching import watching
from usarsim_server.base.errors import UsarsimError

ROBOTS = 4
SECONDS = 3600.0
WARM_UP = 600.0
"""s until memory has to be flat: until then everybody has been there once."""
WARM_UP_PART = 1 / 6
"""The same as a part of a shorter soak."""
TURN = 0.5
SAMPLE = 2.0
"""s between two looks at the memory."""
WATCH = 10.0
"""s for which the cost of those who stay is measured."""
REST = 90.0
"""s that a server gets to give everything back; slots are kept for half a minute."""
REST_PART = 0.25
TOLD = 60.0
"""s between two lines that say how it goes."""
LEAST = 900.0
"""s of a soak from which on it has aims: classes have come several times."""

FLAT_AIM = Aim("<=", 1.05)
BACK_AIM = Aim("<=", 1.2)
NONE_AIM = Aim("<=", 0)
THREADS_AIM = Aim("<=", 10)
"""Workers of pools, which are made when they are first needed and stay."""
COST_AIM = Aim("<=", 1.2)

Samples = Sequence[tuple[float, float]]
"""Wall time since the beginning, s, and bytes."""


def flatness(samples: Samples, warm_up: float) -> float:
    """Memory at the end of a soak, by that at the end of its warming up; means over a tenth."""
    late = [sample for sample in samples if sample[0] >= warm_up]
    part = max(1, len(late) // 10)
    if len(late) < 2:
        return float("nan")
    return mean(size for _, size in late[-part:]) / mean(size for _, size in late[:part])


@dataclass(slots=True)
class _Course:
    """What is known so far; an interrupted soak has no more."""

    first: Usage
    """The server with its first robot, whose camera was looked at."""
    samples: list[tuple[float, float]] = field(default_factory=list)
    tallies: dict[str, Tally] = field(default_factory=dict)
    costs: list[float] = field(default_factory=list)
    visits: int = 0
    seen: int = 0
    radio: int = 0
    failures: int = 0
    left: Usage | None = None


def measure_soak(plan: Plan) -> Section:
    """Everybody comes and goes for `plan.seconds` of wall time beside `plan.robots` that stay."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    classes = all_classes()
    plan.say(f"soak: {len(classes)} classes and all ports for {seconds / 60.0:g} min")
    course = None
    try:
        with Server(plan.world, robots + GUESTS, "--comserver-port=0") as server:
            with Crowd(server.port, plan.seed) as crowd:
                gather(crowd, 1, (DEFAULT_CLASS,))
                # The libraries that the first picture loads stay, so one is looked at; the
                # renderer itself is closed by then.
                with watching(server.port_of("images"), [None], 1.0):
                    pass
                crowd.run(min(REST, REST_PART * seconds))
                course = _Course(server.usage())
                _soak(plan, server, crowd, course, robots, seconds, classes)
            time.sleep(min(REST, REST_PART * seconds))
            course.left = server.usage()
    except (KeyboardInterrupt, UsarsimError) as error:
        # An interrupt reaches the server, too; what has been seen is told all the same.
        if course is None or not course.samples:
            raise
        plan.say(f"soak: ended early: {str(error) or 'interrupted'}")
    return _section(plan, course, robots, seconds, len(classes))


def _soak(
    plan: Plan,
    server: Server,
    crowd: Crowd,
    course: _Course,
    robots: int,
    seconds: float,
    classes: Sequence[str],
) -> None:
    gather(crowd, robots - 1, (DEFAULT_CLASS,))
    crowd.run(SETTLE)
    watch = min(WATCH, seconds)
    course.costs.append(_cost(server, crowd, course, watch))
    begun = told = time.perf_counter()
    with Visitors(server.ports, classes, crowd.tags, plan.seed) as visitors:
        due = begun
        while (now := time.perf_counter()) < begun + seconds:
            _take_turn(crowd, course)
            if now >= due:
                due = now + min(SAMPLE, seconds / 50.0)
                usage = server.usage()
                course.samples.append((now - begun, float(usage.resident)))
                course.visits, course.seen = visitors.visits, len(visitors.seen)
                course.radio, course.failures = visitors.links, visitors.failures
            if now >= told + TOLD:
                told = now
                plan.say(
                    f"soak: {(now - begun) / 60.0:.0f} min, {course.samples[-1][1] / MIB:.0f} MiB, "
                    f"{course.visits} visits, {course.seen} classes"
                )
    rested = time.perf_counter() + min(REST, REST_PART * seconds)
    while time.perf_counter() < rested:
        _take_turn(crowd, course)
    course.costs.append(_cost(server, crowd, course, watch))


def _take_turn(crowd: Crowd, course: _Course) -> None:
    crowd.run(TURN)
    for one in crowd.controllers:
        _digest(one, course)


def _digest(one: Controller, course: _Course) -> None:
    if one.name not in course.tallies:
        # The period of its status lines, from those that have come so far.
        course.tallies[one.name] = Tally(0.0, {"STA": intervals(one.chunks)["STA"]})
    course.tallies[one.name].digest(one.chunks)
    one.chunks.clear()


def _cost(server: Server, crowd: Crowd, course: _Course, seconds: float) -> float:
    """Processors that the server uses for those who stay."""
    before = server.usage()
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        _take_turn(crowd, course)
    return load_between(before, server.usage()).process


def _section(plan: Plan, course: _Course, robots: int, seconds: float, classes: int) -> Section:
    aimed = seconds >= LEAST
    warm_up = min(WARM_UP, WARM_UP_PART * seconds)
    late = [sample for sample in course.samples if sample[0] >= warm_up] or course.samples
    slope = 60.0 * trend(late) / MIB if len(late) > 1 else 0.0
    first, left = course.first, course.left
    flat = flatness(course.samples, warm_up)

    def judged(aim: Aim) -> Aim | None:
        """A short soak has no aims but those that hold from the first second on."""
        return aim if aimed else None

    figures = [
        Figure("Memory with the first robot", first.resident / MIB, "MiB", 0),
        Figure(f"Memory after {warm_up / 60.0:.1f} min", late[0][1] / MIB, "MiB", 0),
        Figure("Memory, highest after that", max(size for _, size in late) / MIB, "MiB", 0),
        Figure("Memory, last", late[-1][1] / MIB, "MiB", 0),
        Figure("Trend of memory after that", slope, "MiB/min", 3),
        Figure("Last tenth by first tenth after that", flat, "", 3, judged(FLAT_AIM)),
        Figure("Visits of robots", course.visits, "", 0),
        Figure("Classes that were there", course.seen, "", 0, judged(Aim(">=", classes))),
        Figure("Links by radio", course.radio, "", 0),
        Figure("Links by radio that failed", course.failures, "", 0),
        Figure("Status lines of those who stay", _sum(course, "count"), "", 0),
        Figure("... of them missing in simulated time", _sum(course, "lost"), "", 0, NONE_AIM),
    ]
    if len(course.costs) == 2:
        before, after = course.costs
        ratio = after / before if before > 0.0 else float("nan")
        figures += [
            Figure("Those who stay: processor use before", before, "cores", 3),
            Figure("Those who stay: processor use after", after, "cores", 3),
            Figure("... after by before", ratio, "", 2, judged(COST_AIM)),
        ]
    if left is not None:
        back = left.resident / first.resident
        descriptors = left.descriptors - first.descriptors
        figures += [
            Figure("Memory when everybody has gone", left.resident / MIB, "MiB", 0),
            Figure("... by that with the first robot", back, "", 3, judged(BACK_AIM)),
            Figure("Threads left behind", left.threads - first.threads, "", 0, THREADS_AIM),
            Figure("Descriptors left behind", descriptors, "", 0, NONE_AIM),
        ]
    return Section(
        "soak",
        "A long run in which everything comes and goes",
        f"{robots} {DEFAULT_CLASS} drive around in {plan.world} for {seconds / 60.0:g} min; "
        f"{GUESTS} robots at a time come and go, of all {classes} classes in turn; so do a world "
        "controller with objects, an avatar, clients of images, ground truth, truth and wireless, "
        "and links in both wireless simulations.",
        tuple(figures),
    )


def _sum(course: _Course, what: str) -> int:
    return sum(getattr(tally, what) for tally in course.tallies.values())
