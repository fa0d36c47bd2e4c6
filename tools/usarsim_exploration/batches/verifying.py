"""Runs a part of a batch again, to find out whether its results are those of its runs."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from usarsim_batch.engines import Engine
from usarsim_batch.tasks import differences
from usarsim_exploration.batches.batch_file import Job, read_batch
from usarsim_exploration.batches.batch_folder import key_of
from usarsim_exploration.batches.playing import play
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.rules import OLDEST
from usarsim_server.base.errors import at
from usarsim_server.base.tables import suggest


class Verification:
    """Of the results of a batch.

    Attributes:
        jobs: of the batch, by key. missing, strange: keys of runs that the results lack, or have
            though the batch has none such, or have twice.
    """

    def __init__(self, content: Mapping[str, Any], path: Path, files: Path, *, code: bool) -> None:
        """Compare what ran with what should have.

        Args:
            content: of `result.json`. path: of it. files: folder of maps and strategy files.
            code: strategies that stand in files are run.

        Raises:
            UsarsimError: the batch cannot be run, or what it names is no longer the same.
        """
        self._path = path
        tables = {"rules": OLDEST} | content["batch"]  # results without a number are older
        batch = read_batch(tables, files / path.name, code=code)
        batch.resolved()
        self.jobs = {job.key: job for job in batch.jobs()}
        keys = [str(key_of(row)) for row in content["runs"]]
        self._rows = dict(zip(keys, content["runs"], strict=True))
        self.missing = [key for key in self.jobs if key not in self._rows]
        self.strange = sorted({k for k in keys if k not in self.jobs or keys.count(k) > 1})

    def draw(self, part: float, seed: int) -> list[Job]:
        """So much of all runs, at least one."""
        keys = sorted(self.jobs.keys() & self._rows.keys())
        count = min(len(keys), max(1, math.ceil(part * len(keys))))
        return [self.jobs[key] for key in random.Random(seed).sample(keys, count)]

    def chance(self, drawn: int, forged: int) -> float:
        """Probability that none of so many forged runs is among so many that are drawn."""
        whole = len(self.jobs.keys() & self._rows.keys())
        return math.comb(whole - forged, drawn) / math.comb(whole, drawn)

    def named(self, keys: Sequence[str]) -> list[Job]:
        """Runs by their keys.

        Raises:
            ExplorationError: there is no such run.
        """
        for key in keys:
            if key not in self.jobs or key not in self._rows:
                cure = suggest(key, sorted(self.jobs)[:20])
                raise ExplorationError(at(self._path, f"there is no run {key!r}", cure))
        return [self.jobs[key] for key in keys]

    def rerun(self, jobs: Sequence[Job], engine: Engine) -> Iterator[tuple[Job, str]]:
        """Run again; each run with what differs first, or empty text."""
        for job, played in engine.play(play, jobs):
            found = next(differences(self._rows[job.key], played.row), None)
            text = (
                "" if found is None else f"{found[0]} is {found[1]!r}, the rerun has {found[2]!r}"
            )
            yield job, text
