"""The numbers of a report in files: tidy CSV, and LaTeX for a paper."""

from __future__ import annotations

from collections.abc import Iterator

from usarsim_exploration.measures import MEASURES
from usarsim_exploration.reporting.comparison import GOALS, Cell, Comparison, title
from usarsim_exploration.reporting.runs import Setting
from usarsim_report.wording import number
from usarsim_server.base.csv_files import Cellular, csv_text

_HEADS = (
    "environment", "robots", "team", "radio", "backend", "strategy", "measure", "unit", "runs",
    "with_value", "mean", "interval_low", "interval_high", "sd", "median",
    "quartile_low", "quartile_high", "horizon",
)  # fmt: skip
_TEX = (*GOALS, "base_area")
"""Columns of the table of a paper."""
_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
}  # fmt: skip


def table_csv(found: Comparison) -> str:
    """A row for each setting, strategy and measure."""

    def rows() -> Iterator[list[Cellular]]:
        for group in found.groups:
            place = _place(group.setting)
            for cell in group.cells.values():
                one = cell.interval
                ends = (None, None) if one is None else (one.low, one.high)
                yield [
                    *place, cell.strategy, cell.measure, MEASURES[cell.measure].unit, cell.runs,
                    cell.reached, cell.mean, *ends, cell.sd,
                    cell.median, cell.low, cell.high, cell.horizon,
                ]  # fmt: skip

    return csv_text(_HEADS, rows())


def runs_csv(found: Comparison) -> str:
    """A row for each run, those that failed too, with all its measures."""
    runs = [run for source in found.sources for run in source.runs]
    told = {name for run in runs for name in run.measures}
    names = [name for name in MEASURES if name in told] + sorted(told - set(MEASURES))
    heads = (
        "source",
        "environment",
        "robots",
        "team",
        "radio",
        "backend",
        "strategy",
        "seed",
        "ended",
        "step",
    )
    rows = (
        [
            run.source, *_place(run.setting), run.strategy, run.seed, run.ended,
            None if run.error else run.step, " ".join(run.error.split()),
            *(run.measures.get(name) for name in names),
        ]
        for run in runs
    )  # fmt: skip
    return csv_text((*heads, "error", *names), rows)


def _place(setting: Setting) -> tuple[Cellular, ...]:
    team = setting.team or str(setting.robots)
    return setting.environment, setting.robots, team, setting.radio, setting.backend


def table_tex(found: Comparison) -> str:
    r"""A `tabular` with the rules of booktabs: means with 95 % intervals, and who reached goals."""
    lines = [
        "% needs \\usepackage{booktabs}; times in steps, restricted means where runs missed a goal",
        rf"\begin{{tabular}}{{l{'r' * len(_TEX)}}}",
        r"\toprule",
        " & ".join(["Strategy", *(_escaped(title(name)) for name in _TEX)]) + r" \\",
    ]
    for group in found.groups:
        lines.append(r"\midrule")
        place = _escaped(str(group.setting))
        lines.append(rf"\multicolumn{{{len(_TEX) + 1}}}{{l}}{{\emph{{{place}}}}} \\")
        for strategy in group.runs:
            cells = [group.cells.get((name, strategy)) for name in _TEX]
            lines.append(" & ".join([_escaped(strategy), *map(_tex, cells)]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _tex(cell: Cell | None) -> str:
    if cell is None:
        return "--"
    if cell.mean is None:
        return f"-- ({cell.reached}/{cell.runs})"
    text = _number(cell.mean)
    if cell.interval is not None:
        scale = max(abs(cell.interval.low), abs(cell.interval.high))
        ends = _number(cell.interval.low, scale), _number(cell.interval.high, scale)
        text += f" [{ends[0]}, {ends[1]}]"
    return text if cell.reached == cell.runs else f"{text} ({cell.reached}/{cell.runs})"


def _number(value: float, scale: float | None = None) -> str:
    return number(value, scale).replace("−", "$-$")


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(one, one) for one in text)
