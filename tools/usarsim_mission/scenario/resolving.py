"""Puts a scenario into its world: looks up every name, draws every seed, places every victim."""

from __future__ import annotations

import hashlib
import math
import random
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from usarsim_mission.errors import MissionError
from usarsim_mission.scenario import fleet
from usarsim_mission.scenario.description import (
    PURPOSES,
    RobotEntry,
    Scenario,
    Seeds,
    VictimEntry,
    beside,
)
from usarsim_mission.scenario.staging import Robot, Staged
from usarsim_mission.scoring import Rules, find_rules
from usarsim_server.base.errors import UsarsimError, problem_and_advice
from usarsim_server.base.files import is_regular
from usarsim_server.base.tables import Table, suggest
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import StartPose, Victim, WorldDescription
from usarsim_server.worlds.life import traits_of
from usarsim_server.worlds.loader import find_world, load_world

MAPS = "usarsim_server.maps"
"""Entry point group of what makes a world folder of a map; see `usarsim_server.app`."""


def stage(
    scenario: Scenario,
    *,
    seed: int | None = None,
    world: str | None = None,
    robots: tuple[Path, ...] = (),
    allow_outside: bool = False,
) -> Staged:
    """Put a scenario into its world.

    Args:
        scenario: as it was read.
        seed: instead of that of the file; those that the file names under `[seeds]` stay.
        world: instead of that of the file: a name, or a path seen from where we are.
        robots: folders with further classes.
        allow_outside: a map may read files that lie elsewhere.

    Raises:
        UsarsimError: a name is not known, or the world cannot be read.
    """
    table = scenario.table
    if world is not None:
        path = Path(world).expanduser()
        scenario = replace(scenario, world=str(path.absolute()) if path.exists() else world)
    scenario = _placed_victims(_seeded(scenario, seed))
    base = _base(scenario, table, allow_outside)
    rules = _rules(scenario, table)
    kept = base.victims if scenario.keep_victims else ()
    tables = table.tables("victim")
    own = [_victim(inner, one) for inner, one in zip(tables, scenario.victims, strict=True)]
    taken = {victim.name.lower() for victim in kept}
    for inner, victim in zip(tables, own, strict=True):
        if victim.name.lower() in taken:
            problem = f"the world has a victim called {victim.name!r}"
            raise inner.error("name", problem, "choose another name, or keep_victims = false")
    members = [
        _robot(inner, entry, base, robots)
        for inner, entry in zip(table.tables("robot"), scenario.robots, strict=True)
    ]
    _check_names(scenario, table, base, [*kept, *own])
    return Staged(scenario, base, rules, (*kept, *own), tuple(members), allow_outside)


def _seeded(scenario: Scenario, seed: int | None) -> Scenario:
    master = scenario.seed if seed is None else seed
    given = scenario.seeds

    def drawn(purpose: str) -> int:
        digest = hashlib.sha256(f"{master}/{purpose}".encode()).digest()
        return int.from_bytes(digest[:4], "big") >> 1

    values = {one: getattr(given, one) for one in PURPOSES}
    seeds = Seeds(**{k: drawn(k) if v is None else v for k, v in values.items()})
    return replace(scenario, seed=master, seeds=seeds)


def _placed_victims(scenario: Scenario) -> Scenario:
    """Whoever has no position gets one of the places, no two the same."""
    wanting = [one for one in scenario.victims if one.position is None]
    chosen = random.Random(scenario.seeds.victims).sample(scenario.places, len(wanting))
    places = iter(chosen)

    def settle(victim: VictimEntry) -> VictimEntry:
        if victim.position is not None:
            return victim
        place = next(places)
        posture: Any = place.posture or victim.posture
        return replace(
            victim, position=place.position, yaw_degrees=place.yaw_degrees, posture=posture
        )

    return replace(scenario, victims=tuple(map(settle, scenario.victims)), places=())


def _base(scenario: Scenario, table: Table, allow_outside: bool) -> WorldDescription:
    name = scenario.world
    path = beside(scenario, name)
    try:
        if is_regular(path):
            for point in entry_points(group=MAPS):
                return load_world(point.load()(path, allow_outside))
            raise table.error("world", "maps cannot be imported", "install usarsim_maps")
        return load_world(find_world(str(path) if "/" in name else name))
    except UsarsimError as error:
        if isinstance(error, MissionError):
            raise
        problem, advice = problem_and_advice(str(error))
        raise table.error("world", problem, advice or "name another world") from error


def _rules(scenario: Scenario, table: Table) -> Rules:
    try:
        return find_rules(scenario.scoring, scenario.path.parent)[1]
    except UsarsimError as error:
        problem, advice = problem_and_advice(str(error))
        raise table.error("scoring", problem, advice or "name another one") from error


def _victim(table: Table, entry: VictimEntry) -> Victim:
    assert entry.position is not None
    properties: dict[str, object] = {**entry.properties, "hot": entry.hot}
    for key, value in (("sound", entry.calls), ("motion", entry.moves)):
        if value is not False:
            properties[key] = value
    turn = quaternion_from_rpy(0.0, 0.0, math.radians(entry.yaw_degrees))
    pose = Pose(entry.position, turn)
    victim = Victim(entry.name, pose, entry.posture, entry.status, properties, entry.scale)
    try:
        traits_of(victim, "victim")
    except UsarsimError as error:
        problem, advice = problem_and_advice(str(error))
        key = "moves" if "motion" in problem else "calls" if "sound" in problem else "properties"
        raise table.error(key, problem.removeprefix("victim: "), advice or "mend it") from error
    return victim


def _robot(
    table: Table, entry: RobotEntry, base: WorldDescription, folders: tuple[Path, ...]
) -> Robot:
    known = fleet.catalog(folders)
    robot = known.find(entry.kind)
    if robot is None:
        raise table.error("class", f"no class {entry.kind!r}", suggest(entry.kind, known.names()))
    if entry.position is not None:
        turn = quaternion_from_rpy(0.0, 0.0, math.radians(entry.yaw_degrees))
        return Robot(entry, robot, StartPose(f"{entry.name}_start", Pose(entry.position, turn), 0))
    tags = [start.tag for start in base.starts]
    if entry.start is None:
        raise table.error("start", "is missing", f"add start = {tags[0]!r}, or a position")
    start = base.start(entry.start)
    if start is None:
        problem = f"the world has no start pose {entry.start!r}"
        raise table.error("start", problem, suggest(entry.start, tags))
    return Robot(entry, robot, start)


def _check_names(
    scenario: Scenario, table: Table, base: WorldDescription, victims: list[Victim]
) -> None:
    """What events name has to be there."""
    names = {
        "victim": [victim.name for victim in victims],
        "robot": [robot.name for robot in scenario.robots],
        "zone": [zone.name for zone in scenario.zones],
    }
    if scenario.keep_zones:
        names["zone"] += [zone.name for zone in base.zones]
    kinds = {"found": "victim", "credited": "victim", "enters": "zone", "leaves": "zone"}
    for inner, event in zip(table.tables("event"), scenario.events, strict=True):
        if event.victim is not None and event.victim not in names["victim"]:
            cure = suggest(event.victim, names["victim"])
            raise inner.error("victim", f"nobody is called {event.victim!r}", cure)
        kind = kinds.get(event.when or "", "robot")
        if event.of is not None and event.of not in names[kind]:
            problem = f"no {kind} is called {event.of!r}"
            raise inner.error("of", problem, suggest(event.of, names[kind]))
