"""Reports as people read them in a terminal, and the line that shows progress."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TextIO

from usarsim_conformance.registry import Check
from usarsim_conformance.report import Report
from usarsim_conformance.runner import Progress
from usarsim_conformance.verdicts import Result, Severity, Verdict

SIGNS = {
    Verdict.PASS: "pass",
    Verdict.FAIL: "FAIL",
    Verdict.NOT_APPLICABLE: "n/a",
    Verdict.INCONCLUSIVE: "??",
}
_TRANSCRIPT = 14
"""Lines of a transcript that the terminal shows; the report files hold more."""
_WIDTH = 160


def shown_verdict(result: Result, severity: Severity) -> str:
    """The verdict in a word; breaking an informative rule is no failure."""
    if result.verdict is Verdict.FAIL and severity is Severity.INFORMATIVE:
        return "note"
    return SIGNS[result.verdict]


class Teller:
    """Shows progress: one line that changes in a terminal, lines of findings elsewhere too."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._live = stream.isatty()

    def __call__(self, progress: Progress) -> None:
        """Take notice of a result."""
        result, check = progress.result, progress.check
        if result.verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE):
            word = shown_verdict(result, check.severity)
            reason = result.reason.splitlines()[0] if result.reason else ""
            self._write(f"{word:4}  {_where(result)}  {reason}"[:_WIDTH], stays=True)
        if self._live or progress.done % 100 == 0 or progress.done == progress.total:
            self._write(f"{progress.done}/{progress.total}  {check.id}"[:78], stays=not self._live)

    def say(self, text: str) -> None:
        """A line of its own."""
        self._write(text, stays=True)

    def done(self) -> None:
        """Clear the line that changes."""
        if self._live:
            self._stream.write("\r\x1b[K")
            self._stream.flush()

    def _write(self, text: str, *, stays: bool) -> None:
        clear = "\r\x1b[K" if self._live else ""
        self._stream.write(f"{clear}{text}" + ("\n" if stays else ""))
        self._stream.flush()


def as_text(report: Report) -> str:
    """Facts, a table by area, what was found wrong, and a summary."""
    parts = [
        "\n".join(f"{name:22}{value}" for name, value in report.server.items()),
        _areas(report),
        *(_finding(report, one) for one in report.results if _is_broken(report, one)),
        _remarks(report),
        summary(report),
    ]
    return "\n\n".join(part for part in parts if part)


def summary(report: Report) -> str:
    """Counts and the verdict on the whole, in two lines."""
    counts = report.counts
    told = ", ".join(f"{counts[verdict]} {verdict.value}" for verdict in Verdict)
    failed = {severity: report.count(Verdict.FAIL, severity) for severity in Severity}
    broken = ", ".join(f"{count} {severity.value}" for severity, count in failed.items() if count)
    ending = f"; broken: {broken}" if broken else ""
    word = "conforms" if report.conforms else "does NOT conform"
    return (
        f"{len(report.rules)} checks, {len(report.results)} verdicts in {report.seconds:.0f} s: "
        f"{told}{ending}\n{report.name} {word}."
    )


def as_list(checks: Sequence[Check]) -> str:
    """The checks, one per line: identifier, severity, dialects, title."""
    width = max((len(check.id) for check in checks), default=0)
    lines = [
        f"{check.id:{width}}  {check.severity.value:11}  "
        f"{','.join(check.dialects) or 'once':17}  {check.title}"
        for check in checks
    ]
    return "\n".join([*lines, f"{len(checks)} checks"])


def _areas(report: Report) -> str:
    """One line for every area of checks: how many passed in each dialect."""
    areas: dict[str, list[Result]] = {}
    for result in report.results:
        areas.setdefault(".".join(result.check.split(".")[:2]), []).append(result)
    heads = ["", "pass", "FAIL", "n/a", "??"]
    rows = [
        [area, *(str(sum(one.verdict is verdict for one in results) or "") for verdict in Verdict)]
        for area, results in areas.items()
    ]
    width = max(len(row[0]) for row in [heads, *rows])
    return "\n".join(
        row[0].ljust(width) + "".join(cell.rjust(6) for cell in row[1:]) for row in [heads, *rows]
    )


def _finding(report: Report, result: Result) -> str:
    rule = report.rule(result.check)
    shown = result.transcript
    if len(shown) > _TRANSCRIPT:
        shown = ("...", *shown[-_TRANSCRIPT:])
    lines = [
        f"{shown_verdict(result, rule.severity)}  {_where(result)}  ({rule.severity.value})",
        textwrap.fill(f"Rule: {rule.rule} [{rule.source}]", 100, initial_indent="      "),
        f"      Seen: {result.reason}",
        *(f"      | {entry[:_WIDTH]}" for entry in shown),
    ]
    return "\n".join(lines)


def _is_broken(report: Report, result: Result) -> bool:
    severity = report.rule(result.check).severity
    return result.verdict is Verdict.FAIL and severity is not Severity.INFORMATIVE


def _remarks(report: Report) -> str:
    """What could not be judged and what is only worth knowing, a line each."""
    return "\n".join(
        f"{shown_verdict(result, report.rule(result.check).severity):4}  {_where(result)}  "
        f"{result.reason}"
        for result in report.results
        if result.verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE) and not _is_broken(report, result)
    )


def _where(result: Result) -> str:
    return f"{result.check} [{result.dialect}]" if result.dialect else result.check
