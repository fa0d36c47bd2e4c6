"""What a team notices of clients that mean the server no good, attack by attack."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from dataclasses import dataclass

from hostile.attack import MIB, Attack
from hostile.attackers import ATTACKS, Attackers
from hostile.links import SHARE, Damage
from hostile.newcomers import Newcomers
from hostile.web_servers import WebServers

from benchmarks.plan import Plan
from benchmarks.robot_files import SCOUT, scouts
from benchmarks.server import Server, load_between
from benchmarks.swarm import TOGETHER
from benchmarks.tally import Tally, intervals
from benchmarks.team import SETTLE, gather
from usarsim_bench.crowd import Crowd
from usarsim_bench.figures import Aim, Figure, Section
from usarsim_server.base.errors import UsarsimError

ROBOTS = 8
MOST_ROBOTS = 64
"""The server's: attackers need robots, too."""
SECONDS = 10.0
BRIEF = ("medley", "questions", "junk-links")
"""Attacks that tell whether something is badly wrong."""
SLICE = 0.2
"""s between two looks at the server's memory."""
MOST_QUIET = 5.0
"""s of quiet before and behind an attack, at the most."""
ENDING = 1.0
"""s of a second wave before the server is told to end."""

LEAST_RATE = 0.95
QUIET_FACTOR = 0.98
"""Real-time factor without an attack below which a rate says nothing: the machine was busy."""
LONGEST_END = 3.0


@dataclass(frozen=True, slots=True)
class Span:
    """What a team saw over some time."""

    rate: float  # lines of all streams per s of wall time
    factor: float  # real-time factor of the robot that had the lowest
    lost: int  # lines that are missing in simulated time
    gap: float  # s by which the longest silence of any stream exceeded its interval
    cores: float  # processors that the server used
    resident: int  # bytes of the server's memory at the beginning and at the most
    peak: int
    descriptors: int  # most that it had


@dataclass(frozen=True, slots=True)
class Outcome:
    """One attack and what came of it."""

    attack: Attack
    before: Span  # what the team saw
    during: Span
    after: Span
    damage: Damage  # what the attackers got through
    wait: tuple[float, str]  # longest s that a new client waited for its answer, and on which port
    faults: tuple[str, ...]  # of the answers to new clients
    end: float  # s that the server took to end under attack; infinite if it had to be killed

    @property
    def rate(self) -> float:
        """Rate of the team's lines during the attack, as a part of that without."""
        return self.during.rate / (0.5 * (self.before.rate + self.after.rate))

    @property
    def cost(self) -> float:
        """Processors that the server used on top of what it uses without the attack."""
        return self.during.cores - 0.5 * (self.before.cores + self.after.cores)

    @property
    def lost(self) -> int:
        """Lines that are missing in simulated time, all spans."""
        return self.before.lost + self.during.lost + self.after.lost

    @property
    def growth(self) -> int:
        """Bytes that the server's memory grew by at the most."""
        return max(self.during.peak, self.after.peak) - self.before.peak


def verdict(outcome: Outcome) -> list[str]:
    """What is not as promised; nothing if the promise is kept."""
    attack, broken = outcome.attack, []
    if not attack.overload and not outcome.rate >= LEAST_RATE:
        quiet = min(outcome.before.factor, outcome.after.factor)
        doubt = f"? without attack the factor was {quiet:.2f}" if quiet < QUIET_FACTOR else ""
        broken.append(f"rate{doubt}")
    if outcome.lost:
        broken.append("lines lost")
    if outcome.growth > attack.growth:
        broken.append(f"memory (promised {attack.growth / MIB:.0f} MiB)")
    if outcome.during.descriptors - outcome.before.descriptors > attack.descriptors:
        broken.append(f"{outcome.during.descriptors} descriptors")
    if not attack.overload and outcome.wait[0] > attack.wait:
        broken.append(f"new client on {outcome.wait[1]}")
    if not attack.busy_loops and outcome.end > LONGEST_END:
        broken.append("end")
    return broken + list(outcome.faults)


