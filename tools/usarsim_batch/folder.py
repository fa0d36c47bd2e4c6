"""The folder of a batch: a small file for each run that is over, and results when all are.

`batch.json` says what is run, so that another batch does not go on in the same folder.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path

from usarsim_batch.errors import BatchError
from usarsim_batch.tasks import Played, Task
from usarsim_server.base.errors import at
from usarsim_server.base.files import check_links, read_regular, reason, replacing
from usarsim_server.protocol.json_text import parse_json

BATCH, RESULT, RUNS = "batch.json", "result.json", "runs"
_LARGEST = 1 << 30
"""Bytes of a result that is read."""


class Folder:
    """Where a batch leaves what it has.

    Attributes:
        plan: SHA-256 of what is run.
    """

    def __init__(self, folder: Path, format: str, batch: Mapping[str, object]) -> None:
        """Make the folder, or find what is there of the same batch.

        Args:
            folder: of results. format: of `result.json`. batch: all that is run.

        Raises:
            BatchError: it holds runs of another batch, cannot be written, or a link in it leads out
                of it.
        """
        self.folder, self.format, self.batch = folder, format, batch
        told = {"version": version("usarsim-server"), **batch}
        text = json.dumps(told, indent=1) + "\n"
        self.plan = hashlib.sha256(text.encode()).hexdigest()
        try:
            (folder / RUNS).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            problem = f"cannot be made: {reason(error)}"
            raise BatchError(at(folder, problem, "give another folder")) from error
        check_links(folder, BatchError)
        path = folder / BATCH
        if path.exists():
            content = read_json(path, "name another folder, or remove this one")
            before = content if isinstance(content, dict) else {}
            told = parse_json(text)
            changed = [key for key in {**told, **before} if told.get(key) != before.get(key)]
            if changed:
                cure = "name another folder, or remove this one"
                problem = f"holds runs of another batch: {', '.join(changed)} changed"
                raise BatchError(at(folder, problem, cure))
        else:
            write(path, [text])

    def find(self, task: Task) -> Played | None:
        """What is kept of a run, failed or not."""
        return read_run(self._path(task))

    def keep(self, task: Task, played: Played) -> None:
        """Keep what came of a run.

        Raises:
            BatchError: it cannot be written.
        """
        about = {**played.about, "plan": self.plan}
        write(self._path(task), [json.dumps(played._replace(about=about)._asdict()) + "\n"])

    def finish(self, rows: Iterable[Mapping[str, object]]) -> None:
        """Write the results of all runs, a line for each.

        Raises:
            BatchError: they cannot be written.
        """
        head = {"format": self.format, "version": version("usarsim-server"), "batch": self.batch}
        write(self.folder / RESULT, _lines(json.dumps(head), rows))

    def _path(self, task: Task) -> Path:
        return self.folder / RUNS / f"{task.key.replace('/', ',')}.json"


def _lines(head: str, rows: Iterable[Mapping[str, object]]) -> Iterator[str]:
    yield f'{head[:-1]},\n"runs": ['
    between = "\n"
    for row in rows:
        yield between + json.dumps(row)
        between = ",\n"
    yield "\n]}\n"


def read_run(path: Path) -> Played | None:
    """What is kept of a run; None if nothing is, or nothing that can be read: it is run again."""
    try:
        kept = parse_json(read_regular(path))
        found = Played(kept["row"], kept["timing"], kept.get("about", {}))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return found if all(isinstance(part, dict) for part in found) else None


def read_json(path: Path, cure: str) -> object:
    """The content of a file.

    Args:
        path: of it. cure: if it is something else.

    Raises:
        BatchError: it cannot be read, or is no JSON.
    """
    try:
        return parse_json(read_regular(path, _LARGEST))
    except OSError as error:
        problem = f"cannot be read: {reason(error)}"
        raise BatchError(at(path, problem, "check the path and its rights")) from error
    except ValueError as error:
        raise BatchError(at(path, f"is no JSON: {error}", cure)) from None


def write(path: Path, texts: Iterable[str]) -> None:
    """Write a file whole, or leave what was there.

    Raises:
        BatchError: it cannot be written.
    """
    try:
        with replacing(path) as file:
            for text in texts:
                file.write(text.encode())
    except OSError as error:
        cure = "make room, or give a folder that can be written to"
        raise BatchError(at(path, f"cannot be written: {reason(error)}", cure)) from error
