"""Makes a mission to run of a cell of a study: which file and seed, what a condition changes."""

from __future__ import annotations

import contextlib
import socket
from dataclasses import dataclass, replace
from pathlib import Path

from usarsim_mission.match.conditions import Conditions
from usarsim_mission.match.team import Team
from usarsim_mission.scenario.reader import read_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_mission.scenario.staging import Staged
from usarsim_operator.allowance import halves
from usarsim_operator.serving import Serving
from usarsim_server.base.errors import UsarsimError
from usarsim_study.layouts import mission_file
from usarsim_study.session.steps import Task
from usarsim_study.study_file import Condition, Study


@dataclass(frozen=True, slots=True)
class Options:
    """How sessions are run.

    Attributes:
        speed: simulated s per s, or `max`.
        seconds: longest a trial may be, simulated s; None: as its mission says.
        host: at which desk and panels are served. panel_port: of panels; 0: any free one.
        robots: folders with further classes.
        waits: a trial begins only when all of its operators are ready to drive.
    """

    speed: str = "1"
    seconds: float | None = None
    host: str = "127.0.0.1"
    panel_port: int = 0
    robots: tuple[Path, ...] = ()
    waits: bool = True


def condition_of(study: Study, task: Task) -> Condition:
    """The condition of a trial, or the one that is trained for."""
    assert task.cell is not None
    return study.condition_named(task.cell.condition)


def operators_of(study: Study, task: Task, seats: int) -> int:
    """How many drive: in a training everybody."""
    if task.kind == "training":
        return seats
    return 1 if condition_of(study, task).operators == "one" else 2


def prepare(
    study: Study, folder: Path, task: Task, conditions: Conditions, options: Options
) -> tuple[Staged, Conditions]:
    """A mission as it is run, and its conditions; takes seconds, for a large world.

    Args:
        study: which. folder: of the study; files are seen from there. task: a training or trial.
        conditions: what does not depend on the study. options: of the desk.

    Raises:
        UsarsimError: the mission or a file of the condition cannot be used.
    """
    assert task.cell is not None
    condition = condition_of(study, task)
    training = task.kind == "training" and study.training is not None
    name, seed = _mission_of(study, task)
    scenario = read_scenario(mission_file(name, folder))
    if options.seconds is not None and options.seconds < scenario.time_limit and not training:
        content = {**(scenario.content or {}), "time_limit": options.seconds}
        scenario = replace(scenario, time_limit=options.seconds, content=content)
    if study.blind and condition.mission and not training:
        # Its title may say what is compared.
        content = {**(scenario.content or {}), "title": study.title}
        scenario = replace(scenario, title=study.title, content=content)
    staged = stage(scenario, seed=seed, robots=options.robots)
    alone = None if condition.unattended == "mission" or training else condition.unattended
    told = replace(
        conditions,
        device=condition.device,
        tells_device=not study.blind,
        robots=None if training else condition.robots,
        unattended=alone,
        impair=folder / condition.impair if condition.impair else None,
    )
    staged = told.applied(staged)
    names = [one.entry.name for one in staged.robots]
    if condition.operators == "split" and told.operators == 2:
        told = replace(told, split=halves(names, 2))
    _ = staged.reached, staged.painted  # the expensive parts, not on the desk's own time
    return staged, replace(told, robots=None, unattended=None)


def limit_of(study: Study, folder: Path, task: Task, seconds: float | None) -> float | None:
    """How long a training or trial lasts at most, simulated s; None: its mission cannot be read.

    Args:
        study: which. folder: of the study. task: a training or trial.
        seconds: longest a trial may be; None: as its mission says.
    """
    try:
        limit = read_scenario(mission_file(_mission_of(study, task)[0], folder)).time_limit
    except UsarsimError:
        return None  # whoever begins it is told why
    return limit if seconds is None or task.kind == "training" else min(limit, seconds)


def _mission_of(study: Study, task: Task) -> tuple[str, int | None]:
    """Name and seed of the mission of a training or trial."""
    assert task.cell is not None
    if task.kind == "training" and study.training is not None:
        return study.training.mission, None
    return study.mission_of(task.cell)


def team_of(code: str, operators: int) -> Team:
    """The participant as a team."""
    return Team(name=code, console=True, operators=operators)


def panel_port(host: str, wanted: int, desk: int) -> int:
    """The port of all panels of a desk: browsers keep keys and pads by address, port included.

    Args:
        host: at which they are served. wanted: by the user; 0: the next one after the desk's, or
            any that is free. desk: port of the desk.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for port in (wanted,) if wanted else (desk + 1, 0):
        with (
            contextlib.suppress(OSError, OverflowError),
            socket.create_server((host, port), family=family) as one,
        ):
            return int(one.getsockname()[1])
    return wanted  # taken for now: whoever serves there says so


def panels_served(options: Options, framed_by: frozenset[str]) -> Serving:
    """How the panel is served: shown inside the desk's pages only."""
    return Serving(options.host, options.panel_port, framed_by=framed_by)
