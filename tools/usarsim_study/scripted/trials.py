"""Trials without a server: a scripted operator in a kinematic world, judged by the real referee.

What comes out are records as a run logs them, so measures are those of a study. Robots that drive
by themselves search the floor together, as their policy would. What no point on a plan can tell
(maps, latency, pictures) is not told, and so is missing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from usarsim_client.truth import TruthRow
from usarsim_mission.model import World
from usarsim_mission.referee import Referee
from usarsim_mission.scenario.staging import Staged
from usarsim_study.measures import team
from usarsim_study.scripted.floor import Floor
from usarsim_study.scripted.kinematics import KinematicWorld
from usarsim_study.scripted.operator import Choose, Drive, Mark, ScriptedOperator
from usarsim_study.scripted.skill import Device, Skill
from usarsim_study.trial import Record, Trial

STEP = 0.2
"""s between two rows of the truth."""
EXPLORER = Skill(reaction=0.0, dwell=math.inf, neglect=0.0, miss=1.0, keyboard=0.5, turn=0.2)
"""Drives robots that nobody drives; it recognises nobody."""


@dataclass(frozen=True, slots=True)
class Ground:
    """Where trials are: a mission as it would be run.

    Attributes:
        staged: the mission. world: what the referee knows; without the floor, of which it would
            only tell the share that was seen. floor: ways over it.
        names: of robots. watched: those of them that drive by themselves.
    """

    staged: Staged
    world: World
    floor: Floor
    names: tuple[str, ...]
    watched: frozenset[str]

    @property
    def limit(self) -> float:
        """s of a trial."""
        return self.staged.scenario.time_limit


def ground(staged: Staged, unattended: str) -> Ground:
    """The ground of a mission.

    Args:
        staged: the mission. unattended: what robots do that nobody drives; `mission`: its own.

    Raises:
        ValueError: nobody knows its floor.
    """
    world = staged.referee_world()
    if world.floor is None:
        raise ValueError("the floor of this world is not known")
    policies = {
        one.entry.name: one.entry.unattended if unattended == "mission" else unattended
        for one in staged.robots
    }
    watched = frozenset(name for name, policy in policies.items() if policy != "stop")
    return Ground(staged, world, Floor(world.floor), tuple(policies), watched)


class _Log:
    """Records of a trial, judged as they come."""

    def __init__(self, place: Ground, limit: float) -> None:
        blind = replace(place.world, floor=None)
        mission = replace(place.staged.referee_mission(), time_limit=limit)
        self.referee = Referee(mission, place.staged.rules, blind)
        self.records: list[Record] = []

    def tell(self, time: float, kind: str, **facts: Any) -> None:
        record = {"seq": len(self.records), "t_wall": time, "t_sim": time, "kind": kind, **facts}
        self.records.append(record)
        for one in self.referee.feed(record):
            self.records.append({**one, "seq": len(self.records)})


def run_trial(
    place: Ground,
    skill: Skill,
    device: Device,
    seed: int,
    limit: float | None = None,
    *,
    told: bool = False,
) -> list[Record]:
    """Let an operator search until the trial is over.

    Args:
        place: where. skill: of the operator. device: that it holds. seed: of what is drawn.
        limit: s of the trial; None: as the mission says.
        told: whether somebody has said where victims are, as in a training.

    Returns:
        The records of the run, in order.
    """
    limit = place.limit if limit is None else min(limit, place.limit)
    world, log, time = KinematicWorld(place.world), _Log(place, limit), 0.0
    operator = ScriptedOperator(skill, device, place.floor, place.names, seed, place.watched)
    if told:
        operator.is_told([one.pos[:2] for one in place.world.victims])
    explorers = _explorers(place, seed)
    robots = [{"name": one.name, "class": one.kind} for one in place.world.starts]
    log.tell(0.0, "session", robots=robots, operators=1, mission=place.staged.scenario.name)
    log.tell(0.0, "connect", page=1, role="operator", name="operator", on=True)
    for name in sorted(place.watched):
        log.tell(0.0, "mode", robot=name, mode="autonomous", policy="explore", by="")
    log.tell(0.0, "trial_start", limit=limit)
    marks = 0
    while log.referee.over is None:
        row = world.row(time)
        log.tell(time, "truth", **_facts(row))
        for explorer in explorers:
            for act in explorer.see(row):
                if isinstance(act, Drive):
                    world.drive(act.robot, act.forward, act.turn)
        for act in operator.see(row):
            match act:
                case Choose():
                    log.tell(time, "select", page=1, robot=act.robot)
                case Drive():
                    world.drive(act.robot, act.forward, act.turn)
                    wheels = {"left": act.forward + act.turn, "right": act.forward - act.turn}
                    log.tell(time, "command", robot=act.robot, source="operator", **wheels)
                case Mark():
                    marks += 1
                    said = {"robot": act.robot, "place": list(act.place), "page": 1}
                    log.tell(time, "mark_set", mark=marks, by="operator", **said)
        world.step(STEP)
        time = round(time + STEP, 6)
    log.tell(log.referee.over_at or time, "trial_end", why=log.referee.over, text="")
    return log.records


def _explorers(place: Ground, seed: int) -> list[ScriptedOperator]:
    """One for each robot that drives by itself; they know of each other."""
    found: list[ScriptedOperator] = []
    for name in sorted(place.watched):
        one = ScriptedOperator(EXPLORER, "keyboard", place.floor, (name,), seed)
        if found:
            one.joins(found[0])
        found.append(one)
    return found


def values_of_trial(records: Sequence[Record]) -> Mapping[str, float | None]:
    """The team's measures."""
    return team(Trial(records))


def _facts(row: TruthRow) -> dict[str, Any]:
    robots = [
        {
            "name": one.name,
            "pos": one.pos,
            "quat": one.quat,
            "linear": one.linear,
            "angular": one.angular,
            "battery": None,
            "contacts": [
                {"with": touch.kind, "name": touch.name, "time": touch.time}
                for touch in one.contacts
            ],
        }
        for one in row.robots
    ]
    views = [
        {
            "robot": one.robot,
            "victim": one.victim,
            "angle": one.angle,
            "distance": one.distance,
            "clear": one.clear,
        }
        for one in row.views
    ]
    victims = [{"name": one.name, "pos": one.pos} for one in row.victims]
    return {"robots": robots, "victims": victims, "views": views}
