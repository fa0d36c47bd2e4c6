"""Reads a scenario file, and finds the shipped ones by name.

Strict: what is wrong with the file alone becomes one error with file, line and cure. What cannot be
in its world, `check.py` says.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from usarsim_mission.errors import MissionError
from usarsim_mission.scenario.description import SCHEMA, Event, Scenario
from usarsim_operator.injects import WHOM
from usarsim_server.base.errors import at
from usarsim_server.base.files import is_folder, is_regular
from usarsim_server.base.lined import LinedTable, key_lines
from usarsim_server.base.tables import Table, nearest
from usarsim_server.base.toml import parse_toml, read_text

SHIPPED = Path(__file__).parents[1] / "missions"
"""Folder of the missions that come along."""


def find_mission(name_or_path: str) -> Path:
    """The file of a mission: a path, or the name of a shipped one in any case.

    Raises:
        MissionError: there is none; the message lists the names that would do.
    """
    path = Path(name_or_path).expanduser()
    if is_regular(path):
        return path
    by_lower = {one.stem.lower(): one for one in shipped_missions()}
    if len(path.parts) > 1 or path.suffix:
        raise MissionError(at(path, "no such file", _looked(path)))
    found = by_lower.get(name_or_path.lower())
    if found is None:
        close = difflib.get_close_matches(name_or_path.lower(), by_lower, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        cure = f"{hint}known missions: {', '.join(by_lower)}; or name a file"
        raise MissionError(at(name_or_path, "no such mission", cure))
    return found


def _looked(path: Path) -> str:
    """Where a file was looked for, and what is there instead."""
    whole = path.absolute()
    if is_folder(whole):
        return f"{whole} is a folder: name a file in it"
    folder = next(one for one in whole.parents if one.exists())
    if folder != whole.parent:
        return f"looked for {whole}: there is no {whole.parent}, only {folder}"
    if not is_folder(folder):
        return f"looked for {whole}: {folder} is no folder"
    try:
        names = [one.name for one in folder.iterdir() if one.suffix == ".toml"]
    except OSError:
        names = []
    close = nearest(whole.name, sorted(names))
    return f"looked for {whole}" + (f"; did you mean {close}?" if close else "")


def shipped_missions() -> list[Path]:
    """Files of the missions that come along, sorted by name."""
    return sorted(SHIPPED.glob("*.toml"))


def read_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        MissionError: naming file, line, key, what is wrong and what to write instead.
    """
    text = read_text(path, MissionError)
    return parse_scenario(text, path)


def parse_scenario(text: str, path: Path) -> Scenario:
    """The same for the text of one; paths in it are seen from the folder of `path`.

    Raises:
        MissionError: as `read_scenario`.
    """
    return scenario_of(parse_toml(text, path, MissionError, "robot"), text, path)


def scenario_of(content: Mapping[str, Any], text: str, path: Path) -> Scenario:
    """The same for what a text says, as TOML has it; the text tells the lines of errors."""
    if not content:
        cure = (
            f'begin with schema = "{SCHEMA}", title, world and a [[robot]]: docs/howto/mission.md'
        )
        raise MissionError(at(path, "says nothing", cure))
    table = LinedTable.top(content, path, MissionError, lambda: key_lines(text))
    schema = table.text("schema")
    if schema != SCHEMA:
        raise table.error("schema", f"{schema!r} is not known", f'write "{SCHEMA}"')
    scenario = replace(table.read(Scenario), path=path, table=table, content=content)
    table.finish()
    _check(table, scenario)
    return scenario


def _check(table: Table, scenario: Scenario) -> None:
    """What the file alone shows to be wrong."""
    if not scenario.robots:
        raise table.error("robot", "there is no robot", "add a [[robot]] table with a name")
    robots, victims = table.tables("robot"), table.tables("victim")
    zones, events = table.tables("zone"), table.tables("event")
    _unlike(robots, (one.name for one in scenario.robots))
    _unlike(victims, (one.name for one in scenario.victims))
    _unlike(zones, (one.name for one in scenario.zones))
    _unlike(events, (one.name for one in scenario.events))
    for inner, robot in zip(robots, scenario.robots, strict=True):
        if robot.start is not None and robot.position is not None:
            raise inner.error("position", "stands beside start", "keep one of the two")
        if robot.position is None and inner.has("yaw_degrees"):
            raise inner.error("yaw_degrees", "stands without position", "add the position")
        if robot.unattended == "patrol" and not robot.route:
            raise inner.error("unattended", "a patrol has no route", "add route = [[x, y], ...]")
    for inner, zone in zip(zones, scenario.zones, strict=True):
        if zone.polygon and (zone.x or zone.y):
            raise inner.error("polygon", "stands beside x or y", "keep one of the two")
        if not zone.polygon and (zone.x is None or zone.y is None):
            raise inner.error("polygon", "is missing", "add polygon = [[x, y], ...], or x and y")
    for inner, event in zip(events, scenario.events, strict=True):
        _check_event(inner, event, scenario)
    if scenario.video.jitter_ms > scenario.video.delay_ms:
        video = table.table("video")
        raise video.error("jitter_ms", "is more than delay_ms", "write a smaller one")
    _check_places(table, scenario)


def _unlike(tables: list[Table], names: Iterable[str]) -> None:
    seen: dict[str, int] = {}
    for number, (inner, name) in enumerate(zip(tables, names, strict=True), start=1):
        first = seen.setdefault(name.lower(), number)
        if first != number:
            problem = f"{name!r} is already the name of number {first}"
            raise inner.error("name", problem, "give each its own; capitals make no difference")


def _check_event(table: Table, event: Event, scenario: Scenario) -> None:
    if (event.at is None) == (event.when is None):
        problem = "has neither `at` nor `when`" if event.at is None else "has both `at` and `when`"
        raise table.error("", problem, 'write at = 60.0, or when = "found"')
    if event.when is None:
        for key in ("of", "count", "after"):
            if table.has(key):
                raise table.error(key, "belongs to `when`", "remove it, or write when")
    elif event.at is None and event.when == "first_input" and event.of is not None:
        raise table.error("of", "the first input is nobody's", "remove it")
    need = WHOM[event.do]
    if not getattr(event, need):
        raise table.error(need, "is missing", f"{event.do} wants {need} = ...")
    for key in ("robot", "victim", "text"):
        beside = event.do == "victim_calls" and key == "text"
        if key != need and not beside and table.has(key):
            raise table.error(key, f"means nothing to {event.do}", "remove it")
    robots = [one.name for one in scenario.robots]
    if event.robot is not None and event.robot not in robots:
        raise table.error("robot", f"no robot is called {event.robot!r}", _one_of(robots))
    if event.at is not None and event.at >= scenario.time_limit:
        problem = f"{event.at:g} s is after the end of the trial"
        raise table.error("at", problem, f"write less than {scenario.time_limit:g}")


def _check_places(table: Table, scenario: Scenario) -> None:
    wanting = [one for one in scenario.victims if one.position is None]
    if len(wanting) > len(scenario.places):
        problem = f"{len(wanting)} victims without a position and {len(scenario.places)} places"
        raise table.error("place", problem, "add [[place]] tables, or positions")


def _one_of(names: list[str]) -> str:
    return f"write one of {', '.join(names)}"
