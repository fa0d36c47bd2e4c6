"""Tells what checks found: line by line as findings come, for readers, and as JSON for machines."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from typing import TextIO

from usarsim_doctor.examination import Audience, Checked
from usarsim_doctor.registry import Check, Finding, Mark
from usarsim_server import __version__

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


def counted(sections: Sequence[Checked], mark: Mark) -> int:
    """How many findings carry a mark."""
    return sum(finding.mark is mark for one in sections for finding in one.findings)


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
