"""The folder of a study: who took part, with which trials; the only place that knows its files.

    study.toml            the study
    allocation.csv        who meets what in which order; the key of a blind study
    numbers/0001          participants' numbers that are given away
    participants/CODE/participant.json    {"code", "number", "day", "status", "reason", "scripted"}
    participants/CODE/forms.jsonl         records `form` of before and after, see `forms.FormState`
    participants/CODE/steps.jsonl         what else is done: {"passed", "seat"}
    participants/CODE/training-1/         like a trial
    participants/CODE/forgotten           is being removed, and counts no more
    participants/CODE/trial-1/            a run folder, trial.json {"status", "reason"}, and
                                          forms.jsonl with the forms after it; trial-1-2 is the
                                          second attempt, and counts

Neither a participant's file nor a trial's names a condition: the number leads to it by the list.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from usarsim_mission.runlog import EVENTS, SCORE, TRUTH
from usarsim_server.base.files import check_links, write_text
from usarsim_server.base.private import FOLDER_MODE, private
from usarsim_server.base.toml import read_text
from usarsim_server.protocol.json_text import parse_json
from usarsim_study.assignment import ALLOCATION, Order, claim_number, new_code, read_allocation
from usarsim_study.errors import StudyError
from usarsim_study.measures import MEASURES, Value, compute
from usarsim_study.records import FORMS as FORMS
from usarsim_study.records import read_lines, read_records
from usarsim_study.study_file import FILE, Study, read_study
from usarsim_study.trial import Record, Trial

PARTICIPANTS = "participants"
STEPS = "steps.jsonl"
CACHE = "measures.json"
FORGOTTEN = "forgotten"
"""Stands in the folder of a participant that is being removed."""
EXPORTS = ("data", "summary.csv")
"""What `usarsim study export` writes into the folder."""
REPORTS = ("report.html", "report.md", "results.csv")
"""What `usarsim study report` writes into the folder."""

Status = Literal["running", "complete", "withdrawn", "excluded"]
TrialStatus = Literal["running", "complete", "aborted", "void", "missing", "passed", "failed"]
"""How an attempt ended; `passed` and `failed` are of trainings."""
Stage = Literal["trial", "training"]

_COMPUTED = 2  # raised when values of the same logs change

_ATTEMPT = re.compile(r"(?P<stage>trial|training)-(?P<number>[0-9]+)(?:-(?P<attempt>[0-9]+))?")


@dataclass(frozen=True, slots=True)
class Participant:
    """One participant.

    Attributes:
        code, number: who. day: of the session, no finer. reason: why not complete.
        scripted: made by code. Files of earlier versions do not say so: people.
    """

    code: str
    number: int
    day: str
    status: Status = "running"
    reason: str = ""
    scripted: bool = False


@dataclass(frozen=True, slots=True)
class TrialFolder:
    """One attempt at a trial."""

    path: Path
    trial: int
    attempt: int
    status: TrialStatus
    reason: str


class StudyFolder:
    """A study folder that exists."""

    def __init__(self, path: Path) -> None:
        """Read the study.

        Raises:
            StudyError: there is none, it is wrong, or a link in it leads out of it.
        """
        check_links(path, StudyError)
        self.path = path
        self.study: Study = read_study(path / FILE)

    def begin(self) -> str:
        """Write the list of assignments, unless it is there; its digest, for every log.

        Raises:
            StudyError: the study file was changed since it was written.
        """
        return self.study.allocation.export(self.path)

    @cached_property
    def orders(self) -> dict[int, Order]:
        """The trials of each number, from the list."""
        return read_allocation(self.path / ALLOCATION)

    def admit(self, day: str, *, scripted: bool = False) -> Participant:
        """A new participant, with the next number and a random code; on disk when this returns.

        Args:
            day: YYYY-MM-DD. scripted: made by code.

        Raises:
            StudyError: the list of assignments has no more numbers.
        """
        self.begin()
        number = claim_number(self.path)
        if number not in self.orders:
            raise StudyError(
                f"{self.path / ALLOCATION}: has no participant {number} (plan more participants "
                "in a new study)"
            )
        code = new_code(one.code for one in self.participants())
        participant = Participant(code, number, day, scripted=scripted)
        place = self.place(participant.code)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.mkdir(mode=FOLDER_MODE)
        self.store(participant)
        return participant

    def place(self, code: str) -> Path:
        """The folder of a participant."""
        return self.path / PARTICIPANTS / code

    def store(self, participant: Participant) -> None:
        """Write what is known of a participant."""
        _write_json(self.place(participant.code) / "participant.json", asdict(participant))

    def participants(self) -> tuple[Participant, ...]:
        """All, by number.

        Raises:
            StudyError: a file is damaged.
        """
        found = []
        for path in sorted(self.path.glob(f"{PARTICIPANTS}/*/participant.json")):
            if (path.parent / FORGOTTEN).exists():
                continue
            told = _read_json(path)
            try:
                found.append(Participant(**told))
            except TypeError:
                raise StudyError(f"{path}: is no participant (restore the file)") from None
        return tuple(sorted(found, key=lambda one: one.number))

    def new_trial(self, code: str, trial: int, stage: Stage = "trial") -> Path:
        """A new run folder for a trial; a further attempt if there is one already."""
        before = [one.attempt for one in self.attempts(code, stage) if one.trial == trial]
        attempt = max(before, default=0) + 1
        name = f"{stage}-{trial}" if attempt == 1 else f"{stage}-{trial}-{attempt}"
        path = self.place(code) / name
        path.mkdir(parents=True)
        self.close_trial(path, "running")
        return path

    def close_trial(self, path: Path, status: TrialStatus, reason: str = "") -> None:
        """Say how a trial ended."""
        _write_json(path / "trial.json", {"status": status, "reason": reason})

    def attempts(self, code: str, stage: Stage = "trial") -> tuple[TrialFolder, ...]:
        """All attempts at trials, in order; one that is still `running` was cut off, or is."""
        found = []
        for path in self.place(code).iterdir():
            match = _ATTEMPT.fullmatch(path.name)
            if match is not None and match["stage"] == stage and path.is_dir():
                told = _read_json(path / "trial.json") if (path / "trial.json").exists() else {}
                found.append(
                    TrialFolder(
                        path,
                        int(match["number"]),
                        int(match["attempt"] or 1),
                        told.get("status", "running"),
                        str(told.get("reason", "")),
                    )
                )
        return tuple(sorted(found, key=lambda one: (one.trial, one.attempt)))

    def forms(self, code: str) -> list[Record]:
        """The forms before and after the trials, the last state of each."""
        path = self.place(code) / FORMS
        return list(read_lines(path)) if path.exists() else []

    def forgetting(self, code: str) -> Path:
        """Begin to remove a participant: from now on nothing here knows of it.

        The folder stays until `forgotten` has removed all else, so that a removal that was cut off
        can be made again to its end.

        Returns:
            The participant's folder.

        Raises:
            StudyError: there is no such participant.
        """
        folders = {path.name: path for path in (self.path / PARTICIPANTS).glob("*/")}
        if code not in folders:
            raise StudyError(f"{self.path}: has no participant {code!r} (see participants/)")
        (folders[code] / FORGOTTEN).touch()
        return folders[code]

    def forgotten(self, folder: Path) -> None:
        """Remove what `forgetting` has returned; the number stays given away."""
        for path in folder.iterdir():
            if path.name != FORGOTTEN:
                _remove(path)
        _remove(folder)

    def drop(self, names: Iterable[str]) -> list[Path]:
        """Remove these of the files that `EXPORTS` names, or folders; those that were there."""
        there = [self.path / name for name in names if (self.path / name).exists()]
        for path in there:
            _remove(path)
        return there


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def values_of(folder: Path) -> tuple[list[Value], list[Record], int]:
    """All values of a run, its forms, and how many stops of driving had to be inferred.

    They are kept in `measures.json` beside the logs, and used again as long as the logs are as
    long as they were and the measures are the same.

    Raises:
        StudyError: a log is damaged.
    """
    sizes = [
        (folder / name).stat().st_size if (folder / name).exists() else -1
        for name in (EVENTS, TRUTH, SCORE, FORMS)
    ]
    stamp = [_COMPUTED, *sizes, [[one.name, one.definition] for one in MEASURES.values()]]
    try:
        kept = parse_json((folder / CACHE).read_text(encoding="utf-8"))
        if kept["stamp"] == stamp:
            return [Value(*one) for one in kept["values"]], kept["forms"], int(kept["inferred"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    records = read_records(folder)
    score = _read_json(folder / SCORE) if (folder / SCORE).exists() else {}
    trial = Trial(records, score)
    values, forms, inferred = list(compute(trial)), trial.all("form"), trial.inferred_stops
    rows = [[one.measure, one.level, one.who, one.value] for one in values]
    content = {"stamp": stamp, "values": rows, "forms": forms, "inferred": inferred}
    write_text(folder / CACHE, json.dumps(content, separators=(",", ":")) + "\n", private=True)
    return values, forms, inferred


def append_form(path: Path, states: Iterable[dict[str, Any]]) -> None:
    """Add records `form` to a participant's file of forms; the last one of a form counts."""
    append_lines(path, ({"kind": "form", **state} for state in states))


