"""What the folder of a batch of explorations holds: results, and a table of times."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from usarsim_batch.folder import read_json
from usarsim_batch.tasks import Row
from usarsim_exploration.batches.batch_file import Job
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.timing import PHASES
from usarsim_server.base.csv_files import CsvWriter
from usarsim_server.base.errors import at

FORMAT = "usarsim-explore-batch/1"
TIMING = "timing.csv"
_CURE = "name a result.json of `usarsim explore bench`"


def read_result(path: Path) -> dict[str, Any]:
    """The content of a `result.json`; its runs have a key each, and are otherwise not checked.

    Raises:
        ExplorationError: it cannot be read, or is something else.
    """
    content = read_json(path, _CURE)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ExplorationError(at(path, f"its format is not {FORMAT}", _CURE))
    rows, batch = content.get("runs"), content.get("batch")
    if not isinstance(batch, dict) or not isinstance(rows, list):
        raise ExplorationError(at(path, "has no batch or no list of runs", _CURE))
    for number, row in enumerate(rows, 1):
        if not isinstance(row, dict) or key_of(row) is None:
            raise ExplorationError(at(path, f"run {number} does not say which it is", _CURE))
    return content


def key_of(row: Row) -> str | None:
    """`Job.key` of the run of a row."""
    found = [row.get(key) for key in ("environment", "strategy", "radio", "seed")]
    team = row.get("team", row.get("robots"))
    if None in found or team is None:
        return None
    return "/".join(map(str, (found[0], team, *found[1:])))


def timing_csv(rows: Iterable[tuple[Job, Mapping[str, float]]]) -> str:
    """Processor time of runs: ms by step, and how the seconds are split."""
    file = io.StringIO()
    writer = CsvWriter(file)
    heads = [f"{phase.replace(' ', '_')}_s" for phase in PHASES]
    writer.row(["run", "steps", "processor_s", "ms_per_step", *heads])
    for job, timing in rows:
        if not timing:
            continue
        spent = [timing[phase] for phase in PHASES]
        per_step = 1e3 * sum(spent[1:]) / max(timing["steps"], 1)
        figures = [f"{one:.6f}" for one in (sum(spent), per_step, *spent)]
        writer.row([job.key, int(timing["steps"]), *figures])
    return file.getvalue()
