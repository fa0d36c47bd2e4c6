"""What a measurement hands back: figures with units and aims, in sections of a report, which names
the machine that they were taken on: without that a figure means little. For the terminal and as
JSON.
"""

from __future__ import annotations

import json
import math
import os
import platform
import re
import textwrap
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Literal

import psutil

from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import facts

_PACKAGES = ("mujoco", "numpy", "embreex")
_WIDTH = 100
_VERDICT = {True: "met", False: "MISSED", None: ""}


class BenchError(UsarsimError):
    """A measurement could not be taken; says why."""


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


@dataclass(frozen=True, slots=True)
class Section:
    """The figures of one measurement."""

    key: str  # of the measurement
    title: str  # for people
    setting: str  # under which circumstances they were taken
    figures: tuple[Figure, ...]  # in the order to show them
    failure: str | None = None  # why there are none, or None
    table: tuple[tuple[str, ...], ...] = ()
    """Many cases beside each other: heads of the columns, then the rows."""


@dataclass(frozen=True, slots=True)
class Report:
    """All sections of one run."""

    machine: Mapping[str, str]  # that they were taken on: name and value of what matters
    taken: datetime  # when the run began, UTC
    sections: tuple[Section, ...]  # in the order to show them

    @property
    def facts(self) -> dict[str, str]:
        """Name and value of everything but the figures, for people."""
        return {"Taken": f"{self.taken:%Y-%m-%d %H:%M} UTC", **self.machine}

    @property
    def failed(self) -> list[str]:
        """Keys of the measurements that could not be taken."""
        return [section.key for section in self.sections if section.failure is not None]

    @property
    def missed(self) -> int:
        """Number of aims that were not met."""
        return sum(figure.met is False for section in self.sections for figure in section.figures)


def describe_machine(server_version: str) -> dict[str, str]:
    """What figures depend on: this machine, now, and the versions of all that computes."""
    found, versions = None, {"usarsim-server": server_version}
    with suppress(OSError):
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.M)
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return {
        "Processor": found[1].strip() if found else platform.processor() or "unknown",
        "Cores": f"{len(os.sched_getaffinity(0))} of {os.cpu_count() or 1}",
        "Memory": f"{psutil.virtual_memory().total / 2**30:.1f} GiB",
        "System": f"{platform.system()} {platform.release()} {platform.machine()}",
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        **versions,
        "Load before": f"{os.getloadavg()[0]:.2f}",
    }


def as_text(report: Report) -> str:
    """Plain text with aligned columns; of several sections the aims stand together once more."""
    parts = [facts(report.facts.items())]
    for section in report.sections:
        setting = textwrap.fill(section.setting, _WIDTH)
        if section.table:
            setting += f"\n{_columns(section.table)}"
        if section.figures:
            setting += f"\n{_columns(rows(section))}"
        told = setting if section.failure is None else f"FAILED: {section.failure}"
        parts.append(f"{section.title}\n{told}")
    if len(report.sections) > 1 and (found := aimed(report)):
        parts.append(f"All aims\n{_columns(found)}")
    return "\n\n".join([*parts, summary(report)])


def as_json(report: Report) -> str:
    """One JSON object; numbers that are not finite become null. Ends with a line feed."""
    document = {
        "taken": report.taken.isoformat(timespec="seconds"),
        "machine": report.machine,
        "sections": [
            {**asdict(section), "figures": [_figure(figure) for figure in section.figures]}
            for section in report.sections
        ],
        "missed": report.missed,
    }
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _figure(figure: Figure) -> dict[str, object]:
    value = figure.value if math.isfinite(figure.value) else None
    aim = None if figure.aim is None else str(figure.aim)
    return {"name": figure.name, "value": value, "unit": figure.unit, "aim": aim, "met": figure.met}


def rows(section: Section) -> list[tuple[str, ...]]:
    """Name, value, unit, aim and verdict of every figure, for people."""
    return [
        (f.name, f.text, f.unit, "" if f.aim is None else str(f.aim), _VERDICT[f.met])
        for f in section.figures
    ]


def aimed(report: Report) -> list[tuple[str, str, str, str]]:
    """What has an aim, of all sections: what it is, value with unit, aim, verdict."""
    return [
        (f"{section.key}: {f.name}", f"{f.text} {f.unit}".rstrip(), str(f.aim), _VERDICT[f.met])
        for section in report.sections
        for f in section.figures
        if f.aim is not None
    ]


def summary(report: Report) -> str:
    """How many aims were met."""
    aims = sum(f.aim is not None for section in report.sections for f in section.figures)
    met = f"{aims - report.missed} of {aims} aims met."
    return met if aims else "No aims are set for these figures."


def _columns(lines: Sequence[Sequence[str]]) -> str:
    """Aligned columns, the second one (values) to the right."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    told = []
    for line in lines:
        cells = [cell.ljust(width) for cell, width in zip(line, widths, strict=True)]
        cells[1] = line[1].rjust(widths[1])
        told.append("  " + "  ".join(cells).rstrip())
    return "\n".join(told)
