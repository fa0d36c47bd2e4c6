"""What checks find out, which there are, running them so that none spoils the report, and telling
it.

A check is a function that yields findings, entered with a decorator:

    @check("disk", "Disk", order=25)
    def look(context: Context) -> Iterator[Finding]:
        yield Finding("free space", Mark.OK, "12 GiB")

The report is for readers, line by line as findings come, and as JSON for machines.
"""

from __future__ import annotations

import enum
import importlib
import json
import math
import pkgutil
import shlex
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import TextIO

from usarsim_doctor import checks as package
from usarsim_doctor.isolation import attempt
from usarsim_server import __version__
from usarsim_server.settings import Settings


class Mark(enum.Enum):
    """How a thing stands.

    A note is neither good nor bad, for example something optional that is not there. With a warning
    the server runs, but not as well as it could; with a problem it does not start, or not as asked.
    """

    OK = "ok"
    NOTE = "note"
    WARNING = "warning"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report."""

    subject: str  # what was looked at, a word or two
    mark: Mark  # see there
    text: str  # what was found, and what it means
    cure: str | None = None  # the one command that mends it
    advice: str | None = None  # where no command does, what to do instead
    values: Mapping[str, object] = field(default_factory=dict)
    """The same in numbers, for machines; finite, and named with their units."""


@dataclass(frozen=True, slots=True)
class Checked:
    """What one check found."""

    key: str  # of the check
    title: str  # for readers
    findings: tuple[Finding, ...]  # in the order of the report


def counted(sections: Sequence[Checked], mark: Mark) -> int:
    """How many findings carry a mark."""
    return sum(finding.mark is mark for one in sections for finding in one.findings)


TIMEOUT = 60.0
"""s of wall time for a check in a process of its own."""


@dataclass(frozen=True, slots=True)
class Context:
    """What checks may ask for."""

    settings: Settings  # those that the server would run with
    given: tuple[tuple[str, str], ...] = ()
    """Options of the command line that they came from, in order, flag and text."""

    def serve(self, options: Mapping[str, object]) -> str:
        """The command that starts the server with these settings but for some options."""
        words = ["usarsim", "serve"]
        kept = [(flag, text) for flag, text in self.given if flag not in options]
        for flag, text in [*kept, *((flag, str(value)) for flag, value in options.items())]:
            # Joined, a text that begins with a hyphen is no option.
            words += [f"{flag}={text}"] if text.startswith("-") else [flag, text]
        return shlex.join(words)


Look = Callable[[Context], Iterable[Finding]]


@dataclass(frozen=True, slots=True)
class Check:
    """One check."""

    key: str  # one word, for machines
    title: str  # for readers
    order: int  # place in the report; low numbers come first
    look: Look  # what it does
    apart: bool = False
    """It needs libraries that may be broken, and so runs in a process of its own."""


class Audience:
    """Who is told of findings as they come; this one only wants the result."""

    def begin(self, check: Check) -> None:
        """A check begins."""

    def tell(self, finding: Finding) -> None:
        """The check that has begun found something."""


_CHECKS: dict[str, Check] = {}


def check(key: str, title: str, order: int, *, apart: bool = False) -> Callable[[Look], Look]:
    """Decorator: enter a function as a check (see `Check`).

    Raises:
        ValueError: if another function has that key.
    """

    def enter(look: Look) -> Look:
        known = _CHECKS.get(key)
        if known is not None and known.look.__module__ != look.__module__:
            raise ValueError(f"check {key!r} is already that of {known.look.__module__}")
        _CHECKS[key] = Check(key, title, order, look, apart)
        return look

    return enter


def all_checks() -> tuple[Check, ...]:
    """All checks in the order of the report; a file that cannot be imported is one that fails."""
    found = []
    for module in pkgutil.iter_modules(package.__path__):
        try:
            importlib.import_module(f"{package.__name__}.{module.name}")
        except Exception as error:
            found.append(Check(module.name, module.name.capitalize(), 1000, _failing(error)))
    return tuple(sorted([*found, *_CHECKS.values()], key=lambda one: one.order))


def examine(
    checks: Sequence[Check], context: Context, audience: Audience | None = None
) -> tuple[Checked, ...]:
    """Run checks one after another.

    A check that raises becomes a warning below what it found before.

    Args:
        checks: to run.
        context: for all of them.
        audience: is told meanwhile.
    """
    audience = audience or Audience()
    sections = []
    for one in checks:
        audience.begin(one)
        findings: list[Finding] = []
        for finding in _looked(one, context):
            findings.append(finding)
            audience.tell(finding)
        sections.append(Checked(one.key, one.title, tuple(findings)))
    return tuple(sections)


def _looked(one: Check, context: Context) -> Iterable[Finding]:
    try:
        yield from _apart(one, context) if one.apart else one.look(context)
    except Exception as error:  # whatever is wrong here, the rest of the report is still wanted
        text = " ".join(f"{type(error).__name__}: {error}".split())
        yield Finding(one.title.lower(), Mark.WARNING, f"could not be looked at: {text}")


def _apart(one: Check, context: Context) -> Iterable[Finding]:
    """Findings of a check that another process runs."""
    name = f"findings:{one.key}"
    outcome = attempt([name], context.settings, TIMEOUT)[name]
    if outcome.failure is not None:
        text = f"could not be looked at: {outcome.failure}"
        yield Finding(one.title.lower(), Mark.WARNING, text, advice=outcome.advice)
    for found in outcome.values.get("findings", ()):
        yield Finding(**{**found, "mark": Mark(found["mark"])})


def _failing(error: Exception) -> Look:
    def look(context: Context) -> Iterable[Finding]:
        raise error

    return look


MARK_WIDTH = max(len(mark.value) for mark in Mark)
SUBJECT_WIDTH = 15
ADVICE_LINES = 3
"""After so many lines of it, for example of names that would do, advice is cut off."""
_INDENT = 2 + MARK_WIDTH + 2 + SUBJECT_WIDTH + 2
_NARROWEST = 30
"""Columns that the texts get on the narrowest terminal."""

# Select Graphic Rendition (ECMA-48 8.3.117)
_COLORS = {Mark.OK: "32", Mark.NOTE: "36", Mark.WARNING: "33", Mark.PROBLEM: "1;31"}
_BOLD = "1"


class Printer(Audience):
    """An audience that reads: a table with marks, a heading for each check.

    Ports
      ok       3000             robot control: free, this machine only
      warning  5003             camera images: taken, by nc -l 5003 (pid 77)
               to mend          usarsim serve --image-port 5004
    """

    def __init__(self, stream: TextIO, width: int, color: bool) -> None:
        """Print nothing yet.

        Args:
            stream: where to.
            width: columns.
            color: marks are coloured.
        """
        self._stream = stream
        self._width = max(width, _INDENT + _NARROWEST)
        self._color = color
        self._begun = False

    def begin(self, check: Check) -> None:
        """Print the heading of a check."""
        blank = "\n" if self._begun else ""
        self._begun = True
        self._print(f"{blank}{self._painted(check.title, _BOLD)}")

    def tell(self, finding: Finding) -> None:
        """Print a finding and its cure."""
        mark = self._painted(finding.mark.value.ljust(MARK_WIDTH), _COLORS[finding.mark])
        first, *others = self._wrapped(finding.text)
        self._print(f"  {mark}  {finding.subject.ljust(SUBJECT_WIDTH)}  {first}")
        for line in others:
            self._print(" " * _INDENT + line)
        label = "to mend" if finding.mark in (Mark.WARNING, Mark.PROBLEM) else "to have it"
        space = " " * (4 + MARK_WIDTH)
        for line in self._wrapped(finding.advice or "", ADVICE_LINES) if finding.advice else ():
            self._print(f"{space}{label.ljust(SUBJECT_WIDTH)}  {line}")
            label = ""
        if finding.cure is not None:
            # Never wrapped: a command is to be copied in one piece.
            self._print(
                f"{space}{label.ljust(SUBJECT_WIDTH)}  {self._painted(finding.cure, _BOLD)}"
            )

    def end(self, sections: Sequence[Checked]) -> None:
        """Print the verdict."""
        mark = worst(sections)
        self._print("\n" + self._painted(verdict(sections), _COLORS[mark]))

    def _wrapped(self, text: str, most: int | None = None) -> list[str]:
        return textwrap.wrap(
            *(" ".join(text.split()), self._width - _INDENT),
            break_on_hyphens=False,
            max_lines=most,
            placeholder=" ...",
        ) or [""]

    def _painted(self, text: str, code: str) -> str:
        return f"\x1b[{code}m{text}\x1b[0m" if self._color else text

    def _print(self, line: str) -> None:
        print(line, file=self._stream, flush=True)


def worst(sections: Sequence[Checked]) -> Mark:
    """The worst mark there is; a note is no worse than ok."""
    for mark in (Mark.PROBLEM, Mark.WARNING):
        if counted(sections, mark):
            return mark
    return Mark.OK


def verdict(sections: Sequence[Checked]) -> str:
    """One sentence about everything."""
    problems, warnings = (counted(sections, mark) for mark in (Mark.PROBLEM, Mark.WARNING))
    tail = f" ({_number(warnings, 'warning')})" if warnings else ""
    if problems:
        return f"{_number(problems, 'problem')} to mend before the server can run{tail}."
    return f"This machine can run the server{tail}."


def as_json(sections: Sequence[Checked], taken: datetime) -> str:
    """One JSON object; numbers that are not finite become null. Ends with a line feed."""
    document = {
        "usarsim_server": __version__,
        "taken": taken.isoformat(timespec="seconds"),
        "can_run": worst(sections) is not Mark.PROBLEM,
        "problems": counted(sections, Mark.PROBLEM),
        "warnings": counted(sections, Mark.WARNING),
        "checks": [_plain(asdict(section)) for section in sections],
    }
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: object) -> object:
    """A value that JSON can hold."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, Mark):
        return value.value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int | bool) else str(value)


def _number(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"
