"""The folder of a run: what happened, line by line, so that it can be scored and replayed.

Two files, `events.jsonl` and `truth.jsonl`, hold one object a line in one numbering. What is told
to the writer stands in memory until it is on the disk: it is written at least once a second of the
run and at once where somebody answered something. A disk that is full keeps nothing from being
told: a reserve of disk space is given up for it, the rest waits and is tried again, events before
truth, and `trouble` says so; only what cannot be written until `close` is lost, an error.
"""

from __future__ import annotations

import contextlib
import fcntl
import heapq
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from usarsim_mission.errors import RunLogError
from usarsim_mission.model import Mission, World, plain, read_world, world_json
from usarsim_mission.records import Record
from usarsim_mission.scoring import Rules, read_rules
from usarsim_mission.truth_lines import Packer, Thinner, Unpacker
from usarsim_server.base.errors import at
from usarsim_server.base.files import check_links, open_regular, reason, write_text
from usarsim_server.base.toml import toml_text
from usarsim_server.protocol.json_text import parse_json

EVENTS, TRUTH = "events.jsonl", "truth.jsonl"
MISSION, SCORING, WORLD, SCORE = "mission.toml", "scoring.toml", "world.json", "score.json"
FLUSH = 1.0
"""s of the run between two times at which all that waits is written, at most."""
AT_ONCE = frozenset({"session", "trial_start", "trial_end", "form", "probe", "mark_set", "error"})
"""Kinds that do not wait."""
RESERVE = 8 << 20
"""Bytes of the disk that are kept for its last hour."""
LONGEST = 16 << 20
"""Bytes of a line."""
RESERVED = ".reserve"
"""Name of that reserve."""


