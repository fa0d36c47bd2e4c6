"""Several servers side by side, from the JSON of their reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from usarsim_conformance.report import Report
from usarsim_conformance.terminal import shown_verdict
from usarsim_conformance.verdicts import Verdict


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
