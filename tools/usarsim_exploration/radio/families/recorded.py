"""Links as they were recorded somewhere, whatever the robots of this run do.

A table in a text file, comma-separated, with the header `step,one,other`: each row is a link of
that step, by numbers of robots, 0 the base; `7,,` says that step 7 has none. Links stay until the
next step that is listed, and there are none before the first.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.radio.models import Radio, register
from usarsim_server.base.csv_files import parse_csv
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import read_regular, reason
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import decoded

HEADER = "step,one,other"
_MOST = 10**6
"""Steps, and robots."""

Pairs = frozenset[tuple[int, int]]


def read_links(text: str, path: Path | str) -> tuple[tuple[int, Pairs], ...]:
    """The links of each listed step, in order.

    Args:
        text: of the file. path: of it, for errors.

    Raises:
        UsarsimError: naming the first line that cannot be used.
    """
    cure = "write a step and two robots, as in 7,0,2, or 7,, for no link"
    sheet = parse_csv(text, path, UsarsimError, cure)
    if ",".join(sheet.heads) != HEADER:
        raise UsarsimError(at(path, "has no header", f"begin with {HEADER}", where="line 1"))
    found: dict[int, set[tuple[int, int]]] = {}
    last = 0
    for number, row in sheet.rows:
        parts = [part.strip() for part in row.values()]
        wanted = [part for part in parts if part]
        numbers = [int(part) for part in wanted if re.fullmatch("[0-9]{1,7}", part)]
        whole = len(numbers) == len(wanted) and len(numbers) in (1, 3)
        if not whole or not parts[0] or max(numbers) > _MOST or len(set(numbers[1:])) == 1:
            problem = f"{','.join(parts)!r} is no link"
            raise UsarsimError(at(path, problem, cure, where=f"line {number}"))
        if numbers[0] < last:
            problem = f"step {numbers[0]} comes after step {last}"
            raise UsarsimError(at(path, problem, "sort the rows by step", where=f"line {number}"))
        last = numbers[0]
        pairs = found.setdefault(last, set())
        if len(numbers) == 3:
            pairs.add((min(numbers[1:]), max(numbers[1:])))
    return tuple((step, frozenset(pairs)) for step, pairs in found.items())


@register("recorded")
@dataclass(frozen=True)
class Recorded(Radio):
    """Links of a table; robots expect a circle of their range.

    Attributes:
        table: steps that are listed, in order, and the pairs of each. path: of the file.
    """

    table: tuple[tuple[int, Pairs], ...] = ()
    path: str = "recorded"

    @classmethod
    def read(cls, table: Table) -> Self:
        """The table of the `file`, a path from the scenario's folder."""
        name = table.text("file")
        path = Path(table.path).parent / name
        try:
            text = decoded(read_regular(path), path, UsarsimError)
        except OSError as error:
            problem = f"{name} cannot be read: {reason(error)}"
            raise table.error("file", problem, "correct the path") from error
        return table.read(cls, table=read_links(text, path), path=name)

    def hears(self, distance: float, reach: float, walls: int, cell: float) -> bool:
        """What robots expect: a circle."""
        return distance < reach

    def direct(
        self, step: int, environment: Environment, cells: list[Cell], ranges: list[float]
    ) -> NDArray[np.bool_]:
        """The links of the newest listed step; a robot whose range is 0 is silent all the same."""
        found = np.zeros((len(cells), len(cells)), np.bool_)
        index = bisect_right(self.table, step, key=lambda row: row[0])
        for one, other in self.table[index - 1][1] if index else ():
            if other >= len(cells):
                cure = f"use a team of {other} robots, or another table"
                raise UsarsimError(at(self.path, f"names robot {other}, which is not there", cure))
            if ranges[one] > 0 and ranges[other] > 0:
                found[one, other] = found[other, one] = True
        return found
