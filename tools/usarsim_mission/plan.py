"""The plan of a batch: which teams play which seeds of a mission. It stands beside their folders.

What has been played is not in it: that follows from the folders. So an interrupted batch goes on
where it was, and a league knows which runs are missing.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

from usarsim_mission.errors import MissionError
from usarsim_mission.model import plain
from usarsim_server.base.errors import at
from usarsim_server.base.fields import field
from usarsim_server.base.files import read_regular, reason, write_text
from usarsim_server.base.tables import Table
from usarsim_server.protocol.json_text import parse_json

PLAN = "batch.json"
SCHEMA = "usar-batch/1"


@dataclass(frozen=True, slots=True)
class PlannedTeam:
    """A team of a batch."""

    name: str = field(help="of the team")
    digest: str = field(help="of what its file says: runs of another file do not compare")


@dataclass(frozen=True, slots=True)
class Plan:
    """What a batch plays: each team each seed."""

    mission: str = field(help="name of the mission")
    digest: str = field(help="of the mission as it is run, but for its seed, and of its rules")
    schema: str = field(default=SCHEMA, choices=(SCHEMA,), help="of the file")
    teams: tuple[PlannedTeam, ...] = field(default=(), help="all that play")
    seeds: tuple[int, ...] = field(default=(), help="all that are played")

    def folder(self, team: str, seed: int) -> str:
        """Name of the folder of a run within that of the batch."""
        return f"{folder_name(team)}-{seed}"


def folder_name(team: str) -> str:
    """A team's name as a folder's: no path, nothing hidden."""
    return re.sub(r"[^\w.+-]+", "_", team).strip("._") or "team"


def digest(*texts: str) -> str:
    """Of texts: equal ones have equal digests."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:16]


def read_plan(folder: Path) -> Plan | None:
    """The plan in a folder; None if there is none.

    Raises:
        MissionError: it cannot be read, or something in it cannot be.
    """
    path = folder / PLAN
    try:
        content = parse_json(read_regular(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        cure = "check its rights"
        raise MissionError(at(path, f"cannot be read: {reason(error)}", cure)) from None
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise MissionError(at(path, "is no plan of a batch", "remove it, or name another folder"))
    table = Table(content, path, MissionError)
    plan = table.read(Plan)
    table.finish()
    return plan


def write_plan(folder: Path, plan: Plan) -> Plan:
    """Write the plan of a batch, or add to the one that is there; returns what stands then.

    Raises:
        MissionError: the one that is there is of another mission, or of other teams of these
            names; or it cannot be written.
    """
    standing = read_plan(folder)
    if standing is not None:
        _compare(folder, standing, plan)
        names = {team.name for team in standing.teams}
        more = tuple(team for team in plan.teams if team.name not in names)
        seeds = tuple(dict.fromkeys((*standing.seeds, *plan.seeds)))
        plan = replace(standing, teams=(*standing.teams, *more), seeds=seeds)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / PLAN, json.dumps(plain(plan), indent=1) + "\n")
    except OSError as error:
        cure = "name a folder that can be written"
        raise MissionError(at(folder, f"cannot be made: {reason(error)}", cure)) from None
    return plan


def _compare(folder: Path, standing: Plan, plan: Plan) -> None:
    """Refuse what would lie beside runs with which it does not compare."""
    cure = "name another folder"
    if (standing.mission, standing.digest) != (plan.mission, plan.digest):
        told = "another mission" if standing.mission != plan.mission else "this mission as it was"
        problem = f"has runs of {told} ({standing.mission})"
        raise MissionError(at(folder, problem, cure))
    digests = {team.name: team.digest for team in standing.teams}
    for team in plan.teams:
        if digests.get(team.name, team.digest) != team.digest:
            problem = f"has runs of team {team.name} from another file"
            raise MissionError(at(folder, problem, f"{cure}, or give the team another name"))
