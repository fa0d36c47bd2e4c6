"""What a measurement hands back: figures with units and aims, in sections of a report, which names
the machine that they were taken on: without that a figure means little.
"""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Literal

import numpy as np
import psutil

_PACKAGES = ("mujoco", "numpy", "embreex")


@dataclass(frozen=True, slots=True)
class Machine:
    """A computer and the software that matters."""

    processor: str  # model name
    cores: int  # that the machine has
    usable_cores: int  # that this process may use
    memory: int  # bytes
    system: str  # kernel and architecture
    python: str  # implementation and version
    packages: dict[str, str]  # versions by distribution name; "none" for what is not installed
    load: float  # programs ready to run, mean of the last minute, before measuring began

    def facts(self) -> list[tuple[str, str]]:
        """Name and value of everything, for people."""
        return [
            ("Processor", self.processor),
            ("Cores", f"{self.usable_cores} of {self.cores}"),
            ("Memory", f"{self.memory / 2**30:.1f} GiB"),
            ("System", self.system),
            ("Python", self.python),
            *((name, version) for name, version in self.packages.items()),
            ("Load before", f"{self.load:.2f}"),
        ]


def describe_machine(server_version: str) -> Machine:
    """This machine, now, and the version of the server that is measured."""
    return Machine(
        processor=_processor(),
        cores=os.cpu_count() or 1,
        usable_cores=len(os.sched_getaffinity(0)),
        memory=psutil.virtual_memory().total,
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        python=f"{platform.python_implementation()} {platform.python_version()}",
        packages={"usarsim-server": server_version} | {name: _version(name) for name in _PACKAGES},
        load=os.getloadavg()[0],
    )


def _processor() -> str:
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.M)
    except OSError:
        found = None
    return found[1].strip() if found else platform.processor() or "unknown"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "none"


@dataclass(frozen=True, slots=True)
class Aim:
    """What a figure should be: at least, at most or below a limit."""

    relation: Literal[">=", "<=", "<"]
    limit: float

    def met_by(self, value: float) -> bool:
        """Whether a value is as it should be; not a number never is."""
        if self.relation == ">=":
            return value >= self.limit
        return value <= self.limit if self.relation == "<=" else value < self.limit

    def __str__(self) -> str:
        return f"{self.relation} {self.limit:g}"


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number."""

    name: str  # what it is
    value: float  # as measured
    unit: str = ""  # of the value; empty for ratios and counts
    digits: int = 2  # after the point, for people
    aim: Aim | None = None  # what it should be, or None if it only informs

    @property
    def met(self) -> bool | None:
        """Whether the aim is met; None without an aim."""
        return None if self.aim is None else self.aim.met_by(self.value)

    @property
    def text(self) -> str:
        """The value as people read it."""
        return f"{self.value:,.{self.digits}f}"


def in_ms(name: str, seconds: float, digits: int = 2, aim: Aim | None = None) -> Figure:
    """A time, told in ms."""
    return Figure(name, 1e3 * seconds, "ms", digits, aim)


def p99(values: Sequence[float]) -> float:
    """The 99th percentile of values."""
    return float(np.percentile(values, 99.0))


@dataclass(frozen=True, slots=True)
class Table:
    """Many cases beside each other."""

    heads: tuple[str, ...]  # of the columns; the first names the case
    rows: tuple[tuple[str, ...], ...]  # a text for each column


@dataclass(frozen=True, slots=True)
class Section:
    """The figures of one measurement."""

    key: str  # of the measurement
    title: str  # for people
    setting: str  # under which circumstances they were taken
    figures: tuple[Figure, ...]  # in the order to show them
    failure: str | None = None  # why there are none, or None
    table: Table | None = None  # of the cases that the figures sum up, or None


@dataclass(frozen=True, slots=True)
class Report:
    """All sections of one run."""

    machine: Machine  # that they were taken on
    taken: datetime  # when the run began, UTC
    sections: tuple[Section, ...]  # in the order to show them

    @property
    def facts(self) -> list[tuple[str, str]]:
        """Name and value of everything but the figures, for people."""
        return [("Taken", f"{self.taken:%Y-%m-%d %H:%M} UTC"), *self.machine.facts()]

    @property
    def failed(self) -> list[str]:
        """Keys of the measurements that could not be taken."""
        return [section.key for section in self.sections if section.failure is not None]

    @property
    def missed(self) -> int:
        """Number of aims that were not met."""
        return sum(figure.met is False for section in self.sections for figure in section.figures)


@dataclass(frozen=True, slots=True)
class Plan:
    """What to measure with."""

    robots: int | None = None  # size of the team; None for the measurement's own
    seconds: float | None = None
    """How long to measure; None for the measurement's own. What it means in each case is said by
    the measurement."""
    world: str = "arena"  # name or folder of the world
    seed: int = 0  # of the clients' behaviour
    say: Callable[[str], None] = lambda _: None  # told what goes on while it takes its time
    brief: bool = False
    """Only to see whether something is badly wrong: of several sizes one is enough."""
    only: tuple[str, ...] = ()  # names of the cases that a measurement is to take; none for all

    def sizes(self, usual: Sequence[int], brief: int) -> tuple[int, ...]:
        """Sizes of the teams to measure: the one asked for, else the measurement's usual ones, or
        the one of them that is enough if it is to be brief."""
        if self.robots is not None:
            return (self.robots,)
        return (brief,) if self.brief else tuple(usual)
