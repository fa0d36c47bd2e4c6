"""Teams at real time: how well time is kept, at which cost, and how large a team may be.

One of them is mixed: robots of every kind together, each driven in its own words.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from benchmarks.measures import worst_window
from benchmarks.plan import Plan
from benchmarks.robot_files import scouts
from benchmarks.server import Load, Server, load_between
from usarsim_bench.crowd import DEFAULT_CLASS, Controller, Crowd, wander
from usarsim_bench.figures import Aim, BenchError, Figure, Section
from usarsim_bench.recording import between, lines, real_time_factor, status_samples

ROBOTS = 16
SECONDS = 60.0
LARGEST_SECONDS = 15.0
TEAM_SIZES = (16, 24, 32, 48, 64)
SERVER_LIMIT = 256
"""Most robots that a server can be told to take."""
SETTLE = 2.0
"""s between the last robot's first line and the start of a measurement."""
WINDOW = 1.0
"""s of wall time over which time must be kept, at the worst."""
EDGE = 1.0
"""s at either end of a measurement within which the promptest line is taken."""
MIB = 2.0**20

FACTOR_AIM = Aim(">=", 0.999)
CORES_AIM = Aim("<", 1.2)
LARGEST_FACTOR = 0.99
LARGEST_AIM = Aim(">=", ROBOTS)


@dataclass(frozen=True, slots=True)
class TeamTrial:
    """What a team saw over one measurement."""

    robots: int  # its size
    factor: float  # real-time factor of the robot that had the lowest
    worst: float  # the lowest factor of any robot in any stretch of a second
    load: Load  # processors used meanwhile
    lines: float  # received per second by all clients together
    octets: float
    resident: int  # bytes of memory of the server at the end
    start: float  # wall times between which it was watched
    stop: float


@contextmanager
def served(plan: Plan, robots: int, *options: str) -> Iterator[tuple[Server, Crowd]]:
    """A server with room for so many, which knows the classes of `robot_files`, and an empty
    crowd."""
    with (
        scouts() as classes,
        Server(plan.world, robots, *classes, *options) as server,
        Crowd(server.port, plan.seed) as crowd,
    ):
        yield server, crowd


def gather(crowd: Crowd, robots: int, classes: Sequence[str], together: int = 1) -> None:
    """Bring so many more robots, of some classes in turn, into the world.

    As many ask `together` before it waits until they are there: one, unless there are many, because
    a crowd at the door is a measurement of its own.

    Raises:
        BenchError: if the server fails a client, or a robot does not come.
    """
    names = [classes[number % len(classes)] for number in range(robots)]
    for first in range(0, robots, together):
        newcomers = [crowd.join(name) for name in names[first : first + together]]
        crowd.wait_until_speaking(newcomers)


def try_team(
    server: Server,
    crowd: Crowd,
    robots: int,
    seconds: float,
    robot_class: str | Sequence[str] = DEFAULT_CLASS,
) -> TeamTrial:
    """Bring a team into the world, let it drive around and watch for so many s of wall time.

    Those who are in the crowd already are watched, too; several classes are taken in turn.

    Raises:
        BenchError: if the server fails a client, or a robot stops talking.
    """
    gather(crowd, robots, (robot_class,) if isinstance(robot_class, str) else robot_class)
    crowd.run(SETTLE)
    before = server.usage()
    start, stop = crowd.run(seconds)
    after = server.usage()
    told = [line for one in crowd.controllers for line in lines(one.chunks) if line[0] >= start]
    factors, worst = zip(*paces(crowd, start, stop), strict=True)
    return TeamTrial(
        robots=len(crowd.controllers),
        factor=min(factors),
        worst=min(worst),
        load=load_between(before, after),
        lines=len(told) / (stop - start),
        octets=sum(len(line) + 2 for _, line in told) / (stop - start),
        resident=after.resident,
        start=start,
        stop=stop,
    )