def measure_hostile(plan: Plan) -> Section:
    """Every attack on a server of its own, `plan.seconds` long, quiet before and behind."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    names = plan.only or (BRIEF if plan.brief else tuple(ATTACKS))
    outcomes: list[Outcome] = []
    failed: list[tuple[str, str]] = []
    for number, name in enumerate(names, 1):
        plan.say(f"hostile: {name}, {number} of {len(names)}")
        try:
            outcomes.append(_try(plan, ATTACKS[name], robots, seconds))
        except UsarsimError as error:
            failed.append((name, str(error).strip().splitlines()[-1]))
            plan.say(f"  {failed[-1][1]}")
        else:
            row = dict(zip(HEADS, outcome_row(outcomes[-1]), strict=True))
            shown = ("rate", "factor", "lost", "cores", "wait s", "end s", "promise kept")
            plan.say("  " + ", ".join(f"{head} {row[head]}" for head in shown))
    return _section(plan, robots, seconds, outcomes, failed)


class _Watch:
    """A team at work, and the server's memory."""

    def __init__(self, server: Server, crowd: Crowd) -> None:
        self._server, self._crowd = server, crowd
        self._tallies: list[Tally] = []

    def learn(self) -> None:
        """Find out which streams there are; on a machine that is slow it takes longer.

        Raises:
            BenchError: if a robot stays silent.
        """
        opening = time.perf_counter()
        for last in (False, False, False, True):
            self._crowd.run(SETTLE)
            try:
                usual = [intervals(one.chunks) for one in self._crowd.controllers]
                break
            except UsarsimError:
                if last:
                    raise
        self._tallies = [Tally(opening, one) for one in usual]
        self._digest()

    @property
    def streams(self) -> bytes:
        """Names of the streams of all robots."""
        return " ".join(name for tally in self._tallies for name in tally.streams).encode()

    def watch(self, seconds: float) -> Span:
        """How they fare from now on."""
        opening = self._server.usage()
        peak, descriptors = opening.resident, opening.descriptors
        for tally in self._tallies:
            tally.begin(opening.wall)
        stop = opening.wall + seconds
        while (left := stop - time.perf_counter()) > 0.0:
            self._crowd.run(min(SLICE, left))
            self._digest()
            now = self._server.usage()
            peak, descriptors = max(peak, now.resident), max(descriptors, now.descriptors)
        closing = self._server.usage()
        for tally in self._tallies:
            tally.end(closing.wall)
        return Span(
            rate=sum(tally.count for tally in self._tallies) / (closing.wall - opening.wall),
            factor=min(tally.factor for tally in self._tallies),
            lost=sum(tally.lost for tally in self._tallies),
            gap=max(tally.gap for tally in self._tallies),
            cores=load_between(opening, closing).process,
            resident=opening.resident,
            peak=peak,
            descriptors=descriptors,
        )

    def _digest(self) -> None:
        for tally, one in zip(self._tallies, self._crowd.controllers, strict=True):
            tally.digest(one.chunks)
            one.chunks.clear()


