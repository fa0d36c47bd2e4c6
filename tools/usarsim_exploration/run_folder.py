"""The folder of a run: results, logs, picture, and all that is needed to run it again."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path

import numpy as np

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.log_files import AGENTS, STEPS, agents_csv, steps_csv
from usarsim_exploration.measures import measure
from usarsim_exploration.measures.work import longest_without_news
from usarsim_exploration.rules import OLDEST
from usarsim_exploration.running import Result
from usarsim_exploration.scenario import Scenario, load
from usarsim_exploration.showing.picture import draw, png
from usarsim_exploration.showing.scene import scene_of
from usarsim_exploration.strategy_file import split
from usarsim_exploration.worlds import World
from usarsim_exploration.worlds.pictures import save_map
from usarsim_server.base.errors import at
from usarsim_server.base.files import check_links, read_regular, reason, write_bytes, write_text
from usarsim_server.base.toml import toml_text
from usarsim_server.protocol.json_text import parse_json

FORMAT = "usarsim-explore-run/1"
RUN, TIMING, MAP, SCENARIO = "run.json", "timing.json", "map.png", "scenario.toml"
_MAP_SHOWS = "free", "obstacles", "trail", "agents"
_VAIN = 100
"""Steps of search without news from which the line of a run tells them."""
_DIGITS = 9
"""Of numbers behind the point in results: what differs beyond is no result."""


def facts(result: Result) -> dict[str, object]:
    """What `run.json` says; the same for the same scenario, wherever and whenever it runs."""
    world, scenario = result.scenario.world, result.scenario
    rows, columns = world.environment.shape
    found: dict[str, object] = {
        "format": FORMAT,
        "version": version("usarsim-server"),
        "scenario": portable(scenario),
        "environment": {
            "name": world.environment.name,
            "columns": columns,
            "rows": rows,
            "cell": world.environment.cell,
            "free": int(result.history.free[-1]),
            "reachable": int(result.history.reachable[-1]),
            "digest": _digest(world),
        },
        "rules": scenario.rules.number,
        "seed": scenario.basics.seed,
        "ended": {"reason": result.ended, "step": result.history.steps},
        "events": [{"step": step, "event": what} for step, what in result.events],
        "measures": measure(result.history),
    }
    if result.unawaited:
        found["unawaited"] = [{"step": one.step, "event": one.text} for one in result.unawaited]
    if scenario.basics.backend == "server":
        found["localisation"] = scenario.physics.localisation
    if result.error:
        found["error"] = result.error
    told = rounded(found)
    assert isinstance(told, dict)
    return told


def portable(scenario: Scenario) -> dict[str, object]:
    """The whole scenario; files are named as they lie in the folder of the run."""
    found = scenario.resolved
    strategy = found["strategy"]
    assert isinstance(strategy, dict)
    if scenario.mapped:
        world = scenario.world.environment
        found["environment"] = {"name": f"{world.name}.png", "cell": world.cell}
    parts = split(scenario.strategy_name)
    if parts is not None:
        strategy["name"] = f"{parts[0].name}:{type(scenario.strategy).__name__}"
    return found


def write(result: Result, folder: Path, timing: Mapping[str, object]) -> None:
    """Write all files; `run.json` last, so where it is, the others are, too.

    Raises:
        ExplorationError: one cannot be written.
    """
    try:
        write_scenario(result.scenario, folder)
        write_text(folder / STEPS, steps_csv(result.history))
        write_text(folder / AGENTS, agents_csv(result.history))
        write_bytes(folder / MAP, png(draw(scene_of(result), _MAP_SHOWS)))
        write_text(folder / TIMING, json.dumps(timing, indent=1) + "\n")
        write_text(folder / RUN, json.dumps(facts(result), indent=1) + "\n")
    except OSError as error:
        place = error.filename or folder
        cure = "give a folder that can be written to"
        raise ExplorationError(at(place, f"cannot be written: {reason(error)}", cure)) from error


def prepare(folder: Path) -> None:
    """Make the folder before a long run, so that nobody waits in vain.

    Raises:
        ExplorationError: it cannot be.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        cure = "give another folder"
        raise ExplorationError(at(folder, f"cannot be made: {reason(error)}", cure)) from error


def line(result: Result, timing: Mapping[str, object]) -> str:
    """A run in one line."""
    scenario, history = result.scenario, result.history
    team, base = (
        100 * int(cells[-1]) / int(history.reachable[-1])
        for cells in (history.known_team, history.known_base)
    )
    longest = longest_without_news(history)
    vain = f", nothing new for {longest} steps" if longest >= _VAIN else ""
    return (
        f"{scenario.world.environment.name}, {history.robots} robots, {scenario.strategy_name}, "
        f"seed {scenario.basics.seed}: {result.ended} after {history.steps} steps; "
        f"team knows {team:.1f} %, base {base:.1f} %{vain}; "
        f"{timing['processor_ms_per_step']:.1f} ms of processor per step"
    )


def write_scenario(scenario: Scenario, folder: Path) -> None:
    """Write what is needed to run a scenario; results of another run are no longer valid.

    Raises:
        ExplorationError: it cannot be written.
    """
    prepare(folder)
    try:
        (folder / RUN).unlink(missing_ok=True)
        for name, path in scenario.files.items():
            write_bytes(folder / Path(name).name, read_regular(path))
        if scenario.mapped:
            world = scenario.world.environment
            save_map(world, folder / f"{world.name}.png")
        write_text(folder / SCENARIO, toml_text(portable(scenario)))
    except OSError as error:
        cure = "give a folder that can be written to"
        problem = f"cannot be written: {reason(error)}"
        raise ExplorationError(at(error.filename or folder, problem, cure)) from error


def load_run(folder: Path, options: Iterable[str] = (), *, code: bool) -> Scenario:
    """The scenario of the folder of a run, by the rules that the run had.

    Args:
        folder: with `scenario.toml`, and `run.json` if it has been run. options: as of `load`.
        code: a strategy that stands in a file is run.

    Raises:
        UsarsimError: a file cannot be used.
    """
    check_links(folder, ExplorationError)
    return load(folder / SCENARIO, [*rules_of(folder), *options], code=code)


def rules_of(folder: Path) -> list[str]:
    """The option that says by which rules a run went whose scenario does not say it.

    Results that carry no number are those of the oldest rules.
    """
    try:
        told = parse_json(read_regular(folder / RUN))
    except (OSError, ValueError):
        return []  # not run yet, or damaged: its scenario counts
    older = isinstance(told, dict) and "rules" not in told
    return [f"rules={OLDEST}"] if older else []


def _digest(world: World) -> str:
    """SHA-256 of the cells."""
    found = hashlib.sha256(repr(world.environment.shape).encode())
    found.update(np.packbits(world.environment.walls != 0).tobytes())
    return found.hexdigest()


def rounded(value: object) -> object:
    """Values of results: what differs beyond `_DIGITS` is no result, and infinity is none."""
    if isinstance(value, float):
        return round(value, _DIGITS) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(one) for one in value]
    return value
