"""Driving: ways, time in motion, who drove, what was hit."""

from __future__ import annotations

import math
from itertools import pairwise

from usarsim_study.measures.base import ANALYSIS, BALAKIRSKY, OURS, Part, measure
from usarsim_study.trial import CLOCK, JUMP, Trial


@measure(
    "trial_time",
    "Length of the trial",
    "s",
    "Simulated time from its begin to its end.",
)
def trial_time(trial: Trial, part: Part) -> float | None:
    """End less begin."""
    return trial.length


@measure(
    "distance",
    "Distance",
    "m",
    "Length of the robots' ways at 10 Hz of true positions, summed over robots; faster than 10 m/s "
    "is no driving.",
    OURS,
    by=("robot",),
    adds=True,
)
def distance(trial: Trial, part: Part) -> float | None:
    """Adds steps up."""
    tracks = [rows for name, rows in trial.tracks.items() if name in part.robots]
    if not tracks:
        return None
    steps = (
        (math.dist(one.pos, following.pos), following.time - one.time)
        for rows in tracks
        for one, following in pairwise(rows)
    )
    return sum(step for step, time in steps if step <= JUMP * time)


def _time(trial: Trial, part: Part, moving: bool) -> float | None:
    tracks = [rows for name, rows in trial.tracks.items() if name in part.robots]
    if not tracks:
        return None
    return sum(one.end - one.time for rows in tracks for one in rows if one.moving is moving)


@measure(
    "moving_time",
    "Time in motion",
    "s",
    "Time in which a robot drives at 0.05 m/s or turns at 0.1 rad/s at least, summed over robots.",
    OURS,
    by=("robot",),
    adds=True,
)
def moving_time(trial: Trial, part: Part) -> float | None:
    """Adds rows up."""
    return _time(trial, part, True)


@measure(
    "idle_time",
    "Idle time",
    "s",
    "Time in which a robot does not move, summed over robots.",
    OURS,
    by=("robot",),
    adds=True,
)
def idle_time(trial: Trial, part: Part) -> float | None:
    """Adds rows up."""
    return _time(trial, part, False)


@measure(
    "teleoperation_share",
    "Teleoperation share",
    "1",
    "Time in which an operator's command other than standstill held, summed over robots, over the "
    "length of the trial.",
    ANALYSIS,
    by=("operator", "robot"),
    adds=True,
)
def teleoperation_share(trial: Trial, part: Part) -> float | None:
    """Adds commands up."""
    driven = sum(
        one.end - one.begin
        for one in trial.commands
        if one.driven and part.has(one.who) and one.robot in part.robots
    )
    return driven / trial.length


@measure(
    "teleoperations",
    "Teleoperations",
    "times",
    "How often an operator began to drive a robot that no operator drove.",
    ANALYSIS,
    by=("robot",),
    adds=True,
)
def teleoperations(trial: Trial, part: Part) -> float | None:
    """Counts spans of commands that touch."""
    count = 0
    for robot in part.robots:
        until = -math.inf
        for one in trial.commands:
            if one.robot == robot and one.driven:
                count += one.begin > until + CLOCK
                until = max(until, one.end)
    return float(count)


def _collisions(trial: Trial, part: Part, other: str) -> int:
    return sum(
        one.get("with") == other and one.get("robot") in part.robots
        for one in trial.of("collision")
    )


@measure(
    "collisions",
    "Collisions with the world",
    "1/min",
    "Contacts of robots with walls and things, per minute of the trial; those within the window of "
    "the scoring file are one.",
    BALAKIRSKY,
    by=("robot",),
    adds=True,
    better="less",
    judged=True,
)
def collisions(trial: Trial, part: Part) -> float | None:
    """Counts `collision`."""
    return _collisions(trial, part, "world") / (trial.length / 60.0)


@measure(
    "victim_contacts",
    "Contacts with victims",
    "contacts",
    "Contacts of robots with victims; those within the window of the scoring file are one.",
    BALAKIRSKY,
    by=("robot",),
    adds=True,
    better="less",
    judged=True,
)
def victim_contacts(trial: Trial, part: Part) -> float | None:
    """Counts `collision`."""
    return float(_collisions(trial, part, "victim"))


@measure(
    "robot_contacts",
    "Contacts with robots",
    "contacts",
    "Contacts between robots, each counted once, for the robot that the log names.",
    BALAKIRSKY,
    by=("robot",),
    adds=True,
    better="less",
    judged=True,
)
def robot_contacts(trial: Trial, part: Part) -> float | None:
    """Counts `collision`."""
    return float(_collisions(trial, part, "robot"))
