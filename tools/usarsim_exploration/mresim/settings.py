"""MRESim's settings: plain values, one a line, in a fixed order (exploration reference 3.4)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.scenario import Content
from usarsim_exploration.strategy import TYPES
from usarsim_server.base.errors import at
from usarsim_server.base.fields import keys
from usarsim_server.base.tables import suggest
from usarsim_server.base.toml import read_text

LENGTHS = (18, 28)
"""Lines of the two forms; both are read alike, what is missing at the end has its default."""

Experiment = Literal[
    "RunFromLog", "LeaderFollower", "FrontierExploration", "RoleBasedExploration", "Testing",
    "BatchRun",
]  # fmt: skip
Policy = Literal["RangeConstrained", "PeriodicReturn", "ReturnWhenComplete", "UtilReturn"]
Communication = Literal["StaticCircle", "DirectLine", "PropModel1"]

RADIOS: dict[str, Content] = {
    "StaticCircle": {"model": "circle", "sum_of_ranges": True},
    "DirectLine": {"model": "sight", "sum_of_ranges": True},
    "PropModel1": {"model": "path-loss", "preset": "mresim"},
}
_POLICIES = {
    "RangeConstrained": "range-constrained",
    "PeriodicReturn": "periodic",
    "ReturnWhenComplete": "frontier",
    "UtilReturn": "ratio",
}

_INSTEAD = {
    "improved": "meeting points are always the improved ones",
    "strict_role_switch": "robots switch by the longer way alone",
    "explorer_replans": "the explorer keeps to the meeting point that was agreed upon",
    "relay_to_explorer": "the relay keeps to its own meeting point",
    "single_meeting_time": "the time is that of two points",
    "to_range": "robots drive towards the base until they hear it",
}
"""What ours does instead of options that it has not."""


@dataclass(frozen=True)
class Settings:
    """The lines of the file, in order; texts of paths are as they stand there."""

    strategy: str = "RoleBasedExploration"
    policy: str = "ReturnWhenComplete"
    replay_log: str = ""
    radio: str = "PropModel1"
    agent_log: bool = False
    agent_log_file: str = ""
    data_log: bool = False
    data_log_file: str = ""
    screenshots: bool = False
    screenshot_folder: str = ""
    improved_rendezvous: bool = False
    replanning: bool = False
    role_switch: bool = False
    strict_role_switch: bool = False
    rate: int = 5
    rendezvous_range: bool = False
    multi_point: bool = False
    target: float = 0.9
    timestamps: bool = False
    assume_at_frontier: bool = False
    keep_assigning: bool = False
    batch_file: str = ""
    to_range: bool = False
    density: float = 400.0
    relay_explores: bool = False
    explorer_replans: bool = False
    relay_to_explorer: bool = False
    single_meeting_time: bool = False

    @property
    def content(self) -> Content:
        """The tables `strategy` and `radio` of a scenario, and rules of MRESim's cycle.

        Of the options of a strategy those are taken over that our strategy of that name has.

        Raises:
            ExplorationError: no strategy of ours answers to it.
        """
        return {
            "links": "before",
            "mresim": True,
            "radio": RADIOS[self.radio],
            "strategy": {"name": self.ours, **self._options(self.ours)},
            "end": {"of": "all", "home": True},
        }

    @property
    def dropped(self) -> list[str]:
        """Options that these settings choose and that our strategy has not, and what it does."""
        if self.strategy == "RoleBasedExploration":
            kind = "multi-point" if self.multi_point else "single-point"
            chosen = {
                "improved": not self.improved_rendezvous,
                "strict_role_switch": self.role_switch and self.strict_role_switch,
            }
            if self.multi_point:
                chosen |= {
                    "explorer_replans": self.explorer_replans,
                    "relay_to_explorer": self.relay_to_explorer,
                    "single_meeting_time": self.single_meeting_time,
                }
        else:
            kind, chosen = self.ours, {"to_range": self.to_range and self.ours == "ratio"}
        return [f"{one}: {kind}: {_INSTEAD[one]}" for one, held in chosen.items() if held]

    @property
    def ours(self) -> str:
        """Name of our strategy."""
        if self.strategy == "RoleBasedExploration":
            return "role-based-multi-point" if self.multi_point else "role-based-single-point"
        return "leader-follower" if self.strategy == "LeaderFollower" else _POLICIES[self.policy]

    def _options(self, name: str) -> Content:
        if name not in TYPES.names():
            problem = f"strategy {name!r} of these settings is not installed"
            raise ExplorationError(f"{problem} ({suggest(name, TYPES.names())})")
        options = {
            "target": self.target,
            "keep_assigning": self.keep_assigning,
            "density": self.density,
            "switch": self.role_switch,
            "relay_explores": self.relay_explores,
        }
        declared = {key.key for key in keys(TYPES.find(name, "strategy"))}
        return {key: value for key, value in options.items() if key in declared}


def read_settings(path: Path) -> Settings:
    """Settings of a file.

    Raises:
        ExplorationError: naming the line, what is wrong, and the cure.
    """
    lines = read_text(path, ExplorationError).splitlines()
    values = {}
    if len(lines) < len(fields(Settings)) and len(lines) < min(LENGTHS) - 1:
        problem = f"{len(lines)} lines are no settings"
        raise ExplorationError(at(path, problem, f"the two forms have {LENGTHS[0]} and 28 lines"))
    for number, (one, text) in enumerate(zip(fields(Settings), lines, strict=False), 1):
        text = text.strip()
        try:
            values[one.name] = _value(one.name, type(one.default), text)
        except ValueError as error:
            where = f"line {number}, {one.name.replace('_', ' ')}"
            raise ExplorationError(
                at(path, f"{text!r} {error}", _cure(one.name), where=where)
            ) from None
    return Settings(**values)  # type: ignore[arg-type]


_CHOICES = {
    "strategy": (*Experiment.__args__,),  # type: ignore[attr-defined]
    "policy": (*Policy.__args__,),  # type: ignore[attr-defined]
    "radio": (*Communication.__args__,),  # type: ignore[attr-defined]
}


def _cure(name: str) -> str:
    choices = _CHOICES.get(name)
    return f"write one of {', '.join(choices)}" if choices else "write what MRESim writes"


def _value(name: str, kind: type, text: str) -> object:
    """One line; `null` and nothing are the default of Java."""
    if name in _CHOICES and text not in _CHOICES[name]:
        raise ValueError("is not known")
    if kind is bool:
        if text.lower() not in ("true", "false", "null", ""):
            raise ValueError("is neither true nor false")
        return text.lower() == "true"
    if kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            raise ValueError("is no number") from None
    return "" if text == "null" else text
