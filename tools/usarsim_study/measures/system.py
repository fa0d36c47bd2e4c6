"""Area, map and delays: what the team brought home, and how fast the system was."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from usarsim_study.measures.base import BALAKIRSKY, OURS, Part, measure
from usarsim_study.trial import Trial


def _result(trial: Trial, *path: str) -> float | None:
    """A number of `score.json`, by the keys that lead to it."""
    found: Any = trial.score
    for key in path:
        found = found.get(key) if isinstance(found, dict) else None
    return float(found) if isinstance(found, int | float) and math.isfinite(found) else None


_LATENCY = (
    "Wall time from an input event by the page's clock, set to the gateway's, to the command on "
    "the wire"
)
_AGE = "Age of a picture when a page shows it, of all pictures that pages told about"


@measure(
    "coverage",
    "Coverage",
    "1",
    "Reachable floor inside any sensor's polygon over all reachable floor.",
    BALAKIRSKY,
    better="more",
)
def coverage(trial: Trial, part: Part) -> float | None:
    """As the referee has it."""
    return _result(trial, "area", "team")


@measure(
    "coverage_base",
    "Coverage known at the base",
    "1",
    "Reachable floor inside any sensor's polygon that reached the base by radio, over all "
    "reachable floor.",
    BALAKIRSKY,
    better="more",
)
def coverage_base(trial: Trial, part: Part) -> float | None:
    """As the referee has it."""
    return _result(trial, "area", "base")


@measure(
    "map_error",
    "Map error",
    "m",
    "After the best rigid alignment, mean distance of mapped wall cells to true walls.",
    BALAKIRSKY,
    better="less",
)
def map_error(trial: Trial, part: Part) -> float | None:
    """As the referee has it; missing without a map."""
    return _result(trial, "map", "error")


@measure(
    "walls_mapped",
    "Walls mapped",
    "1",
    "After the best rigid alignment, share of the true walls that are in the map.",
    BALAKIRSKY,
    better="more",
)
def walls_mapped(trial: Trial, part: Part) -> float | None:
    """As the referee has it; missing without a map."""
    return None if map_error(trial, part) is None else _result(trial, "map", "share")


def percentile(values: Sequence[float], share: float) -> float | None:
    """The smallest value that at least this share of the values does not exceed; None: no values.

    The definition by the inverse of the empirical distribution function.
    """
    ordered = sorted(values)
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)] if ordered else None


def _latencies(trial: Trial, part: Part) -> list[float]:
    """s from the page's event to the command on the wire.

    In lockstep an input waits for its tick; so the command's time is set to the gateway's clock by
    that which the session tells, or else the wait is not counted.
    """
    ahead = math.nan
    offsets: dict[Any, float] = {}
    waiting: dict[Any, tuple[float, float]] = {}
    found = []
    for record in trial.records:
        kind = record["kind"]
        if kind == "session" and record.get("gateway_clock") is not None:
            ahead = float(record["gateway_clock"]) - float(record["t_wall"])
        elif kind == "page_clock":
            offsets[record.get("page")] = float(record["offset"])
        elif kind == "input":
            text = record.get("text")
            robot = text.get("robot") if isinstance(text, dict) else None
            page = record.get("page")
            sent, received = record.get("clock"), record.get("gateway_clock")
            if sent is None or received is None or page not in offsets:
                continue
            if robot and part.has(trial.operator(page)):
                way = float(received) - (float(sent) + offsets[page])
                came = float(record["t_wall"]) if math.isnan(ahead) else float(received) - ahead
                waiting[robot] = way, came
        elif kind == "command" and record.get("source") == "operator":
            way, taken = waiting.pop(record["robot"], (math.nan, math.nan))
            if not math.isnan(way) and trial.begin <= record["t_sim"] <= trial.end:
                found.append(way + float(record["t_wall"]) - taken)
    return found


@measure(
    "command_latency",
    "Command latency, median",
    "s",
    f"{_LATENCY}: median.",
    OURS,
    by=("operator",),
    better="less",
)
def command_latency(trial: Trial, part: Part) -> float | None:
    """Median."""
    return percentile(_latencies(trial, part), 0.5)


@measure(
    "command_latency_p95",
    "Command latency, 95th percentile",
    "s",
    f"{_LATENCY}: 95th percentile.",
    OURS,
    by=("operator",),
    better="less",
)
def command_latency_p95(trial: Trial, part: Part) -> float | None:
    """95th percentile."""
    return percentile(_latencies(trial, part), 0.95)


def _ages(trial: Trial, part: Part) -> list[float]:
    return [
        float(one["age"])
        for one in trial.of("frame_age")
        if part.has(trial.operator(one.get("page"))) and one.get("robot") in part.robots
    ]


@measure(
    "frame_age",
    "Frame age, median",
    "s",
    f"{_AGE}: median.",
    OURS,
    by=("operator", "robot"),
    better="less",
)
def frame_age(trial: Trial, part: Part) -> float | None:
    """Median."""
    return percentile(_ages(trial, part), 0.5)


@measure(
    "frame_age_p95",
    "Frame age, 95th percentile",
    "s",
    f"{_AGE}: 95th percentile.",
    OURS,
    by=("operator", "robot"),
    better="less",
)
def frame_age_p95(trial: Trial, part: Part) -> float | None:
    """95th percentile."""
    return percentile(_ages(trial, part), 0.95)
