"""Teams: who drives in a match, as a TOML file tells it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from usarsim_mission.errors import MissionError
from usarsim_mission.match.synthetic import Skill
from usarsim_mission.scenario.policies import PRESENT_POLICIES, read_policy
from usarsim_mission.scenario.staging import Robot
from usarsim_server.base.errors import at
from usarsim_server.base.fields import field
from usarsim_server.base.files import is_folder
from usarsim_server.base.lined import open_toml
from usarsim_server.base.tables import Table, shown

PLACES = ("host", "port", "image_port", "wireless_port", "truth_port", "robots", "run")
"""What stands in braces in a command: `{port}`, for example."""


def _command(table: Table, key: str) -> tuple[str, ...]:
    words = table.texts(key)
    for word in words:
        try:
            word.format(**dict.fromkeys(PLACES, ""))
        except (KeyError, IndexError, ValueError):
            cure = "braces hold one of " + ", ".join(PLACES) + "; write {{ and }} for braces"
            raise table.error(key, f"{word!r} cannot be filled in", cure) from None
    return words


def _folder(table: Table, key: str) -> str:
    text = table.text(key)
    if not is_folder(Path(table.path).parent / text):
        raise table.error(key, f"{text!r} is no folder", "write a path from this file's folder")
    return text


def _environment(table: Table, key: str) -> Mapping[str, object]:
    found = table.free(key)
    for name, value in found.items():
        if not name or "=" in name or "\0" in name:
            raise table.error(key, f"{name!r} is no name of a variable", "write NAME = value")
        if not isinstance(value, str | int | float) or "\0" in str(value):
            cure = "write a text or a number"
            raise table.error(key, f"{name}: {shown(value)} is no value of a variable", cure)
    return found


def _skill(table: Table, key: str) -> Skill:
    return table.one(key, Skill)


@dataclass(frozen=True, slots=True)
class Team:
    """Who drives the robots of a mission; exactly one of `command`, `policy`, `wait`, `console`.

    Attributes:
        path: the file; empty for a team that no file tells.
    """

    name: str = field(help="of the team, for reports and tables")
    command: tuple[str, ...] = field(
        default=(),
        parse=_command,
        expects="a list of words",
        help="program that is started and brings its robots itself, with its arguments; "
        "`{port}` and the like are filled in",
    )
    folder: str = field(
        default=".",
        parse=_folder,
        expects="a folder",
        help="in which it is started, from the file's own",
    )
    environment: Mapping[str, object] = field(
        factory=dict,
        parse=_environment,
        expects="a table",
        help="further variables for it",
    )
    policy: str = field(
        default="",
        parse=read_policy,
        expects=f"one of {', '.join(PRESENT_POLICIES)}, or a policy of a package",
        help="what robots do by themselves: search, explore, or one of a package",
    )
    wait: bool = field(default=False, help="controllers are started by hand and waited for")
    console: bool = field(default=False, help="people drive by the pages of the console")
    operators: int = field(default=1, low=1, high=100, help="how many people drive")
    synthetic: Skill | None = field(
        default=None,
        parse=_skill,
        expects="a table",
        help="beside `policy`: a program watches the robots as an operator and marks victims",
    )
    hand_in: str = field(
        default="",
        help="folder, from the file's own, in which its programs leave victims and map; `{run}` is "
        "that of the run",
    )
    hand_in_frame: Literal["usarsim", "world"] = field(
        default="usarsim", help="of what they leave: y to the right as robots tell it, or left"
    )
    path: Path = Path()

    def hand_in_folder(self, run: Path) -> Path | None:
        """Where the programs leave victims and map; None if they do not.

        Args:
            run: folder of the run.
        """
        if not self.hand_in:
            return None
        return self.path.parent / self.folder / self.hand_in.replace("{run}", str(run.absolute()))

    def check(self, robots: Iterable[Robot]) -> None:
        """Refuse a mission whose robots cannot do what this team has them do.

        Args:
            robots: of the mission.

        Raises:
            MissionError: a robot is to patrol and has no route.
        """
        if self.policy != "patrol":
            return
        movable = [one for one in robots if one.description.kind != "static"]
        if lost := [one.entry.name for one in movable if not one.entry.route]:
            problem = f"{lost[0]} is to patrol and has no route in the mission"
            cure = "add route = [[x, y], ...] there, or choose another policy"
            raise MissionError(at(self.path, problem, cure, where="policy"))

    @property
    def brings_robots(self) -> bool:
        """Whether its own programs bring the robots into the world."""
        return bool(self.command) or self.wait


DEMO = Team(name="Explorers", policy="search", synthetic=Skill())
"""Robots that search by themselves, watched by a program: what `--demo` runs."""


def read_team(path: Path) -> Team:
    """What a team file tells.

    Raises:
        MissionError: it cannot be read, or something in it cannot be.
    """
    table = open_toml(path, MissionError)
    team = table.read(Team, path=path)
    table.finish()
    kinds = [bool(team.command), bool(team.policy), team.wait, team.console]
    if sum(kinds) != 1:
        cure = "give exactly one of command, policy, wait and console"
        raise MissionError(at(path, f"{sum(kinds)} ways to drive", cure))
    if team.hand_in and not team.brings_robots:
        raise MissionError(at(path, "hand_in stands without command or wait", "leave it out"))
    if team.synthetic is not None and not team.policy:
        raise MissionError(at(path, "synthetic stands without policy", 'add policy = "explore"'))
    return team
