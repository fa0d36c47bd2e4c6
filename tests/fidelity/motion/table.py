"""The table of acceptance trials, `trials.toml`: what the robots do, and where that has to lie."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motion.drives import BANDS, DRIVES, Drive
from motion.results import Band, Result
from motion.workshop import Workshop

SCALES = {"mm": 1e3, "mm/s": 1e3, "cm": 1e2, "%": 1e2}
SCALES |= dict.fromkeys(("deg", "deg/s"), math.degrees(1.0))
"""What numbers of the drives, in m and rad, are multiplied by; other units are those of the drives.
"""


def _spread(values: Sequence[float]) -> float:
    return max(values) - min(values)


OVER: Mapping[str, Callable[[Sequence[float]], float]] = {
    "max": max,
    "sum": sum,
    "spread": _spread,
    "relative": lambda values: _spread(values) / min(values),
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number of a trial; see `trials.toml`."""

    test: str
    what: str
    read: str | int | None = None
    over: str | None = None
    unit: str = ""
    target: str = ""
    low: float = -math.inf
    high: float = math.inf
    band: str | None = None

    def result(self, shop: Workshop, robot: str, timestep: float | None, found: Any) -> Result:
        """What the table makes of what a drive returned."""
        if self.over is None:
            value = self._of(found)
        else:
            value = OVER[self.over]([self._of(one) for one in found])
        target, band = self.target, Band(self.low, self.high)
        if self.band is not None:
            target, band = BANDS[self.band](shop, robot)
        scaled = value * SCALES.get(self.unit, 1.0)
        return Result(self.test, robot, self.what, timestep, scaled, self.unit, target, band)

    def _of(self, found: Any) -> float:
        if self.read is None:
            return float(found)
        return float(found[self.read] if isinstance(self.read, int) else getattr(found, self.read))


@dataclass(frozen=True, slots=True)
class Trial:
    """A drive of some robots, and what is measured in it; see `trials.toml`."""

    checks: str
    robots: tuple[str, ...]
    drive: Drive
    given: Mapping[str, Any]
    across: bool
    quantities: tuple[Quantity, ...]

    @property
    def tests(self) -> tuple[str, ...]:
        """Numbers of its quantities."""
        return tuple(dict.fromkeys(one.test for one in self.quantities))

    def run(self, shop: Workshop, robot: str, timesteps: Sequence[float]) -> Iterator[Result]:
        """Let one of the robots drive at every time step (s).

        Raises:
            StageError: if the robot does not come, or is lost.
        """
        if self.across:
            compared = timesteps if len(timesteps) > 1 else (0.002, *timesteps)
            runs = [self.drive(shop, robot, timestep, **self.given) for timestep in compared]
            yield from (one.result(shop, robot, None, runs) for one in self.quantities)
            return
        for timestep in timesteps:
            found = self.drive(shop, robot, timestep, **self.given)
            yield from (one.result(shop, robot, timestep, found) for one in self.quantities)


def load_trials(path: Path = Path(__file__).with_name("trials.toml")) -> tuple[Trial, ...]:  # noqa: B008
    """Read the table."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    groups: Mapping[str, list[str]] = table["groups"]
    return tuple(
        Trial(
            checks=row["checks"],
            robots=tuple(one for name in row["robots"] for one in groups.get(name, [name])),
            drive=DRIVES[row["drive"]],
            given=row.get("with", {}),
            across=row.get("across", False),
            quantities=tuple(Quantity(**one) for one in row["measure"]),
        )
        for row in table["trial"]
    )


TRIALS = load_trials()
"""All acceptance trials of the robots that there are, in the order of the report."""