def _try(plan: Plan, attack: Attack, robots: int, seconds: float) -> Outcome:
    quiet, seconds = min(MOST_QUIET, seconds), max(attack.least, seconds)
    options = ("--comserver-port", "0", *attack.options)
    with scouts() as classes:
        server = Server(plan.world, MOST_ROBOTS, *classes, *options)
        with contextlib.ExitStack() as stack, server, Crowd(server.port, plan.seed) as crowd:
            web = stack.enter_context(WebServers(server.port)) if attack.web else None
            gather(crowd, robots, (SCOUT,), TOGETHER)
            watch = _Watch(server, crowd)
            watch.learn()
            before = watch.watch(quiet)
            ports = server.ports | ({} if web is None else web.ports)
            names = [name for name in ("control", *attack.ports) if name in ports]
            with (
                Newcomers(ports, names) as newcomers,
                Attackers(attack.name, ports) as attackers,
            ):
                during = watch.watch(seconds)
                damage = attackers.stop()
            faults = () if web is None else tuple(web.faults())
            after = watch.watch(quiet)
            with Attackers(attack.name, ports):
                watch.watch(ENDING)
                begun = time.perf_counter()
                try:
                    server.close()
                    end = time.perf_counter() - begun
                except UsarsimError:
                    end = float("inf")
    return Outcome(
        attack,
        before,
        during,
        after,
        damage,
        newcomers.slowest,
        (*attack.faults({**newcomers.answers, "team": watch.streams}), *faults),
        end,
    )


HEADS = (
    *("Attack", "rate", "factor", "lost", "gap ms", "cores", "wait s"),
    *("MiB before", "peak", "after", "end s", "kB/s in", "promise kept"),
)


def outcome_row(outcome: Outcome) -> tuple[str, ...]:
    """One line of the table."""
    during, damage = outcome.during, outcome.damage
    broken = verdict(outcome)
    return (
        outcome.attack.name,
        f"{outcome.rate:.3f}",
        f"{during.factor:.3f}",
        str(outcome.lost),
        f"{1e3 * during.gap:.0f}",
        f"{outcome.before.cores:.2f} {outcome.cost:+.2f}",
        f"{outcome.wait[0]:.2f}",
        f"{outcome.before.peak / MIB:.0f}",
        f"{max(during.peak, outcome.after.peak) / MIB:.0f}",
        f"{outcome.after.resident / MIB:.0f}",
        f"{outcome.end:.1f}",
        f"{damage.sent / 1e3 / max(1e-3, damage.seconds):,.0f}",
        f"NO: {', '.join(broken)}" if broken else "yes",
    )


def _section(
    plan: Plan,
    robots: int,
    seconds: float,
    outcomes: Sequence[Outcome],
    failed: Sequence[tuple[str, str]],
) -> Section:
    rows = [outcome_row(one) for one in outcomes]
    rows += [(name, *[""] * (len(HEADS) - 2), f"NO: {why}") for name, why in failed]
    kept = sum(not verdict(one) for one in outcomes)
    judged = [one for one in outcomes if not one.attack.overload]
    lost, rate = sum(one.lost for one in outcomes), "Lowest rate of the others' lines"
    figures = [Figure("Attacks whose promise is kept", kept, "", 0, Aim(">=", len(rows)))]
    if outcomes:
        growth = max(one.growth for one in outcomes) / MIB
        figures += [
            Figure("Lines lost in simulated time", lost, "", 0, Aim("<=", 0)),
            Figure("Largest growth of memory", growth, "MiB", 0),
        ]
    if judged:
        lowest, end = min(one.rate for one in judged), max(one.end for one in judged)
        figures += [
            Figure(f"{rate}, during / without", lowest, "", 3, Aim(">=", LEAST_RATE)),
            Figure("Longest end of the server", end, "s", 1, Aim("<=", LONGEST_END)),
            Figure("Longest wait of a new client", max(one.wait[0] for one in judged), "s"),
        ]
    return Section(
        "hostile",
        "A team beside hostile clients",
        f"{robots} {SCOUT} in {plan.world}, a server of its own for each attack of {seconds:g} s. "
        "rate: the team's lines per s of wall time, as a part of those in the quiet spans before "
        "and behind; factor: real-time factor; lost: lines missing in simulated time; gap: longest "
        "silence beyond a stream's period; cores: processors that the server used before, and what "
        "the attack added; wait: longest until a new client had its answer; end: until "
        "the server had ended under attack. "
        f"The attackers together use at most {SHARE:g} of a processor.",
        tuple(figures),
        table=(HEADS, *rows),
    )
