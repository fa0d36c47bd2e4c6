"""Attention: which robot an operator dealt with, for how long, and what was left alone."""

from __future__ import annotations

from statistics import fmean, median

from usarsim_study.measures.base import (
    ANALYSIS,
    CRANDALL,
    FAN_OUT,
    OLSEN,
    OURS,
    SWITCHING,
    WANG,
    Part,
    measure,
)
from usarsim_study.trial import Span, Trial, without


def _dwells(trial: Trial, part: Part) -> list[Span]:
    return [one for one in trial.dwells if part.has(one.who) and one.robot in part.robots]


@measure(
    "selections",
    "Selections",
    "selections",
    "Choices of a robot that the operator had not chosen already.",
    ANALYSIS,
    by=("operator", "robot"),
    adds=True,
)
def selections(trial: Trial, part: Part) -> float | None:
    """Counts `select`."""
    return float(
        sum(
            part.has(trial.operator(one.get("page"))) and one["robot"] in part.robots
            for one in trial.selections
        )
    )


@measure(
    "dwell",
    "Mean dwell",
    "s",
    "Mean time from the choice of a robot to the choice of another one or the end of the trial.",
    ANALYSIS,
    by=("operator", "robot"),
)
def dwell(trial: Trial, part: Part) -> float | None:
    """Mean length of dwells."""
    dwells = _dwells(trial, part)
    return fmean(one.length for one in dwells) if dwells else None


@measure(
    "switches",
    "Switches",
    "1/min",
    "Choices of another robot after an operator's first choice, per minute of the trial.",
    WANG,
    by=("operator",),
    adds=True,
)
def switches(trial: Trial, part: Part) -> float | None:
    """Counts dwells that began with a switch."""
    if not trial.dwells:
        return None
    count = sum(one.switched for one in _dwells(trial, part))
    return count / (trial.length / 60.0)


def _standstill(trial: Trial, robot: str) -> list[tuple[float, float]]:
    """Spans in which nobody had chosen a robot and it stood still."""
    still = [(one.time, one.end) for one in trial.tracks[robot] if not one.moving]
    return without(still, [one for one in trial.dwells if one.robot == robot])


@measure(
    "neglected_standstill",
    "Neglected standstill",
    "s",
    "Time in which a robot was chosen by nobody and did not move (below 0.05 m/s and 0.1 rad/s), "
    "summed over robots.",
    OURS,
    by=("robot",),
    adds=True,
    better="less",
)
def neglected_standstill(trial: Trial, part: Part) -> float | None:
    """Adds the spans up."""
    known = [name for name in trial.tracks if name in part.robots]
    if not known:
        return None
    return sum(end - begin for name in known for begin, end in _standstill(trial, name))


@measure(
    "longest_standstill",
    "Longest neglected standstill",
    "s",
    "The longest span in which one robot was chosen by nobody and did not move.",
    OURS,
    by=("robot",),
    better="less",
)
def longest_standstill(trial: Trial, part: Part) -> float | None:
    """The longest of the spans."""
    known = [name for name in trial.tracks if name in part.robots]
    if not known:
        return None
    spans = (end - begin for name in known for begin, end in _standstill(trial, name))
    return max(spans, default=0.0)


def _interactions(trial: Trial, part: Part) -> list[Span]:
    return [one for one in trial.interactions if part.has(one.who) and one.robot in part.robots]


@measure(
    "interaction_time",
    "Interaction time",
    "s",
    "IT: mean length of an interaction with a robot. It begins with the choice of the robot, or "
    "with a command after a pause of more than 3 s, and ends with the last command before the "
    "next pause or choice.",
    OLSEN,
    by=("operator", "robot"),
)
def interaction_time(trial: Trial, part: Part) -> float | None:
    """Mean length of interactions."""
    found = _interactions(trial, part)
    return fmean(one.length for one in found) if found else None


