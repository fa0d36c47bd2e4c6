"""Reports as people and machines read them: in a terminal, as an HTML page that needs no other
file, as JUnit XML, and several servers side by side."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from typing import TextIO
from xml.etree import ElementTree

from usarsim_conformance.registry import Check, Result, Severity, Verdict
from usarsim_conformance.report import Report, Rule
from usarsim_conformance.runner import Progress

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


class ProgressPrinter:
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


_STYLE = """
:root { --ink: #1c2430; --paper: #fff; --line: #d9dee5; --soft: #f4f6f8; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e2e7ee; --paper: #14181e; --line: #343c47; --soft: #1d232b; }
}
body { margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: var(--ink);
  background: var(--paper); font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
table { border-collapse: collapse; width: 100%; }
th, td { border: 1px solid var(--line); padding: .25rem .5rem; text-align: left;
  vertical-align: top; }
thead th { position: sticky; top: 0; background: var(--soft); }
td.v { text-align: center; width: 6rem; font-weight: 600; }
td.v a { color: inherit; }
.pass { background: #2e7d3222; color: #2e7d32; } .FAIL { background: #c6282833; color: #c62828; }
.na { color: #8892a0; } .doubt { background: #ef6c0033; color: #ef6c00; }
.note { background: #1565c022; color: #1565c0; }
code, pre { font: 12px/1.4 ui-monospace, monospace; }
pre { background: var(--soft); padding: .75rem; overflow-x: auto; white-space: pre-wrap;
  overflow-wrap: anywhere; }
.rule { color: #8892a0; font-size: 13px; }
"""
_CLASSES = {"n/a": "na", "??": "doubt"}


def as_page(reports: Sequence[Report], title: str) -> str:
    """The page: facts, a matrix of rules by server and dialect, and every finding in full."""
    columns = [(report, dialect) for report in reports for dialect in report.dialects]
    rules = {rule.id: rule for report in reports for rule in report.rules}
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1>",
        *(_facts(report) for report in reports),
        _matrix(columns, list(rules.values())),
        *(_findings(number, report) for number, report in enumerate(reports)),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _facts(report: Report) -> str:
    rows = {"taken": f"{report.taken:%Y-%m-%d %H:%M} UTC", **report.server}
    cells = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows.items()
    )
    told = escape(summary(report)).replace("\n", "<br>")
    return f"<h2>{escape(report.name)}</h2><p>{told}</p><table><tbody>{cells}</tbody></table>"


def _matrix(columns: Sequence[tuple[Report, str]], rules: Sequence[Rule]) -> str:
    several = len({report.name for report, _ in columns}) > 1 or len(columns) > 3
    heads = "".join(
        f"<th>{escape(report.name) + '<br>' if several else ''}{escape(dialect)}</th>"
        for report, dialect in columns
    )
    reports = list({id(report): report for report, _ in columns}.values())
    rows = "".join(_row(rule, columns, reports) for rule in rules)
    return (
        "<h2>Rules</h2><table><thead><tr><th>Rule</th><th>Severity</th>"
        f"{heads}</tr></thead><tbody>{rows}</tbody></table>"
    )


def _row(rule: Rule, columns: Sequence[tuple[Report, str]], reports: list[Report]) -> str:
    cells = "".join(
        _cell(rule, report.of(rule.id, dialect) or report.of(rule.id, ""), reports.index(report))
        for report, dialect in columns
    )
    return (
        f"<tr><td><code>{escape(rule.id)}</code> {escape(rule.title)}"
        f'<div class="rule">{escape(rule.rule)} ({escape(rule.source)})</div></td>'
        f"<td>{rule.severity.value}</td>{cells}</tr>"
    )


def _cell(rule: Rule, result: Result | None, number: int) -> str:
    if result is None:
        return '<td class="v na">&ndash;</td>'
    word = shown_verdict(result, rule.severity)
    kind = _CLASSES.get(word, word)
    hint = f' title="{escape(result.reason)}"' if result.reason else ""
    text = escape(word)
    if result.transcript:
        text = f'<a href="#{_anchor(number, result)}">{text}</a>'
    return f'<td class="v {kind}"{hint}>{text}</td>'


def _findings(number: int, report: Report) -> str:
    found = [one for one in report.results if one.reason or one.transcript]
    if not found:
        return ""
    parts = [f"<h2>Findings: {escape(report.name)}</h2>"]
    for result in found:
        rule = report.rule(result.check)
        word = shown_verdict(result, rule.severity)
        dialect = f" [{escape(result.dialect)}]" if result.dialect else ""
        transcript = escape("\n".join(result.transcript))
        parts.append(
            f'<details id="{_anchor(number, result)}"{" open" if word == "FAIL" else ""}>'
            f'<summary><b class="{_CLASSES.get(word, word)}">{escape(word)}</b> '
            f"<code>{escape(result.check)}</code>{dialect}: {escape(result.reason)}</summary>"
            f"<p>{escape(rule.rule)} ({escape(rule.source)})</p>"
            f"<pre>{transcript}</pre></details>"
        )
    return "\n".join(parts)


def _anchor(number: int, result: Result) -> str:
    return f"r{number}-{result.check}-{result.dialect or 'any'}"


# XML 1.0, production 2: what may not stand in a document at all.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_junit(report: Report) -> str:
    """One test suite for each dialect, one test case for each verdict.

    Broken rules are failures, informative ones only notes; what could not be judged is an error,
    what does not apply is skipped.
    """
    root = ElementTree.Element("testsuites", name="usarsim conformance")
    severities = {rule.id: rule.severity for rule in report.rules}
    for dialect in (*report.dialects, ""):
        results = [one for one in report.results if one.dialect == dialect]
        if not results:
            continue
        suite = ElementTree.SubElement(root, "testsuite", name=dialect or "any dialect")
        counts = {"failures": 0, "errors": 0, "skipped": 0}
        for result in results:
            service, _, name = result.check.partition(".")
            case = ElementTree.SubElement(
                suite,
                "testcase",
                classname=f"{dialect or 'any'}.{service}",
                name=name,
                time=f"{result.seconds:.3f}",
            )
            kind = _kind(result.verdict, severities[result.check])
            if kind is None:
                continue
            tag, counter = kind
            counts[counter] += 1
            note = ElementTree.SubElement(case, tag, message=_clean(result.reason))
            if tag != "skipped":
                note.text = _clean("\n".join(result.transcript))
        suite.set("tests", str(len(results)))
        for name, count in counts.items():
            suite.set(name, str(count))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _kind(verdict: Verdict, severity: Severity) -> tuple[str, str] | None:
    if verdict is Verdict.PASS:
        return None
    if verdict is Verdict.FAIL and severity is not Severity.INFORMATIVE:
        return "failure", "failures"
    return ("error", "errors") if verdict is Verdict.INCONCLUSIVE else ("skipped", "skipped")


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("?", text)


def named_apart(reports: Sequence[Report]) -> list[Report]:
    """The reports with names that differ: a number is put behind a name that was there before."""
    seen: dict[str, int] = {}
    found = []
    for report in reports:
        seen[report.name] = seen.get(report.name, 0) + 1
        count = seen[report.name]
        found.append(replace(report, name=f"{report.name} ({count})") if count > 1 else report)
    return found


def compare(reports: Sequence[Report]) -> str:
    """A table of the checks on which the servers differ, and the counts of each."""
    columns = [(report, dialect) for report in reports for dialect in report.dialects]
    heads = ["", *(f"{report.name} {dialect}" for report, dialect in columns)]
    ids = list(dict.fromkeys(rule.id for report in reports for rule in report.rules))
    rows = [[id, *(_word(report, id, dialect) for report, dialect in columns)] for id in ids]
    differing = [row for row in rows if len(set(row[1:]) - {"-"}) > 1]
    counts = [
        [verdict.value, *(str(_count(report, dialect, verdict)) for report, dialect in columns)]
        for verdict in Verdict
    ]
    widths = [
        max(len(row[column]) for row in [heads, *differing, *counts])
        for column in range(len(heads))
    ]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in [heads, *differing, [""] * len(heads), *counts]
    ]
    same = len(rows) - len(differing)
    return "\n".join(
        [*lines, "", f"{same} of {len(rows)} checks have the same verdict everywhere."]
    )


def _word(report: Report, id: str, dialect: str) -> str:
    result = report.of(id, dialect) or report.of(id, "")
    return "-" if result is None else shown_verdict(result, report.rule(id).severity)


def _count(report: Report, dialect: str, verdict: Verdict) -> int:
    return sum(
        result.verdict is verdict and result.dialect in (dialect, "") for result in report.results
    )
