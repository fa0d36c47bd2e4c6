"""What a measure is: declared once with name, unit, definition and source, above its function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Literal

from usarsim_study.trial import Trial

LEWIS = (
    "M. Lewis, G. Sukthankar, RSARSim: A Toolkit for Evaluating HRI in Robotic Search and "
    "Rescue Tasks"
)
ANALYSIS = "definitions of the log analysis github.com/eminaz/USARsim-Simulation-Analysis"
OLSEN = "D. R. Olsen, M. A. Goodrich, Metrics for evaluating human-robot interactions, PerMIS 2003"
FAN_OUT = (
    "D. R. Olsen, S. B. Wood, Fan-out: measuring human control of multiple robots, CHI 2004, "
    "231-238"
)
CRANDALL = (
    "J. W. Crandall, M. A. Goodrich, D. R. Olsen, C. W. Nielsen, Validating human-robot "
    "interaction schemes in multitasking environments, IEEE Trans. SMC-A 35 (2005) 438-449"
)
SWITCHING = (
    "M. A. Goodrich, M. Quigley, K. Cosenzo, Task switching and multi-robot teams, Multi-Robot "
    "Systems III (2005) 185-195"
)
WANG = "J. Wang, M. Lewis, Human control for cooperating robot teams, HRI 2007, 9-16"
BALAKIRSKY = (
    "S. Balakirsky et al., Towards heterogeneous robot teams for disaster mitigation, Journal of "
    "Field Robotics 24 (2007) 943-967"
)
OURS = "this project"

DECIMALS = 9
"""Of values in s: no clock is finer, and what a difference of clock times has behind them is
rounding."""


@dataclass(frozen=True, slots=True)
class Part:
    """Of whom a value speaks: some operators and some robots.

    Attributes:
        operators: names.
        robots: names.
        whole: all of them: what no operator did belongs to it, too.
    """

    operators: frozenset[str]
    robots: frozenset[str]
    whole: bool = True

    def has(self, who: str) -> bool:
        """Whether what an operator (empty: nobody) did counts."""
        return self.whole or who in self.operators


Function = Callable[[Trial, Part], float | None]
Level = Literal["team", "operator", "robot"]


@dataclass(frozen=True, slots=True)
class Measure:
    """One number of a trial.

    Attributes:
        name: in tables.
        title: in reports.
        unit: of its values; `1` for shares and ratios.
        definition: in a sentence or two.
        source: where the definition comes from.
        function: computes it, of a trial that is complete; None: missing.
        by: levels below the team at which it is computed as well.
        adds: the team's value is the sum over each of those levels.
        better: which direction is good.
    """

    name: str
    title: str
    unit: str
    definition: str
    source: str
    function: Function
    by: tuple[Level, ...] = ()
    adds: bool = False
    better: Literal["more", "less", ""] = ""


DECLARED: dict[str, Measure] = {}
"""All measures by name, as their files are imported."""


def measure(
    name: str,
    title: str,
    unit: str,
    definition: str,
    source: str = OURS,
    *,
    by: tuple[Level, ...] = (),
    adds: bool = False,
    better: Literal["more", "less", ""] = "",
    judged: bool = False,
) -> Callable[[Function], Function]:
    """Declare the function below as a measure; see `Measure`.

    Values in s are rounded to `DECIMALS`.

    judged: it counts what a referee says, and is missing where none has judged.
    """

    def declare(function: Function) -> Function:
        @wraps(function)
        def value(trial: Trial, part: Part) -> float | None:
            found = function(trial, part) if trial.judged or not judged else None
            return round(found, DECIMALS) if found is not None and unit == "s" else found

        if name in DECLARED:
            raise ValueError(f"two measures are called {name}")
        DECLARED[name] = Measure(name, title, unit, definition, source, value, by, adds, better)
        return function

    return declare
