"""Results of a sweep as a table, and in a line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from usarsim_batch.progress import span
from usarsim_batch.tasks import Played, Row
from usarsim_server.base.csv_files import csv_text

RESULTS = "results.csv"


def results_csv(all_played: Iterable[Played]) -> Iterator[str]:
    """A line for each run: its number, seed, end, exit codes, parameters and plain results."""
    heads = ["run", "seed", "ended", "exits", "error"]
    columns: dict[str, None] = {}
    for one in all_played:
        columns.update(dict.fromkeys(_cells(one.row)))
    yield _line([*heads, *columns])
    for one in all_played:
        row, cells = one.row, _cells(one.row)
        exits = " ".join("-" if code is None else str(code) for code in row.get("exits", ()))
        first = [row["run"], row["seed"], row.get("ended", ""), exits, one.error]
        yield _line([*first, *(cells.get(name, "") for name in columns)])


def _cells(row: Row) -> dict[str, object]:
    """Parameters, and what a controller wrote as `{"name": value}`."""
    result = row.get("result")
    plain = result.items() if isinstance(result, dict) else ()
    found = {k: v for k, v in plain if isinstance(v, str | int | float | None)}
    return {**row["parameters"], **{f"result.{name}": value for name, value in found.items()}}


def _line(cells: Iterable[object]) -> str:
    return csv_text(cells, ())


def summary(all_played: Iterable[Played]) -> str:
    """How many runs there are, how many failed, and what they took."""
    count = lost = other = 0
    wall = processor = 0.0
    for one in all_played:
        count += 1
        lost += bool(one.error)
        other += any(one.row.get("exits", ()))
        wall += one.timing.get("wall_s", 0.0)
        processor += one.timing.get("processor_s", 0.0)
    exits = f", {other} with an exit code other than 0" if other else ""
    return f"{count} runs, {lost} failed{exits}; {span(wall)}, {span(processor)} of processor"
