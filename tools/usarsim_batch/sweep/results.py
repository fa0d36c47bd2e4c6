"""Results of a sweep: as a table, in a line, and which of two batches differ."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from usarsim_batch.errors import BatchError
from usarsim_batch.folder import RUNS, read_run
from usarsim_batch.progress import span
from usarsim_batch.tasks import Played, Row, differences
from usarsim_server.base.csv_files import csv_text
from usarsim_server.base.errors import at
from usarsim_server.base.files import check_links

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


def compare(one: Path, other: Path) -> int:
    """Tell the runs whose results differ; exit code 1 if any do.

    Raises:
        BatchError: a folder has no runs, or a link in it leads out of it.
    """
    first, second = _names(one), _names(other)
    differ = 0
    provenances = set()
    for name in dict.fromkeys([*first, *second]):
        if name not in first or name not in second:
            print(f"{name}: only in {one if name in first else other}")
            differ += 1
            continue
        a, b = read_run(first[name]), read_run(second[name])
        if a is None or b is None:
            raise BatchError(at(first[name], "cannot be read", "play it again"))
        found = next(differences(_plain(a), _plain(b)), None)
        if found is not None:
            print(f"{name}: {found[0]} is {found[1]!r}, then {found[2]!r}")
            differ += 1
            provenances.add("; ".join(f"{place}: {x!r}, then {y!r}" for place, x, y in
                            differences(a.about, b.about) if place != "log"))  # fmt: skip
    for text in sorted(filter(None, provenances)):
        print(f"played with {text}")
    both = len(first.keys() & second.keys())
    print(f"{one}, {other}: {both} runs in both, {differ} differ")
    return 1 if differ else 0


def _plain(played: Played) -> dict[str, object]:
    return {key: value for key, value in played.row.items() if key != "run"}


def _names(folder: Path) -> dict[str, Path]:
    """Files of runs, by what the run is called: its parameters and seed, or its key."""
    check_links(folder, BatchError)
    found = {}
    for path in sorted((folder / RUNS).glob("*.json")):
        played = read_run(path)
        if played is None:
            continue
        name = path.stem.replace(",", "/")
        if "parameters" in played.row:
            parts = {**played.row["parameters"], "seed": played.row["seed"]}
            name = " ".join(f"{key}={json.dumps(value)}" for key, value in parts.items())
        found[name] = path
    if not found:
        raise BatchError(at(folder, "has no runs", "name the --out of a sweep or batch"))
    return found
