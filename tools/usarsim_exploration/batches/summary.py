"""A batch in a few lines: by strategy, how many runs came to what, with mean and deviation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import fmean, stdev

from usarsim_batch.tasks import Row
from usarsim_server.cli.common import table

SHOWN = ("team_t90", "base_t90", "team_area", "base_share", "distance")
"""Measures that are shown; the report tells all."""


def summary(rows: Iterable[Row]) -> str:
    """One line for each strategy, `mean ± standard deviation (of so many runs)` by measure.

    A time is that of the runs that came so far; a run that did not has none.
    """
    found: dict[str, list[list[float | None] | None]] = {}
    for row in rows:
        measures = None if "error" in row else [row["measures"][name] for name in SHOWN]
        found.setdefault(row["strategy"], []).append(measures)
    lines = []
    for strategy, ran in found.items():
        well = [one for one in ran if one is not None]
        columns = zip(*well, strict=True) if well else [()] * len(SHOWN)
        cells = (_cell([one for one in column if one is not None]) for column in columns)
        lines.append((strategy, len(ran), len(ran) - len(well), *cells))
    return table(("STRATEGY", "RUNS", "FAILED", *SHOWN), lines)


def alike(rows: Iterable[Row]) -> list[str]:
    """What to say of groups of runs, equal but for the seed, that all came to the same logs.

    Nothing in such runs was drawn by the seed, so they are one sample, not many.
    """
    found: dict[str, list[str]] = {}
    for row in rows:
        if "error" not in row:
            parts = (row["environment"], row.get("team", row["robots"]), row["strategy"])
            key = "/".join(map(str, (*parts, row["radio"])))
            found.setdefault(key, []).append(row["digest"])
    return [
        f"{key}: {len(ones)} seeds gave the same run, so they are one sample "
        '(let the seed draw starts, with [team] base = "drawn" and no start of a robot)'
        for key, ones in found.items()
        if len(ones) > 1 and len(set(ones)) == 1
    ]


def _cell(values: Sequence[float]) -> str:
    if not values:
        return "-"
    spread = stdev(values) if len(values) > 1 else 0.0
    return f"{fmean(values):.4g} ± {spread:.3g} ({len(values)})"
