"""The folder of a batch: a small file for each run that is over, and results when all are.

`batch.json` says what is run, so that another batch does not go on in the same folder.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from usarsim_exploration.batches.batch_file import Job
from usarsim_exploration.batches.playing import Played, Row
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.run_folder import prepare
from usarsim_exploration.timing import PHASES
from usarsim_server.errors import at
from usarsim_server.files import read_regular, reason, write_text

FORMAT = "usarsim-explore-batch/1"
BATCH, RESULT, TIMING, RUNS = "batch.json", "result.json", "timing.csv", "runs"
_LARGEST = 1 << 30
"""Bytes of a result that is read."""
_CURE = "name a result.json of `usarsim explore bench`"


class BatchFolder:
    """Where a batch leaves what it has."""

    def __init__(self, folder: Path, batch: Mapping[str, object]) -> None:
        """Make the folder, or find what is there of the same batch.

        Args:
            folder: of results. batch: resolved.

        Raises:
            ExplorationError: it holds runs of another batch, or cannot be written.
        """
        self.folder, self.batch = folder, batch
        prepare(folder / RUNS)
        told = {"version": version("usarsim-server"), **batch}
        path = folder / BATCH
        if path.exists():
            before = _json(path)
            before = before if isinstance(before, dict) else {}
            changed = [key for key in {**told, **before} if told.get(key) != before.get(key)]
            if changed:
                cure = "name another folder, or remove this one"
                problem = f"holds runs of another batch: {', '.join(changed)} changed"
                raise ExplorationError(at(folder, problem, cure))
        else:
            _write(path, json.dumps(told, indent=1) + "\n")

    def find(self, job: Job) -> Played | None:
        """What is kept of a run that came to its end."""
        path = self._path(job)
        if not path.exists():
            return None
        try:
            kept = json.loads(read_regular(path))
            return None if "error" in kept["row"] else Played(kept["row"], kept["timing"])
        except (OSError, ValueError, KeyError, TypeError):  # it is run again
            return None

    def keep(self, job: Job, played: Played) -> None:
        """Keep what came of a run.

        Raises:
            ExplorationError: it cannot be written.
        """
        _write(self._path(job), json.dumps(played._asdict()) + "\n")

    def finish(self, played: Mapping[Job, Played]) -> None:
        """Write results and times of all runs.

        Raises:
            ExplorationError: they cannot be written.
        """
        jobs = sorted(played, key=lambda job: job.order)
        _write(self.folder / TIMING, timing_csv((job, played[job].timing) for job in jobs))
        text = result_text(self.batch, [played[job].row for job in jobs])
        _write(self.folder / RESULT, text)

    def _path(self, job: Job) -> Path:
        return self.folder / RUNS / f"{job.key.replace('/', ',')}.json"


def result_text(batch: Mapping[str, object], rows: Iterable[Row]) -> str:
    """`result.json`: a line for each run."""
    head = {"format": FORMAT, "version": version("usarsim-server"), "batch": batch}
    lines = ",\n".join(json.dumps(row) for row in rows)
    return f'{json.dumps(head)[:-1]},\n"runs": [\n{lines}\n]}}\n'


def read_result(path: Path) -> dict[str, Any]:
    """The content of a `result.json`; its runs have a key each, and are otherwise not checked.

    Raises:
        ExplorationError: it cannot be read, or is something else.
    """
    content = _json(path)
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
    writer = csv.writer(file, lineterminator="\n")
    heads = [f"{phase.replace(' ', '_')}_s" for phase in PHASES]
    writer.writerow(["run", "steps", "processor_s", "ms_per_step", *heads])
    for job, timing in rows:
        if not timing:
            continue
        spent = [timing[phase] for phase in PHASES]
        per_step = 1e3 * sum(spent[1:]) / max(timing["steps"], 1)
        figures = [f"{one:.6f}" for one in (sum(spent), per_step, *spent)]
        writer.writerow([job.key, int(timing["steps"]), *figures])
    return file.getvalue()


def _json(path: Path) -> object:
    try:
        return json.loads(read_regular(path, _LARGEST))
    except OSError as error:
        problem = f"cannot be read: {reason(error)}"
        raise ExplorationError(at(path, problem, "check the path and its rights")) from error
    except (ValueError, RecursionError) as error:
        raise ExplorationError(at(path, f"is no JSON: {error}", _CURE)) from None


def _write(path: Path, text: str) -> None:
    try:
        write_text(path, text)
    except OSError as error:
        cure = "give a folder that can be written to"
        raise ExplorationError(at(path, f"cannot be written: {reason(error)}", cure)) from error
