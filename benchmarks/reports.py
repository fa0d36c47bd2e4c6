"""A report as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from usarsim_bench.figures import Report, aimed, rows, summary


def as_markdown(report: Report) -> str:
    """Headings and tables; of several sections the aims stand together first. Ends with a line
    feed."""
    parts = ["# Measurements", _markdown_table(("Circumstance", ""), report.facts.items())]
    if len(report.sections) > 1 and (found := aimed(report)):
        parts += ["## All aims", _markdown_table(("What", "Measured", "Aim", ""), found)]
    for section in report.sections:
        parts.append(f"## {section.title}")
        if section.failure is not None:
            parts.append(f"FAILED: {section.failure}")
            continue
        parts.append(section.setting)
        if section.table:
            heads, *cases = section.table
            parts.append(_markdown_table(heads, cases))
        if section.figures:
            parts.append(_markdown_table(("Figure", "Value", "Unit", "Aim", ""), rows(section)))
    return "\n\n".join([*parts, summary(report)]) + "\n"


def _markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(_escape(cell) for cell in line) + " |" for line in lines)


def _escape(cell: str) -> str:
    return cell.replace("|", "\\|")