@measure(
    "neglect_time",
    "Neglect time",
    "s",
    "NT: mean time between the end of an interaction with a robot and the begin of the next one "
    "with the same robot, by whomever. Time before the first and after the last is left out.",
    CRANDALL,
    by=("robot",),
)
def neglect_time(trial: Trial, part: Part) -> float | None:
    """Mean gap between interactions with the same robot."""
    gaps = []
    for robot in sorted(part.robots):
        spans = [one for one in trial.interactions if one.robot == robot]
        until = None
        for one in spans:
            if until is not None and one.begin > until:
                gaps.append(one.begin - until)
            until = one.end if until is None else max(until, one.end)
    return fmean(gaps) if gaps else None


@measure(
    "attention_demand",
    "Robot attention demand",
    "1",
    "RAD = IT / (IT + NT): the share of an operator's time that a robot takes.",
    OLSEN,
    by=("robot",),
    better="less",
)
def attention_demand(trial: Trial, part: Part) -> float | None:
    """From interaction time and neglect time."""
    interaction, neglect = interaction_time(trial, part), neglect_time(trial, part)
    if interaction is None or neglect is None or interaction + neglect <= 0.0:
        return None
    return interaction / (interaction + neglect)


@measure(
    "fan_out",
    "Fan-out",
    "robots",
    "FO = (IT + NT) / IT = 1 / RAD: how many such robots one operator could keep busy.",
    FAN_OUT,
    by=("robot",),
    better="more",
)
def fan_out(trial: Trial, part: Part) -> float | None:
    """The inverse of attention demand."""
    demand = attention_demand(trial, part)
    return None if not demand else 1.0 / demand


@measure(
    "switch_cost",
    "Switch cost",
    "s",
    "Median time from a switch to another robot to the operator's first command to it; switches "
    "without a command are left out.",
    SWITCHING,
    by=("operator",),
    better="less",
)
def switch_cost(trial: Trial, part: Part) -> float | None:
    """Median of first command less switch."""
    costs = []
    for one in _dwells(trial, part):
        first = next(
            (
                act.begin
                for act in trial.commands
                if (act.who, act.robot) == (one.who, one.robot)
                and one.begin <= act.begin <= one.end
            ),
            None,
        )
        if one.switched and first is not None:
            costs.append(first - one.begin)
    return median(costs) if costs else None


def _reactions(trial: Trial) -> list[float | None]:
    """For each alarm, s to the first reaction; None: there was none before its end."""
    found: list[float | None] = []
    alarms = trial.of("alarm")
    for place, alarm in enumerate(alarms):
        if not alarm.get("on", True):
            continue
        same = (alarm.get("robot"), alarm.get("cause"))
        again = next(
            (
                one["t_sim"]
                for one in alarms[place + 1 :]
                if (one.get("robot"), one.get("cause")) == same and one.get("on", True)
            ),
            trial.end,
        )
        times = [
            one["t_sim"]
            for one in trial.of("acknowledge")
            if (one.get("robot"), one.get("cause")) == same
        ]
        times += [one["t_sim"] for one in trial.selections if one["robot"] == alarm.get("robot")]
        times += [
            one.begin for one in trial.commands if one.robot == alarm.get("robot") and one.changed
        ]
        after = [one for one in times if alarm["t_sim"] < one <= again]
        found.append(min(after) - alarm["t_sim"] if after else None)
    return found


@measure(
    "alarm_reaction",
    "Reaction to alarms",
    "s",
    "Median time from an alarm to the first reaction: its acknowledgement, the choice of its "
    "robot, or another command to it. Alarms without a reaction are left out and counted apart.",
    OURS,
    better="less",
)
def alarm_reaction(trial: Trial, part: Part) -> float | None:
    """Median of the reactions."""
    times = [one for one in _reactions(trial) if one is not None]
    return median(times) if times else None


@measure(
    "alarms_unanswered",
    "Alarms without reaction",
    "alarms",
    "Alarms without a reaction before the same alarm came again or the trial ended.",
    OURS,
    better="less",
)
def alarms_unanswered(trial: Trial, part: Part) -> float | None:
    """Counts them."""
    return float(sum(one is None for one in _reactions(trial)))
