"""Reads the log of a trial, and the files of forms: records line by line, up to one cut off."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from usarsim_mission.runlog import RunFolder
from usarsim_server.protocol.json_text import parse_json
from usarsim_study.errors import StudyError
from usarsim_study.trial import Record

FORMS = "forms.jsonl"
"""Forms of a participant, or those after a trial in its folder."""


def read_records(folder: Path) -> list[Record]:
    """All records of a run folder in their order, then those of the forms after it.

    One without a time has that of the one before.

    Raises:
        UsarsimError: it is no run folder, or a line before the last is damaged.
    """
    time = 0.0
    found = []
    for record in RunFolder(folder).records():
        told = record.get("t_sim")
        time = float(told) if isinstance(told, int | float) else time
        found.append({**record, "t_sim": time})
    if (folder / FORMS).exists():
        found += [{**record, "t_sim": time} for record in read_lines(folder / FORMS)]
    return found


def read_lines(path: Path) -> Iterator[Record]:
    """The objects of a file of lines; a last line that was cut off is left out.

    Raises:
        StudyError: it cannot be read, or a line before the last is no object.
    """
    try:
        lines = path.read_bytes().splitlines(keepends=True)
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror} (check its rights)") from None
    for number, line in enumerate(lines, start=1):
        try:
            record = parse_json(line)
        except ValueError:
            if not line.endswith(b"\n"):
                return
            record = None
        if not isinstance(record, dict):
            raise StudyError(f"{path}: line {number}: is no JSON object (restore the file)")
        yield record


def last_line(path: Path) -> Record | None:
    """The last record of a log; None if there is none, or the last line is not whole."""
    try:
        with path.open("rb") as file:
            end = file.seek(0, os.SEEK_END)
            tail, size = b"", 4096
            while tail.count(b"\n") < 2 and len(tail) < end:
                file.seek(max(0, end - size))
                tail, size = file.read(size), size * 8
        record = parse_json(tail.splitlines()[-1]) if tail.endswith(b"\n") else None
    except (OSError, ValueError, IndexError):
        return None
    return record if isinstance(record, dict) and "seq" in record else None
