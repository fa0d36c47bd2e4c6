"""Plays a run again: the same world, and what pages said at the ticks at which it counted then.

In lockstep a run is a function of its mission and of what counted at which tick (docs/lockstep.md).
Its log has both. So everything goes the same way once more: what robots are told, the world to the
last bit (each row of the truth has a digest of it), and all that the referee makes of it.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from usarsim_client.scene import TruthRow
from usarsim_mission.errors import MissionError, RunLogError
from usarsim_mission.match.conditions import Conditions
from usarsim_mission.match.team import Team
from usarsim_mission.match.trial import Trial
from usarsim_mission.records import DERIVED, Record
from usarsim_mission.runlog import MISSION, SCORING, RunFolder
from usarsim_mission.scenario.policies import policies
from usarsim_mission.scenario.reader import parse_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_operator.replay import Player, Said
from usarsim_server.base.errors import at
from usarsim_server.base.tables import suggest
from usarsim_server.base.toml import read_text

_BY_REFEREE = ("time", "all_found")
"""Ends that come by themselves."""
_REPEAT = DERIVED | {
    *("truth", "trial_start", "trial_end", "map", "input", "connect", "select", "laser", "camera"),
    *("command", "mode", "estop", "enable", "inject", "bumper", "link", "alarm", "acknowledge"),
    *("mark_set", "mark_edit", "mark_delete"),
}
"""Kinds that are compared; others tell of clocks on the wall, of screens, disks and forms."""
_CLOCKS = frozenset({"seq", "t_wall", "gateway_clock"})
"""Keys that need not repeat."""


@dataclass
class Logged:
    """What a log tells of a run in lockstep.

    Attributes:
        session: its first record. said: all that pages said, and when they came and went.
        end: its `trial_end`; None if there is none.
        last: simulated s of the newest row of the truth.
        rows: how many there are. cut: whether the log is not whole.
    """

    session: Record = field(default_factory=dict)
    said: list[Said] = field(default_factory=list)
    end: Record | None = None
    last: float = 0.0
    rows: int = 0
    cut: bool = False

    @property
    def until(self) -> float:
        """Simulated s at which a replay has to end; infinity if the referee ends it."""
        over = self.end is not None and self.end["why"] in _BY_REFEREE
        return math.inf if over and not self.cut else self.last

    def take(self, record: Record) -> None:
        """The next record."""
        match record["kind"]:
            case "session":
                self.session = record
            case "truth":
                self.last, self.rows = record["t_sim"], self.rows + 1
            case "trial_end":
                self.end = self.end or record
            case "input" if "tick" in record:
                text = record["text"]
                text = text if isinstance(text, str) else json.dumps(text)
                self.said.append(Said(record["tick"], record["page"], text))
            case "connect" if "tick" in record:
                about = record["role"], record["name"], record["on"], record.get("seat") or 1
                self.said.append(Said(record["tick"], record["page"], None, *about))


def read_logged(folder: Path) -> Logged:
    """What a run has to be replayed by.

    Raises:
        RunLogError: the log cannot be read, or the run cannot repeat.
    """
    run, found = RunFolder(folder), Logged()
    for record in run.records():
        found.take(record)
    found.cut = bool(run.cut or run.missing)
    if found.session.get("tick") is None:
        cure = "replay a run of people at the console, or of policies"
        raise RunLogError(
            at(folder, "was not in lockstep: programs drove its robots by their own clocks", cure)
        )
    return found


async def replay(
    folder: Path,
    out: Path,
    robots: tuple[Path, ...] = (),
    device: str | None = None,
    unattended: str | None = None,
) -> dict[str, Any]:
    """Play a run again, as fast as it goes.

    Args:
        folder: of the run. out: of the new one. robots: folders with further classes.
        device: the only one that drove, of a run whose log does not say it.
        unattended: what robots did that nobody drove, of such a run; None: as its mission says.

    Returns:
        What the new `score.json` tells.

    Raises:
        UsarsimError: it cannot be played, or its world is not there any more.
    """
    return await _again(folder, out, robots, device, unattended).run()


def _again(
    folder: Path,
    out: Path,
    robots: tuple[Path, ...],
    device: str | None,
    unattended: str | None,
) -> _Again:
    if unattended is not None and unattended not in (known := policies()):
        problem = f"{unattended!r} is not known"
        raise MissionError(at("--unattended", problem, suggest(unattended, known)))
    folder = folder.absolute()
    then = read_logged(folder)
    session = then.session
    told = session["device"]
    if told is None and device is None:
        cure = "say it: --device keyboard, gamepad or any, as its condition in study.toml has it"
        raise RunLogError(at(folder, "does not tell what drove: its study is blind", cure))
    # Its name is that of its file; the rules are those that were used, wherever they came from.
    text = read_text(folder / MISSION, MissionError)
    scenario = parse_scenario(text, folder / f"{session['mission']}.toml")
    staged = stage(replace(scenario, scoring=str(folder / SCORING)), robots=robots)
    console, operators = bool(session["console"]), int(session["operators"])
    team = Team(session["team"], policy=session["policy"], console=console, operators=operators)
    conditions = Conditions(
        out,
        "max",
        operators=operators,
        device=told or device or "any",
        tells_device=told is not None,
        split=session["split"],
        unattended=unattended if told is None else None,
    )
    return _Again(then, staged, team, conditions)


class _Again(Trial):
    """A trial whose pages are those of a log."""

    def __init__(self, then: Logged, *about: Any) -> None:
        super().__init__(*about)
        self._then = then

    async def _let_in(self, stack: contextlib.AsyncExitStack) -> None:
        lockstep = self._station.lockstep
        assert lockstep is not None
        lockstep.loses = False
        lockstep.before.append(Player(self._station, self._then.said))

    def _watch(self, row: TruthRow) -> None:
        """What a program said stands in the log; it ends where the log does."""
        if row.time >= self._then.until - 1e-6:
            end = self._then.end or {"why": "aborted"}
            self.end(end["why"], end.get("text", ""))


def differences(then: Path, now: Path, most: int = 5) -> Iterator[str]:
    """Where two runs differ, in words, the first ones; clocks on the wall do not count.

    Args:
        then, now: their folders. most: how many are told.
    """
    logged = read_logged(then)
    rows = logged.rows if math.isfinite(logged.until) else None
    for one, other in itertools.zip_longest(_plain(then, rows), _plain(now, rows)):
        if most == 0 or (logged.cut and one is None):
            return
        if one != other:
            yield _difference(one, other)
            most -= 1


def _plain(folder: Path, rows: int | None) -> Iterator[Record]:
    """Records without clocks, up to the first one that is missing, or the last row."""
    for due, record in enumerate(RunFolder(folder).records()):
        if record["seq"] != due:
            return
        if record["kind"] in _REPEAT:
            yield {key: value for key, value in record.items() if key not in _CLOCKS}
        if rows is not None and record["kind"] == "truth":
            rows -= 1
            if rows == 0:  # somebody ended it after this one
                return


def _difference(one: Record | None, other: Record | None) -> str:
    some = one or other or {}
    where = f"{some['t_sim']:g} s: {some['kind']}"
    if one is None:
        return f"{where} now, and nothing in the log"
    if other is None:
        return f"{where} in the log, and nothing now"
    if one["kind"] != other["kind"] or one["t_sim"] != other["t_sim"]:
        return f"{where} in the log, {other['kind']} at {other['t_sim']:g} s now"
    keys = [key for key in {**one, **other} if one.get(key) != other.get(key)]
    values = (
        f"{key} {_short(one.get(key))} in the log, {_short(other.get(key))} now" for key in keys
    )
    return f"{where}: {'; '.join(values)}"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
