"""What a measure of a run is: declared once with name, unit, definition and source."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.history import Counts, History
from usarsim_exploration.rules import OLDEST

MRESIM = "MRESim, github.com/v-spirin/MRESim"
"""Definitions: exploration reference 13.1."""
YAN = (
    "Z. Yan, L. Fabresse, J. Laval, N. Bouraqadi, Metrics for performance benchmarking of "
    "multi-robot exploration, IROS 2015"
)
JAIN = (
    "R. Jain, D. Chiu, W. Hawe, A quantitative measure of fairness and discrimination, DEC-TR-301, "
    "1984"
)
LITTLE = "J. D. C. Little, A proof for the queuing formula L = λW, Operations Research 9 (1961)"
OURS = "this project"

Function = Callable[[History], float | None]
ROBOTS = slice(1, None)
"""Columns of a history without the base."""


@dataclass(frozen=True, slots=True)
class Measure:
    """One number of a run.

    Attributes:
        name: in files. title: in reports. unit: of its values.
        definition: in a sentence or two. source: where the definition comes from.
        function: computes it; None: there is none, such as the time of a goal not reached.
        better: which direction is good. real: only runs on a server have it. since: number of the
            rules whose results have it first.
    """

    name: str
    title: str
    unit: str
    definition: str
    source: str
    function: Function
    better: Literal["more", "less", ""]
    real: bool = False
    since: int = OLDEST

    def holds(self, history: History) -> bool:
        """Whether results of such a run have it."""
        return history.by_rules >= self.since and bool(history.reality or not self.real)


DECLARED: dict[str, Measure] = {}
"""All measures by name, in the order of their declaration."""


def declare(
    name: str,
    title: str,
    unit: str,
    definition: str,
    source: str = OURS,
    better: Literal["more", "less", ""] = "",
    *,
    real: bool = False,
    since: int = OLDEST,
) -> Callable[[Function], Function]:
    """Declare the function below as a measure; see `Measure`."""

    def add(function: Function) -> Function:
        if name in DECLARED:
            raise ValueError(f"two measures are called {name}")
        DECLARED[name] = Measure(
            name, title, unit, definition, source, function, better, real, since
        )
        return function

    return add


def time_to(cells: Counts, goal: NDArray[np.floating[Any]]) -> int | None:
    """The first step at which so many cells are known, by step; None: never."""
    reached = np.flatnonzero(cells >= goal)
    return int(reached[0]) if len(reached) else None


def lasting(holds: NDArray[np.bool_]) -> Counts:
    """For how many rows, this one included, something has held; the same shape, 0 where not."""
    rows = np.arange(len(holds))[:, None]
    since = np.maximum.accumulate(np.where(holds, -1, rows), axis=0)
    return np.where(holds, rows - since, 0)


def jain(shares: NDArray[Any]) -> float | None:
    """(sum x)^2 / (n sum x^2): 1 if all are equal, 1 / n if one has all; None: nobody has any."""
    squares = float(np.square(shares, dtype=float).sum())
    return float(shares.sum()) ** 2 / (len(shares) * squares) if squares else None
