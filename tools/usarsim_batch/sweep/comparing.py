"""Which runs of two batches differ in their results, and what they were played with."""

from __future__ import annotations

import json
from pathlib import Path

from usarsim_batch.errors import BatchError
from usarsim_batch.folder import RUNS, read_run
from usarsim_batch.tasks import Played, differences
from usarsim_server.base.errors import at
from usarsim_server.base.files import check_links


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