class RunWriter:
    """Writes a run.

    Attributes:
        folder: of it.
        trouble: why lines wait in memory, or had to until the reserve was given up; None while all
            is well. The run should end then: there is room for some minutes.
    """

    def __init__(
        self,
        folder: Path,
        mission_text: str,
        mission: Mission,
        rules: Rules,
        world: World,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make the folder.

        Args:
            folder: to make; it may exist, but without logs.
            mission_text: the TOML of the mission as it is run, seeds resolved.
            mission: what the referee knows of it.
            rules: by which it is scored.
            world: what is true.
            clock: s; tells `t_wall`.

        Raises:
            RunLogError: it cannot be made, or has logs already.
        """
        try:
            if (folder / EVENTS).exists() or (folder / TRUTH).exists():
                raise FileExistsError
            folder.mkdir(parents=True, exist_ok=True)
            write_text(folder / MISSION, mission_text)
            write_text(folder / SCORING, toml_text(plain(rules)))
            write_text(folder / WORLD, world_json(mission, world))
            self._open(folder, rules, clock, os.O_EXCL)
        except FileExistsError as error:
            cure = "name another folder"
            raise RunLogError(at(folder, "has the logs of another run", cure)) from error
        except OSError as error:
            cure = "name a folder that can be written"
            raise RunLogError(at(folder, f"cannot be made: {reason(error)}", cure)) from error

    def _open(self, folder: Path, rules: Rules, clock: Callable[[], float], how: int) -> None:
        self.folder = folder
        self.trouble: str | None = None
        self._clock, self._seq, self._time = clock, 0, 0.0
        self._thinner, self._packer = Thinner(rules), Packer()
        self._files = {name: _Lines(folder / name, how) for name in (EVENTS, TRUTH)}
        self._reserve: Path | None = _reserved(folder / RESERVED)
        self._began = self._flushed = clock()

    @classmethod
    def reopen(
        cls, folder: Path, last: Record, clock: Callable[[], float] = time.monotonic
    ) -> RunWriter:
        """Go on with logs that are whole; see `mending.mend`.

        Args:
            folder: of the run. last: its last record. clock: s; tells `t_wall`, which goes on.

        Raises:
            RunLogError: somebody writes it still, or it cannot be written.
        """
        log, rules = cls.__new__(cls), RunFolder(folder).rules()
        try:
            log._open(folder, rules, clock, 0)
        except BlockingIOError as error:
            raise RunLogError(at(folder, "is being written", "wait for its end")) from error
        except OSError as error:
            cure = "check its rights"
            raise RunLogError(at(folder, f"cannot be written: {reason(error)}", cure)) from error
        log._seq, log._time = last["seq"] + 1, last["t_sim"]
        log._began -= last["t_wall"]
        return log

    @property
    def began(self) -> float:
        """s of its clock from which `t_wall` counts."""
        return self._began

    def write(self, record: Mapping[str, Any]) -> Record:
        """Take a record; never fails for the disk.

        Args:
            record: with `kind`, `t_sim` and its facts.

        Returns:
            The record as it is read back: numbered, lists for tuples, null for what is no number.
        """
        now = self._clock()
        wall = round(now - self._began, 6)
        facts = {key: one for key, one in record.items() if key not in ("seq", "t_wall")}
        truth = record["kind"] == "truth"
        facts = self._thinner.thin(facts) if truth else facts
        line, told = _line({"seq": self._seq, "t_wall": wall, **facts})
        if truth:
            line, _ = _line(self._packer.pack(told))
        self._seq += 1
        self._time = told.get("t_sim") or self._time
        self._files[TRUTH if truth else EVENTS].add(line)
        if now - self._flushed >= FLUSH or told["kind"] in AT_ONCE:
            self.flush()
        return told

    def flush(self) -> None:
        """Hand all that waits to the system."""
        self._flushed = self._clock()
        failure = self._write_all()
        if failure is not None and self._reserve is not None:
            with contextlib.suppress(OSError):
                self._reserve.unlink()
            self._reserve = None
            self.write({"kind": "error", "t_sim": self._time, "text": f"the disk fails: {failure}"})
        self.trouble = failure or self.trouble

    def close(self) -> None:
        """Write the rest and end.

        Raises:
            RunLogError: some of it cannot be written.
        """
        self.flush()
        waiting = sum(one.waiting for one in self._files.values())
        for one in self._files.values():
            one.close()
        if self._reserve is not None:
            with contextlib.suppress(OSError):
                self._reserve.unlink()
        if waiting:
            cure = "make room on the disk and run it again"
            problem = f"the last {waiting} bytes could not be written: {self.trouble}"
            raise RunLogError(at(self.folder, problem, cure))

    def _write_all(self) -> str | None:
        """Why not all was written, or None; what people did comes before the truth."""
        failure = None
        for one in self._files.values():
            try:
                one.write()
            except OSError as error:
                failure = reason(error)
        return failure


class _Lines:
    """A file to which lines are added."""

    def __init__(self, path: Path, how: int) -> None:
        flags = os.O_WRONLY | os.O_CREAT | how | os.O_APPEND | os.O_CLOEXEC
        self._file = os.open(path, flags, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise
        self._waiting = bytearray()

    @property
    def waiting(self) -> int:
        """Bytes that are not written yet."""
        return len(self._waiting)

    def add(self, line: bytes) -> None:
        """Let a line wait."""
        self._waiting += line

    def write(self) -> None:
        """Write what waits.

        Raises:
            OSError: not all could be; the rest still waits.
        """
        while self._waiting:
            done = os.write(self._file, self._waiting)
            del self._waiting[:done]

    def close(self) -> None:
        """Hand it over to the disk and end."""
        with contextlib.suppress(OSError):
            os.fsync(self._file)
        os.close(self._file)


class RunFolder:
    """Reads a run.

    Attributes:
        path: of its folder.
        cut: files whose last line is not whole; known once all records were read.
        missing: numbers that no record has, below the last one; known then, too.
    """

    def __init__(self, path: Path) -> None:
        """Look whether it is one.

        Raises:
            RunLogError: it is none, or a link in it leads out of it.
        """
        if not (path / EVENTS).is_file():
            cure = "name the folder of a run, with events.jsonl"
            raise RunLogError(at(path, "is no run", cure))
        check_links(path, RunLogError)
        self.path, self.cut, self.missing = path, list[str](), 0

    def world(self) -> tuple[Mission, World]:
        """What the referee knew; see `model.read_world`."""
        return read_world(self.path / WORLD)

    def rules(self) -> Rules:
        """The rules as they were used; see `scoring.read_rules`."""
        return read_rules(self.path / SCORING)

    def records(self) -> Iterator[Record]:
        """All records in their order, up to a last line that is cut off.

        Raises:
            RunLogError: a line is none, or numbers go back; names file and line.
        """
        self.cut, self.missing = [], 0
        files = [self.path / name for name in (EVENTS, TRUTH) if (self.path / name).exists()]
        due = 0
        for record in heapq.merge(*map(self._lines, files), key=lambda one: int(one["seq"])):
            self.missing += record["seq"] - due
            if record["seq"] < due:
                problem = f"two records have number {record['seq']}"
                raise RunLogError(at(self.path, problem, "take an unchanged copy"))
            due = record["seq"] + 1
            yield record

    def _lines(self, path: Path) -> Iterator[Record]:
        last, unpacker = -1, Unpacker()
        try:
            with open_regular(path) as file:
                for number in range(1, 1 << 62):
                    line = file.readline(LONGEST)
                    if not line:
                        return
                    record = _record(line, unpacker)
                    if record is None and not file.peek(1):
                        self.cut.append(path.name)
                        return
                    if record is None or record["seq"] <= last:
                        problem = "is no record" if record is None else "the number goes back"
                        cure = "take an unchanged copy, or cut the file off there"
                        raise RunLogError(at(path, problem, cure, where=f"line {number}"))
                    last = record["seq"]
                    yield record
        except OSError as error:
            problem = f"cannot be read: {reason(error)}"
            raise RunLogError(at(path, problem, "check the path and its rights")) from error


def _record(line: bytes, unpacker: Unpacker) -> Record | None:
    """What a line says; None if it is not whole or no record."""
    if not line.endswith(b"\n"):
        return None
    try:
        record = parse_json(line)
    except ValueError:
        return None
    if not isinstance(record, dict) or not isinstance(record.get("kind"), str):
        return None
    if record["kind"] == "truth":
        try:
            record = unpacker.unpack(record)
        except (AttributeError, TypeError, ValueError):
            return None
    seq = record.get("seq")
    return record if isinstance(seq, int) and not isinstance(seq, bool) and seq >= 0 else None


def _line(record: Record) -> tuple[bytes, Record]:
    """A line, and the record as it is read back."""
    try:
        text = json.dumps(record, separators=(",", ":"), allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(record), separators=(",", ":"))
    return text.encode() + b"\n", parse_json(text)


def _finite(value: Any) -> Any:
    """A value with null for every number that is none."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(one) for key, one in value.items()}
    return [_finite(one) for one in value] if isinstance(value, list | tuple) else value


def _reserved(path: Path) -> Path | None:
    """A file that takes room; None if there is too little of it already."""
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        os.posix_fallocate(file, 0, RESERVE)
    except OSError:
        with contextlib.suppress(OSError):
            path.unlink()
        return None
    finally:
        os.close(file)
    return path