def paces(crowd: Crowd, start: float, stop: float) -> list[tuple[float, float]]:
    """Real-time factor of each robot over a span of wall time, and that of its worst stretch.

    Raises:
        BenchError: if a robot has hardly said anything.
    """
    found = []
    for one in crowd.controllers:
        samples = between(status_samples(one.chunks), start, stop)
        try:
            factor = real_time_factor(samples, min(EDGE, (stop - start) / 4.0))
            found.append((factor, worst_window(samples, WINDOW)))
        except ValueError as error:
            raise BenchError(f"too few STA lines for {one.name}: {error}") from None
    return found


def measure_team(plan: Plan) -> Section:
    """A team at real time; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"team: {robots} robots for {seconds:g} s")
    with Server(plan.world, robots) as server, Crowd(server.port, plan.seed) as crowd:
        trial = try_team(server, crowd, robots, seconds)
    return Section(
        "team",
        f"A team of {robots} robots",
        f"{robots} {DEFAULT_CLASS} with all their sensors in {plan.world}, random DRIVE commands "
        f"at 2 Hz each, clients in another process, {seconds:g} s.",
        tuple(team_figures(trial, FACTOR_AIM, CORES_AIM)),
    )


def team_figures(
    trial: TeamTrial, factor: Aim | None = None, cores: Aim | None = None
) -> list[Figure]:
    """How well a team kept time and at which cost, with aims for the factor and the cores."""
    return [
        Figure("Real-time factor, lowest of all robots", trial.factor, "", 4, factor),
        Figure("Real-time factor, worst second of any robot", trial.worst, "", 4),
        Figure("Processor use of the server", trial.load.process, "cores", 2, cores),
        Figure("Memory of the server", trial.resident / MIB, "MiB", 0),
        Figure("Lines sent", trial.lines, "1/s", 0),
        Figure("Data sent", trial.octets / 1e3, "kB/s", 0),
        *load_figures(trial.load),
    ]


def named(team: str, figures: Iterable[Figure]) -> list[Figure]:
    """The figures of one team among several, whose name stands before theirs."""
    return [replace(one, name=f"{team}: {one.name[0].lower()}{one.name[1:]}") for one in figures]


def load_figures(load: Load) -> list[Figure]:
    """What else kept the machine busy, by which a reader can judge the other figures."""
    return [
        Figure("Processor use of the clients", load.own, "cores", 2),
        Figure("Processor use of other programs", load.others, "cores", 2),
    ]


def measure_largest(plan: Plan) -> Section:
    """The largest team that keeps real time; `plan.seconds` of wall time for each size.

    Sizes are tried in turn until one fails. A given `plan.robots` is the only size tried.
    """
    sizes = plan.sizes(TEAM_SIZES, ROBOTS)
    seconds = plan.seconds or LARGEST_SECONDS
    trials: list[TeamTrial] = []
    for robots in sizes:
        plan.say(f"largest team: {robots} robots for {seconds:g} s")
        with Server(plan.world, SERVER_LIMIT) as server, Crowd(server.port, plan.seed) as crowd:
            trials.append(try_team(server, crowd, robots, seconds))
        if trials[-1].factor < LARGEST_FACTOR:
            break
    kept = [trial.robots for trial in trials if trial.factor >= LARGEST_FACTOR]
    # One size alone says nothing about the aim.
    aim = LARGEST_AIM if len(sizes) > 1 else None
    figures = [Figure("Largest team in real time", max(kept, default=0), "robots", 0, aim)]
    for trial in trials:
        name = f"{trial.robots} robots"
        figures.append(Figure(f"{name}: real-time factor", trial.factor, "", 4))
        figures.append(Figure(f"{name}: processor use", trial.load.process, "cores", 2))
    return Section(
        "largest",
        "The largest team",
        f"{DEFAULT_CLASS} with all their sensors in {plan.world}, {seconds:g} s for each size; "
        f"real time means a factor of at least {LARGEST_FACTOR:g} for every robot.",
        tuple(figures),
    )


Dice = random.Random
Words = Callable[[Dice], str]


def roam(controller: Controller, dice: Dice) -> None:
    """Give a robot its next command: at random, in the words of its class."""
    words = MIXED.get(controller.robot_class)
    if words is None:
        wander(controller, dice)
    else:
        controller.send(words(dice))


def _sides(dice: Dice) -> str:
    left, right = dice.uniform(-100.0, 100.0), dice.uniform(-100.0, 100.0)
    return f"DRIVE {{Left {left:.1f}}} {{Right {right:.1f}}} {{Normalized True}}"


def _car(dice: Dice) -> str:
    speed, steer = dice.uniform(-100.0, 100.0), dice.uniform(-0.5, 0.5)
    return (
        f"DRIVE {{Speed {speed:.1f}}} {{FrontSteer {steer:.2f}}} {{RearSteer {-steer:.2f}}} "
        "{Normalized True}"
    )


def _wheels(dice: Dice) -> str:
    steer, speed = dice.uniform(-1.5, 1.5), dice.uniform(-100.0, 100.0)
    groups = [
        f"{{WheelNumber {number}}} {{WheelSpeed {speed:.1f}}} {{WheelSteer {steer:.2f}}}"
        for number in range(4)
    ]
    return f"DRIVE {' '.join(groups)} {{Normalized True}}"


def _flight(dice: Dice) -> str:
    names = ("AltitudeVelocity", "LinearVelocity", "LateralVelocity", "RotationalVelocity")
    members = [f"{{{name} {dice.uniform(-40.0, 40.0):.1f}}}" for name in names]
    return f"DRIVE {' '.join(members)} {{Normalized True}}"


def _flippers(dice: Dice) -> str:
    """Half of the time it drives, half of the time its flippers move."""
    if dice.random() < 0.5:
        return _sides(dice)
    names = ("FRFlipper", "FLFlipper", "RRFlipper", "RLFlipper")
    return f"MULTIDRIVE {' '.join(f'{{{name} {dice.uniform(-0.8, 0.8):.2f}}}' for name in names)}"


def _joints(*names: str) -> Words:
    """A pose of joints that are named."""

    def words(dice: Dice) -> str:
        poses = [f"{{{name} {dice.uniform(-0.3, 0.3):.2f}}}" for name in names]
        return f"MULTIDRIVE {' '.join(poses)}"

    return words


def _arm(name: str, links: int, drives: bool) -> Words:
    """A pose of an arm, or, of a robot that also drives, a drive."""

    def words(dice: Dice) -> str:
        if drives and dice.random() < 0.5:
            return _sides(dice)
        groups = [
            f"{{Link {n}}} {{Value {dice.uniform(-0.6, 0.6):.2f}}}" for n in range(1, links + 1)
        ]
        return f"MISPKG {{Name {name}}} {' '.join(groups)}"

    return words


MIXED: Mapping[str, Words] = {
    "P2AT": _sides,
    "Kenaf": _flippers,
    "AirRobot": _flight,
    "BasicAckermanRobot": _car,
    "Nao": _joints("HeadYaw", "HeadPitch", "LShoulderPitch", "RShoulderPitch"),
    "KUKA_LWR_BOT": _arm("kuka_lwr", 7, False),
    "Lisa": _wheels,
    "TeleMax": _flippers,
    "P2DX": _sides,
    "P3AT_arm": _arm("P3ATArm", 5, True),
    "Talon": _sides,
    "quadrotor": _flight,
    "ERS": _joints("LFRotate", "RFRotate", "LRRotate", "RRRotate"),
    "FrontAckerman": _car,
    "P3AT": _sides,
    "ATRVJr": _sides,
}
"""Classes of the team in the order in which they join, and what each is told."""


def measure_garage(plan: Plan) -> Section:
    """Robots of every kind at real time; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or len(MIXED), plan.seconds or SECONDS
    plan.say(f"garage: {robots} robots of {min(robots, len(MIXED))} classes for {seconds:g} s")
    with Server(plan.world, robots) as server, Crowd(server.port, plan.seed, roam) as crowd:
        trial = try_team(server, crowd, robots, seconds, tuple(MIXED))
    return Section(
        "garage",
        f"A mixed team of {robots} robots",
        f"{', '.join(list(MIXED)[:robots])} with all their sensors in {plan.world}, random "
        f"commands of their kind at 2 Hz each, clients in another process, {seconds:g} s.",
        tuple(team_figures(trial, FACTOR_AIM, CORES_AIM)),
    )
