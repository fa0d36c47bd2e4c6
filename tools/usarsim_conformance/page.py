"""A report, or several side by side, as one HTML page that needs no other file."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from usarsim_conformance.report import Report, Rule
from usarsim_conformance.terminal import shown_verdict, summary
from usarsim_conformance.verdicts import Result

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
