"""A report for the terminal, as Markdown and as JSON."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Literal

from usarsim_bench.figures import Figure, Report, Section

_WIDTH = 100
_VERDICT = {True: "met", False: "MISSED", None: ""}


def as_text(report: Report) -> str:
    """Plain text with aligned columns; of several sections the aims stand together once more."""
    width = max(len(name) for name, _ in report.facts)
    parts = ["\n".join(f"{name.ljust(width)}  {value}" for name, value in report.facts)]
    for section in report.sections:
        setting = textwrap.fill(section.setting, _WIDTH)
        if section.table is not None:
            setting += f"\n{_columns((section.table.heads, *section.table.rows))}"
        if section.figures:
            setting += f"\n{_columns(_rows(section))}"
        parts.append(f"{section.title}\n{_failure(section) or setting}")
    if len(report.sections) > 1 and (aimed := _aimed(report, "key")):
        parts.append(f"All aims\n{_columns(aimed)}")
    return "\n\n".join([*parts, _summary(report)])


def as_markdown(report: Report) -> str:
    """Headings and tables; of several sections the aims stand together first. Ends with a line
    feed."""
    parts = ["# Measurements", _markdown_table(("Circumstance", ""), report.facts)]
    if len(report.sections) > 1 and (aimed := _aimed(report, "title")):
        parts += ["## All aims", _markdown_table(("What", "Measured", "Aim", ""), aimed)]
    for section in report.sections:
        parts.append(f"## {section.title}")
        if section.failure is not None:
            parts.append(_failure(section))
            continue
        parts.append(section.setting)
        if section.table is not None:
            parts.append(_markdown_table(section.table.heads, section.table.rows))
        if section.figures:
            parts.append(_markdown_table(("Figure", "Value", "Unit", "Aim", ""), _rows(section)))
    return "\n\n".join([*parts, _summary(report)]) + "\n"


def as_json(report: Report) -> str:
    """One JSON object; numbers that are not finite become null. Ends with a line feed."""
    document = {
        "taken": report.taken.isoformat(timespec="seconds"),
        "machine": asdict(report.machine),
        "sections": [
            {**asdict(section), "figures": [_figure(figure) for figure in section.figures]}
            for section in report.sections
        ],
        "missed": report.missed,
    }
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _figure(figure: Figure) -> dict[str, object]:
    return {
        "name": figure.name,
        "value": figure.value if math.isfinite(figure.value) else None,
        "unit": figure.unit,
        "aim": None if figure.aim is None else str(figure.aim),
        "met": figure.met,
    }


def _rows(section: Section) -> list[tuple[str, ...]]:
    return [
        (f.name, f.text, f.unit, "" if f.aim is None else str(f.aim), _VERDICT[f.met])
        for f in section.figures
    ]


def _aimed(report: Report, name: Literal["key", "title"]) -> list[tuple[str, str, str, str]]:
    """What has an aim, of all sections: what it is, value with unit, aim, verdict."""
    heads = [
        (section, section.key if name == "key" else section.title) for section in report.sections
    ]
    return [
        (f"{head}: {f.name}", f"{f.text} {f.unit}".rstrip(), str(f.aim), _VERDICT[f.met])
        for section, head in heads
        for f in section.figures
        if f.aim is not None
    ]


def _failure(section: Section) -> str:
    return "" if section.failure is None else f"FAILED: {section.failure}"


def _summary(report: Report) -> str:
    aims = sum(f.aim is not None for section in report.sections for f in section.figures)
    if not aims:
        return "No aims are set for these figures."
    return f"{aims - report.missed} of {aims} aims met."


def _columns(rows: Sequence[Sequence[str]]) -> str:
    """Aligned columns, the second one (values) to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        cells[1] = row[1].rjust(widths[1])
        lines.append("  " + "  ".join(cells).rstrip())
    return "\n".join(lines)


def _markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(_escape(cell) for cell in line) + " |" for line in lines)


def _escape(cell: str) -> str:
    return cell.replace("|", "\\|")