def append_lines(path: Path, records: Iterable[dict[str, Any]]) -> None:
    """Add objects to a file of lines; they are on the disk when this returns.

    A last line that was cut off, when a program was killed or a disk full, makes room.

    Raises:
        OSError: not all could be written; what was is taken back.
    """
    text = "".join(json.dumps(record, ensure_ascii=False) + "\n" for record in records)
    left = memoryview(text.encode())
    file = private(path, os.O_RDWR | os.O_CREAT)
    try:
        whole = _whole_lines(file)
        os.ftruncate(file, whole)
        os.lseek(file, whole, os.SEEK_SET)
        try:
            while left:
                left = left[os.write(file, left) :]
            os.fsync(file)
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(file, whole)
            raise
    finally:
        os.close(file)


def _whole_lines(file: int) -> int:
    """Bytes of a file up to the end of its last whole line."""
    end = os.lseek(file, 0, os.SEEK_END)
    while end:
        begin = max(0, end - 4096)
        found = os.pread(file, end - begin, begin).rfind(b"\n")
        if found >= 0:
            return begin + found + 1
        end = begin
    return 0


def _write_json(path: Path, content: dict[str, Any]) -> None:
    write_text(path, json.dumps(content, ensure_ascii=False) + "\n", private=True)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        found = parse_json(read_text(path, StudyError))
    except ValueError:
        raise StudyError(f"{path}: is no JSON (restore the file)") from None
    if not isinstance(found, dict):
        raise StudyError(f"{path}: is no JSON object (restore the file)")
    return found
