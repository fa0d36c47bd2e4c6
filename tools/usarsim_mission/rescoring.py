"""Scores a run again from its logs alone, and compares with what was told live."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usarsim_mission.errors import RunLogError
from usarsim_mission.records import DERIVED, Record
from usarsim_mission.referee import Referee
from usarsim_mission.runlog import SCORE, RunFolder
from usarsim_server.base.errors import at
from usarsim_server.base.files import read_regular, reason
from usarsim_server.protocol.json_text import parse_json

_MOST = 20
"""Differences that are told."""


@dataclass(frozen=True, slots=True)
class Rescored:
    """A run as its logs have it.

    Attributes:
        result: what `score.json` has to tell.
        live: what it does tell; None if there is none.
        differences: in words, between the verdicts in the log and those made now.
        damage: in words, what is missing of the logs.
    """

    result: dict[str, Any]
    live: dict[str, Any] | None
    differences: list[str]
    damage: list[str]


def rescore(folder: Path) -> Rescored:
    """Feed the logs of a run to a new referee.

    Raises:
        MissionError: they cannot be read.
    """
    run = RunFolder(folder)
    mission, world = run.world()
    referee = Referee(mission, run.rules(), world)
    differences: list[str] = []
    due: list[Record] = []
    ends = False
    for record in run.records():
        ends = ends or record["kind"] == "trial_end"
        if record["kind"] in DERIVED:
            _compare(record, due.pop(0) if due else None, differences)
            continue
        if record["kind"] == "error":  # the writer's own, which may come between
            continue
        for left in due:
            differences.append(f"before record {record['seq']}: the log has no {_words(left)}")
        due = [parse_json(json.dumps(one)) for one in referee.feed(record)]
    damage = [f"{name}: the last line is cut off" for name in run.cut]
    if run.missing:
        damage.append(f"{run.missing} records are missing")
    if due and not damage and ends:  # else it was cut off between two lines
        differences += [f"at the end the log has no {_words(left)}" for left in due]
    result, live = referee.result(), live_result(folder / SCORE)
    if live is not None:
        differences += _unequal(SCORE, live, result)
    more = len(differences) - _MOST
    told = [*differences[:_MOST], f"and {more} more"] if more > 0 else differences
    return Rescored(result, live, told, damage)


def _compare(logged: Record, made: Record | None, differences: list[str]) -> None:
    where = f"record {logged['seq']}"
    if made is None:
        differences.append(f"{where}: the log has {_words(logged)}, which does not follow")
        return
    plain = {key: one for key, one in logged.items() if key not in ("seq", "t_wall")}
    differences += _unequal(where, plain, made)


def _unequal(where: str, logged: Any, made: Any) -> Iterator[str]:
    """Each value in which two plain structures differ."""
    if isinstance(logged, Mapping) and isinstance(made, Mapping):
        for key in dict.fromkeys((*logged, *made)):
            yield from _unequal(f"{where}: {key}", logged.get(key), made.get(key))
    elif isinstance(logged, list) and isinstance(made, list) and len(logged) == len(made):
        for number, (one, other) in enumerate(zip(logged, made, strict=True), start=1):
            yield from _unequal(f"{where}: {number}", one, other)
    elif logged != made:
        yield f"{where}: {json.dumps(logged)} in the log, {json.dumps(made)} now"


def _words(record: Mapping[str, Any]) -> str:
    names = (record.get(key) for key in ("robot", "zone", "victim", "mark", "total"))
    facts = ", ".join(str(name) for name in names if name is not None)
    return f"{record['kind']} ({facts}) at {record['t_sim']:g} s"


def live_result(path: Path) -> dict[str, Any] | None:
    """What `score.json` tells; None if there is none.

    Raises:
        RunLogError: it cannot be read.
    """
    if not path.exists():
        return None
    try:
        content = parse_json(read_regular(path))
    except OSError as error:
        cure = "check its rights, or remove it"
        raise RunLogError(at(path, f"cannot be read: {reason(error)}", cure)) from error
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise RunLogError(at(path, "is no result", "remove it"))
    return content
