"""The same work done by other simulators: what was compared, what was not, and how it came out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from benchmarks.peers.own import HUMANOID, OwnSide
from benchmarks.peers.simulators import PEERS, Environments, NotInstalledError, Peer
from benchmarks.peers.work import LASER_RATE, MOST, Outcome, Work, plan_work, ratio, run_workload
from benchmarks.plan import Plan
from usarsim_bench.figures import BenchError, Figure, Report, Section, describe_machine
from usarsim_server.base.errors import UsarsimError

SIZES = (1, 4, 16, 64)
SECONDS = 10.0
WALL_LIMIT = 60.0
"""s of wall time after which a run stops early; what it has done until then counts."""
REPEATS = 3
"""Runs of each work; the fastest counts, since other programs can only slow a run down."""
TIMEOUT = 300.0
"""s after which a run is given up: it may be long in making its world."""

Runs = Mapping[int, Outcome]
"""Outcomes by number of robots."""


@dataclass(slots=True)
class Measured:
    """What our own side took so far, by number of robots."""

    rovers: dict[int, Outcome] = field(default_factory=dict)  # in one process
    bare: dict[int, Outcome] = field(default_factory=dict)  # MuJoCo alone
    sockets: dict[int, Outcome] = field(default_factory=dict)  # rovers over sockets
    humanoids: dict[int, Outcome] = field(default_factory=dict)  # over sockets

    def against(self, peer: Peer) -> Runs:
        """The runs that a peer is compared with."""
        return self.rovers if peer.against == "rovers" else self.humanoids


def compare(
    plan: Plan,
    version: str,
    only: Sequence[str] = (),
    keep: Path | None = None,
) -> Report:
    """Let all peers, or some, and our server do the same work, one after the other.

    A peer that cannot be installed or run does not fail the comparison: its section says why it
    was not compared.

    Args:
        plan: `robots` is the only size to take, `seconds` simulated time.
        version: of our server.
        only: names of peers; none means all.
        keep: folder for their environments, to be used again; None: thrown away.

    Raises:
        BenchError: for a name that no peer has, or a folder that cannot be made.
    """
    for name in only:
        if name not in PEERS:
            raise BenchError(f"no simulator is called {name!r} (known: {', '.join(PEERS)})")
    if plan.robots is not None and plan.robots > MOST:
        raise BenchError(f"{plan.robots} robots: the hall has room for {MOST} (ask for fewer)")
    chosen = [peer for name, peer in PEERS.items() if not only or name in only]
    machine, now = describe_machine(version), datetime.now(UTC)
    seconds = plan.seconds or SECONDS
    sizes = SIZES if plan.robots is None else (plan.robots,)
    works = {size: plan_work(size, seconds, WALL_LIMIT, plan.seed) for size in sizes}
    with Environments(keep) as environments:
        pythons = {peer.name: _install(peer, environments, plan) for peer in chosen}
        try:
            measured = _measure_own(works, chosen, plan)
        except UsarsimError as error:
            failed = Section("own", "usarsim-server", "", (), str(error))
            return Report(machine, now, (failed,))
        sections = [own_section(measured, works)]
        for peer in chosen:
            python = pythons[peer.name]
            if isinstance(python, NotInstalledError):
                sections.append(refusal(peer, str(python)))
            else:
                sections.append(_measure_peer(peer, python, works, measured, plan))
    return Report(machine, now, tuple(sections))


def _install(peer: Peer, environments: Environments, plan: Plan) -> str | NotInstalledError:
    plan.say(f"peers: an environment for {peer.title} ({', '.join(peer.packages)})")
    try:
        return environments.python(peer)
    except NotInstalledError as error:
        return error


def _measure_own(works: Mapping[int, Work], chosen: Sequence[Peer], plan: Plan) -> Measured:
    measured = Measured()
    with OwnSide() as own:
        for size, work in works.items():
            plan.say(f"peers: {size} of our own robots")
            measured.rovers[size] = _fastest(partial(own.in_process, work))
            measured.bare[size] = own.bare(work)
            measured.sockets[size] = _fastest(partial(own.over_sockets, work))
            limits = [one.most or size for one in chosen if one.against == "humanoids"]
            if limits and size <= max(limits):
                measured.humanoids[size] = _fastest(partial(own.over_sockets, work, HUMANOID))
    return measured


def _fastest(run: Callable[[], Outcome]) -> Outcome:
    return max((run() for _ in range(REPEATS)), key=lambda outcome: outcome.factor)


def _measure_peer(
    peer: Peer,
    python: str,
    works: Mapping[int, Work],
    measured: Measured,
    plan: Plan,
) -> Section:
    runs: dict[int, Outcome] = {}
    missing: list[str] = []
    for size, work in works.items():
        if peer.most is not None and size > peer.most:
            missing.append(f"{_robots(size)}: {peer.most_because}")
            continue
        plan.say(f"peers: {_robots(size)} in {peer.title}")
        try:
            # Isolated from this process's paths and from the folder of the script.
            command = (python, "-I", str(peer.script))
            runs[size] = _fastest(partial(run_workload, command, work.as_json(), TIMEOUT))
        except UsarsimError as error:
            missing.append(f"{_robots(size)}: {error}")
    if not runs:
        return refusal(peer, "; ".join(missing))
    return peer_section(peer, runs, measured.against(peer), missing)


def refusal(peer: Peer, reason: str) -> Section:
    """The section of a peer that was not compared; no failure."""
    return Section(peer.name, peer.title, f"Not compared: {_sentence(reason)}", ())


def own_section(measured: Measured, works: Mapping[int, Work]) -> Section:
    """What our own side took."""
    seconds = max(work.seconds for work in works.values())
    figures: list[Figure] = []
    for size, rovers in measured.rovers.items():
        of = _robots(size)
        figures += [
            *_speed(f"{of}, in process", rovers),
            *_laser(f"{of}, in process", size, rovers),
            Figure(
                f"{of}, in process: bare mj_step of the scene, processor time / all of ours",
                ratio(measured.bare[size].cost, rovers.cost),
            ),
            *_speed(f"{of}, sockets", measured.sockets[size]),
            _scans(f"{of}, sockets", size, measured.sockets[size]),
            *_traffic(f"{of}, sockets", measured.sockets[size]),
        ]
        if size in measured.humanoids:
            figures += _speed(f"{size} {HUMANOID}, sockets", measured.humanoids[size])
            figures += _traffic(f"{size} {HUMANOID}, sockets", measured.humanoids[size])
    return Section(
        "own",
        "usarsim-server",
        f"P3AT of 0.8 m/s with one laser (181 beams, {LASER_RATE:g} scans per simulated s), new "
        "random wheel speeds twice a simulated s, in a hall of 24 x 20 m with "
        f"{len(next(iter(works.values())).boxes)} boxes, as fast as possible, {seconds:g} "
        f"simulated s after 1 s that does not count; of {REPEATS} runs, here and of the others, "
        "the fastest counts. In process: everything but sockets, in lockstep. Sockets: serve "
        "--speed max with clients in another process, whose processor time is not counted; "
        "simulated time does not wait for them. Bare: mj_step and nothing else with plain P3AT in "
        "the same hall.",
        tuple(figures),
    )


def peer_section(peer: Peer, runs: Runs, own: Runs, missing: Sequence[str] = ()) -> Section:
    """How a peer did, beside ours, and what was not compared, with the reason."""
    figures: list[Figure] = []
    for size, outcome in runs.items():
        of, ours = _robots(size), own[size]
        figures += _speed(of, outcome)
        figures += [
            Figure(f"{of}: speed, ours / {peer.title}", ratio(ours.factor, outcome.factor)),
            Figure(f"{of}: processor time, ours / {peer.title}", ratio(ours.cost, outcome.cost)),
        ]
        if peer.against == "rovers":
            figures += _laser(of, size, outcome)
        else:
            figures += _traffic(of, outcome)
    versions = sorted({outcome.version for outcome in runs.values()})
    absent = [f"Not compared: {_sentence(one)}" for one in missing]
    setting = " ".join([peer.same, peer.different, *absent, f"Home: {peer.home}"])
    return Section(peer.name, f"{peer.title} {', '.join(versions)}", setting, tuple(figures))


def _speed(of: str, outcome: Outcome) -> list[Figure]:
    return [
        Figure(f"{of}: simulated s per s", outcome.factor),
        Figure(f"{of}: processor s per simulated s", outcome.cost, "", 4),
    ]


def _laser(of: str, size: int, outcome: Outcome) -> list[Figure]:
    """That the work was done: scans, what they saw, how far robots went."""
    counts = outcome.counts
    beams = counts.get("beams", 0.0)
    return [
        _scans(of, size, outcome),
        Figure(f"{of}: mean range seen", ratio(counts.get("reach", 0.0), beams), "m"),
        Figure(f"{of}: way of a robot", outcome.per_second("metres") / size, "m/s"),
    ]


def _scans(of: str, size: int, outcome: Outcome) -> Figure:
    due = size * LASER_RATE
    return Figure(f"{of}: scans / scans due", ratio(outcome.per_second("scans"), due))


def _traffic(of: str, outcome: Outcome) -> list[Figure]:
    messages = outcome.counts.get("messages", 0.0)
    return [
        Figure(f"{of}: messages to clients", ratio(messages, outcome.wall), "1/s", 0),
        Figure(f"{of}: messages per simulated s", outcome.per_second("messages"), "", 0),
    ]


def _robots(size: int) -> str:
    return f"{size} robot{'s' if size != 1 else ''}"


def _sentence(text: str) -> str:
    return text if text.endswith(".") else f"{text}."
