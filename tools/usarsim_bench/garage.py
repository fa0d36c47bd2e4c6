"""A mixed team: robots of every kind together, each driven in its own words."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping

from usarsim_bench.crowd import Controller, Crowd, wander
from usarsim_bench.figures import Figure, Plan, Section
from usarsim_bench.server import Server
from usarsim_bench.team import CORES_AIM, FACTOR_AIM, MIB, SECONDS, load_figures, try_team

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
        return (
            f"MULTIDRIVE {' '.join(f'{{{name} {dice.uniform(-0.3, 0.3):.2f}}}' for name in names)}"
        )

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
        (
            Figure("Real-time factor, lowest of all robots", trial.factor, "", 4, FACTOR_AIM),
            Figure("Real-time factor, worst second of any robot", trial.worst, "", 4),
            Figure("Processor use of the server", trial.load.process, "cores", 2, CORES_AIM),
            Figure("Memory of the server", trial.resident / MIB, "MiB", 0),
            Figure("Lines sent", trial.lines, "1/s", 0),
            Figure("Data sent", trial.octets / 1e3, "kB/s", 0),
            *load_figures(trial.load),
        ),
    )
