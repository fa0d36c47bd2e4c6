"""Results of acceptance tests, and the three forms in which they are shown."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Band:
    """A closed interval that a measurement must lie in."""

    low: float = -math.inf
    high: float = math.inf

    def holds(self, value: float) -> bool:
        """Whether a value lies inside; NaN lies nowhere, except where anything goes."""
        return self == ANY or self.low <= value <= self.high

    def __str__(self) -> str:
        if self == ANY:
            return "-"
        if math.isinf(self.high):
            return f">= {self.low:g}"
        if math.isinf(self.low):
            return f"<= {self.high:g}"
        if self.low == self.high:
            return f"{self.low:g}"
        return f"{self.low:.4g} .. {self.high:.4g}"


ANY = Band()
"""Measured for information; never fails."""


@dataclass(frozen=True, slots=True)
class Result:
    """One measurement."""

    test: str  # V4 of robots 3.3, or #59 for robots 59
    robot: str  # class name, or what was tested instead
    quantity: str  # what was measured, with the conditions
    timestep: float | None  # s; None if the measurement is over several time steps
    measured: float  # the value; NaN if the test could not be carried through
    unit: str  # of measured, target and band; empty for plain numbers
    target: str  # where the value should be, in words
    band: Band  # where it has to be

    @property
    def passed(self) -> bool:
        """Whether the measurement lies in its band."""
        return self.band.holds(self.measured)

    @property
    def verdict(self) -> str:
        """`pass`, `FAIL`, or `info` where there is no band."""
        if self.band == ANY:
            return "info"
        return "pass" if self.passed else "FAIL"

    @property
    def value(self) -> str:
        """The measured value with its unit."""
        return f"{_number(self.measured)} {self.unit}".rstrip()


def _number(value: float) -> str:
    """Four significant digits, never in powers of ten, never below a millionth."""
    if not math.isfinite(value):
        return "none"
    if value == 0.0 or abs(value) < 1e-6:
        return "0"
    digits = min(6, max(0, 3 - math.floor(math.log10(abs(value)))))
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _step(timestep: float | None) -> str:
    return "all" if timestep is None else f"{timestep * 1e3:g} ms"


HEADS = ("test", "robot", "quantity", "step", "measured", "target", "band", "verdict")


def as_table(results: Iterable[Result], *, heads: bool = True) -> str:
    """Fixed columns, so that lines can be printed one by one while the tests run."""
    rows = [HEADS] if heads else []
    rows += [
        (
            *(one.test, one.robot, one.quantity, _step(one.timestep), one.value, one.target),
            *(str(one.band), one.verdict),
        )
        for one in results
    ]
    widths = (4, 23, 42, 5, 13, 20, 16, 0)
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def as_json(results: Sequence[Result]) -> str:
    """A list of objects; values that are not finite become null."""
    return json.dumps([_plain(one) for one in results], indent=1)


def _plain(one: Result) -> dict[str, object]:
    found = asdict(one) | {"measured": _finite(one.measured)}
    del found["band"]
    ends = {"low": _finite(one.band.low), "high": _finite(one.band.high)}
    return {**found, **ends, "verdict": one.verdict}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def as_markdown(results: Sequence[Result]) -> str:
    """One row per quantity; robots stand side by side, each with its range over the time steps."""
    rows: dict[tuple[str, str, str, str, str], list[Result]] = {}
    for one in results:
        key = (one.test, one.quantity, one.unit, one.target, str(one.band))
        rows.setdefault(key, []).append(one)
    heads = ["Test", "Quantity", "Measured", "Target", "Band", "Verdict"]
    lines = [_row(heads), _row(["---"] * len(heads))]
    for (test, quantity, unit, target, band), found in rows.items():
        named = f"{quantity}, {unit}" if unit else quantity
        verdict = next((one.verdict for one in found if not one.passed), found[0].verdict)
        lines.append(_row([test, named, _ranges(found), target, band, verdict]))
    return "\n".join(lines) + "\n"


def _ranges(results: Sequence[Result]) -> str:
    """What every robot did, from the smallest to the largest value."""
    robots: dict[str, list[float]] = {}
    for one in results:
        robots.setdefault(one.robot, []).append(one.measured)
    parts = []
    for robot, values in robots.items():
        ends = dict.fromkeys((_number(min(values)), _number(max(values))))
        parts.append(f"{robot} {' to '.join(ends)}")
    return "; ".join(parts)


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
