"""MRESim's batch file: JSON with runs on maps, each with a team and a strategy
(exploration 3.5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path, PureWindowsPath

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.mresim.settings import Settings
from usarsim_exploration.mresim.team import read_team
from usarsim_exploration.scenario import Content
from usarsim_server.base.errors import at
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import read_text
from usarsim_server.protocol.json_text import parse_json

_BASICS = {
    "greedy": ("FrontierExploration", "ReturnWhenComplete"),
    "ratio": ("FrontierExploration", "UtilReturn"),
    "role-based": ("RoleBasedExploration", "ReturnWhenComplete"),
}


def is_batch(path: Path) -> bool:
    """Whether a file looks like one."""
    return read_text(path, ExplorationError).lstrip().startswith("{")


def read_batch(
    path: Path, base: Settings, drop: Callable[[str, Settings], None] = lambda name, settings: None
) -> list[tuple[str, Content]]:
    """The runs of a batch: name of the folder of each, and its scenario.

    Files are looked for below `baseDir`, or, where that is a folder of somebody else's computer,
    below the folder of the batch file. Separators may be those of any system.

    Args:
        path: of the file. base: what MRESim had set before, such as the radio model.
        drop: told the name and the settings of each run, to say what they drop.

    Raises:
        ExplorationError: naming the run, what is wrong with it, and the cure.
    """
    try:
        content = parse_json(read_text(path, ExplorationError))
    except ValueError as error:
        raise ExplorationError(at(path, f"is no JSON: {error}", "mend the file")) from None
    if not isinstance(content, dict):
        raise ExplorationError(at(path, "is no table", 'write {"globalSettings": ..., "runs": []}'))
    table = Table(content, path, ExplorationError)
    shared = table.table("globalSettings")
    folder = _folder(path.parent, shared.text("baseDir", ""), shared.text("envDir", ""))
    shared.finish()
    found = []
    for run in table.tables("runs"):
        settings = _settings(run, base)
        environment = folder / _portable(run.text("map"))
        team = folder / _portable(run.text("conf"))
        out = _portable(run.text("outputDir"))
        name = "-".join(part for part in out.parts if part not in ("..", "/"))
        run.finish()
        drop(name, settings)
        place = {"name": str(environment.absolute()), "compat": True}
        found.append((name, {"environment": place} | settings.content | read_team(team)))
    table.finish()
    names = [name for name, _ in found]
    for name in names:
        if names.count(name) > 1:
            problem = f"two runs write to {name!r}"
            raise ExplorationError(at(path, problem, "give each its own outputDir"))
    return found


def _settings(run: Table, base: Settings) -> Settings:
    """What MRESim would set for a run."""
    kind = run.choice("strategy", tuple(_BASICS))
    strategy, policy = _BASICS[kind]
    found = replace(base, strategy=strategy, policy=policy, keep_assigning=True)
    if kind == "greedy":
        for key in ("ratio", "baseRange", "samplingDensity"):
            run.has(key)
        return found
    if kind == "ratio":
        found = replace(found, target=_number(run, "ratio"))
    to_range = _flag(run, "baseRange")
    if to_range or run.has("samplingDensity"):
        found = replace(found, density=_number(run, "samplingDensity"))
    found = replace(found, to_range=to_range)
    if kind == "role-based":
        multi_point = _flag(run, "multiPoint")
        found = replace(
            found,
            multi_point=multi_point,
            relay_explores=_flag(run, "relayExplore"),
            improved_rendezvous=run.text("rvcalc") == "improved",
            role_switch=True,
            replanning=False,
            strict_role_switch=False,
        )
        if multi_point:
            found = replace(
                found,
                explorer_replans=_flag(run, "exploreReplan"),
                relay_to_explorer=_flag(run, "tryToGetToExplorerRV"),
                single_meeting_time=_flag(run, "useSingleMeetingTime"),
            )
    for key in ("ratio", "exploreReplan", "tryToGetToExplorerRV", "useSingleMeetingTime"):
        run.has(key)
    return found


def _flag(run: Table, key: str) -> bool:
    """A text or a value, true or false."""
    value = run.raw(key)
    if value is None:
        run.text(key)  # tells that it is missing
    if str(value).lower() not in ("true", "false"):
        raise run.wrong(key, value, '"true" or "false"')
    return str(value).lower() == "true"


def _number(run: Table, key: str) -> float:
    """A text or a number."""
    value = run.raw(key)
    if value is None:
        run.text(key)
    try:
        return float(str(value))
    except ValueError:
        raise run.wrong(key, value, "a number") from None


def _portable(text: str) -> Path:
    """A path with separators of any system, and no drive."""
    path = PureWindowsPath(text)
    return Path(*(part for part in path.parts if part != path.anchor))


def _folder(beside: Path, base: str, below: str) -> Path:
    """Where maps and teams lie."""
    for start in (Path(base.replace("\\", "/")), beside / _portable(base), beside):
        if base and (start / _portable(below)).is_dir():
            return start / _portable(below)
    return beside / _portable(below)
