"""A batch in a few lines: by strategy, how many runs came to what, with mean and deviation."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean, stdev

from usarsim_exploration.batches.playing import Row
from usarsim_server.cli.common import table

SHOWN = ("team_t90", "base_t90", "team_area", "base_share", "distance")
"""Measures that are shown; the report tells all."""


def summary(rows: Sequence[Row]) -> str:
    """One line for each strategy, `mean ± standard deviation (of so many runs)` by measure.

    A time is that of the runs that came so far; a run that did not has none.
    """
    lines = []
    for strategy in dict.fromkeys(row["strategy"] for row in rows):
        ran = [row for row in rows if row["strategy"] == strategy]
        well = [row["measures"] for row in ran if "error" not in row]
        cells = (_cell([one[name] for one in well if one[name] is not None]) for name in SHOWN)
        lines.append((strategy, len(ran), len(ran) - len(well), *cells))
    return table(("STRATEGY", "RUNS", "FAILED", *SHOWN), lines)


def _cell(values: Sequence[float]) -> str:
    if not values:
        return "-"
    spread = stdev(values) if len(values) > 1 else 0.0
    return f"{fmean(values):.4g} ± {spread:.3g} ({len(values)})"
