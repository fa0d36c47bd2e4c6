"""The report of a run: one HTML file without network, drawn from the logs alone; beside it its plan
as a picture of its own, and one row of numbers for a sheet.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

from usarsim_mission.errors import RunLogError
from usarsim_mission.league.gathering import flaw_of
from usarsim_mission.look import COLOURS, facts, number, page, table
from usarsim_mission.match import floor_plan, standing, timeline
from usarsim_mission.match.drawn import Drawn
from usarsim_mission.model import Mission, World
from usarsim_mission.runlog import RunFolder
from usarsim_mission.scoring import VARIABLES, Rules
from usarsim_server.base.csv_files import csv_text
from usarsim_server.base.errors import at
from usarsim_server.base.files import reason, write_text

REPORT, PLAN, SUMMARY = "report.html", "plan.svg", "summary.csv"
WORDS = {
    "VF": "victims found",
    "VC": "victims credited",
    "ID": "victims named",
    "ST": "statuses told rightly",
    "LO": "victims located",
    "FM": "wrong marks",
    "A": "floor seen",
    "M": "map",
    "T": "time left",
    "C": "victims touched",
    "K": "collisions",
    "L": "robots lost",
    "B": "bonus",
}
"""Variables of the rules as a report calls them; V and N only divide."""
_ENDS = {
    "time": "the time was over",
    "operator": "ended by the operator",
    "all_found": "all victims were credited",
}


def write_report(folder: Path, result: dict[str, Any]) -> Path:
    """Write `report.html`, `plan.svg` and `summary.csv` of a run; returns the first.

    Args:
        folder: of the run. result: what its `score.json` tells.

    Raises:
        RunLogError: the logs cannot be read, or it cannot be written.
    """
    run, drawn = RunFolder(folder), Drawn()
    mission, world = run.world()
    rules = run.rules()
    for record in run.records():
        drawn.take(record)
    drawn.end()
    title = world.title or mission.name
    rows = {row["name"]: row for row in result["victims"]}
    plan = floor_plan.floor_plan(world, drawn, rows)
    contents = {
        REPORT: page(title, _parts(title, mission, rules, world, drawn, plan, result)),
        PLAN: plan.replace(
            "<svg ", '<svg xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" ', 1
        ),
        SUMMARY: summary(result, str(drawn.session.get("team") or "")),
    }
    for name, text in contents.items():
        try:
            write_text(folder / name, text)
        except OSError as error:
            cure = "make room on the disk"
            raise RunLogError(
                at(folder / name, f"cannot be written: {reason(error)}", cure)
            ) from None
    return folder / REPORT


def summary(result: dict[str, Any], team: str) -> str:
    """One row of CSV, with its heads; what is not known is empty.

    Args:
        result: what `score.json` tells. team: who played.
    """
    ended, values = result["ended"], result["values"]
    lasted = None
    if ended["t_sim"] is not None and ended["began"] is not None:
        lasted = round(ended["t_sim"] - ended["began"], 6)
    row = {key: result[key] for key in ("mission", "seed", "rules")}
    row |= {"team": team, "points": result["total"], "flaw": flaw_of(result) or None}
    row |= {"ended": ended["why"], "lasted_s": lasted, "time_limit_s": result["time_limit"]}
    row |= {"area_team": result["area"]["team"], "area_base": result["area"]["base"]}
    row |= {"map_error_m": result["map"]["error"], "map_share": result["map"]["share"]} | values
    return csv_text(row, [row.values()])


def _parts(
    title: str,
    mission: Mission,
    rules: Rules,
    world: World,
    drawn: Drawn,
    plan: str,
    result: dict[str, Any],
) -> Iterator[str]:
    ended = result["ended"]
    began = ended["began"] if ended["began"] is not None else 0.0
    over = ended["t_sim"] if ended["t_sim"] is not None else drawn.last
    yield f"<h1>{escape(title)}</h1>"
    team = drawn.session.get("team")
    told = [f"Team {team}" if team else "", f"mission {mission.name}, seed {mission.seed}"]
    told += [f"scored by {rules.name}", _ENDS.get(str(ended["why"]), "")]
    told.append(f"{over - began:.0f} of {result['time_limit']:g} s")
    yield f'<p class="quiet">{escape(" · ".join(one for one in told if one))}</p>'
    if flaw := flaw_of(result):
        why = next((words for _, words in reversed(drawn.events)), "")
        why = f" ({why})" if why and ended["why"] in ("error", "aborted") else ""
        yield f'<p class="warn"><b>This run is not whole:</b> {escape(flaw + why)}. '
        yield "The numbers are those until then, and it counts in no league.</p>"
    yield _glance(result)
    numbers = {one.name: place for place, one in enumerate(world.victims, start=1)}
    yield "<h2>Where everybody was</h2><figure>" + plan
    yield f"<figcaption>{floor_plan.legend(drawn)}</figcaption></figure>"
    yield "<h2>When it happened</h2>"
    if ended["began"] is None:
        yield '<p class="quiet">The trial did not begin.</p>'
    else:
        yield "<figure>" + timeline.timeline(drawn, began, numbers)
        yield f"<figcaption>{timeline.legend(drawn)}</figcaption></figure>"
    if drawn.events:
        cells = [[number(time - began), escape(words)] for time, words in drawn.events]
        yield table(("At, s", "What happened"), cells)
    yield "<h2>What the points are made of</h2>" + _made_of(rules, result)
    yield "<h2>Victims</h2>" + _victims(result, numbers, began)
    yield "<h2>Robots</h2>" + _robots(drawn, result, over - began)
    yield _stood(drawn, began)


def _glance(result: dict[str, Any]) -> str:
    values = result["values"]
    return facts(
        [
            ("points", number(result["total"], 2)),
            ("victims found", f"{values['VF']:g} of {values['V']:g}"),
            ("credited", f"{values['VC']:g}"),
            ("of the floor seen", f"{100 * result['area']['team']:.0f} %"),
            ("of the walls mapped", f"{100 * result['map']['share']:.0f} %"),
            ("wrong marks", f"{values['FM']:g}"),
            ("victims touched", f"{values['C']:g}"),
            ("collisions", f"{values['K']:g}"),
            ("robots lost", f"{values['L']:g}"),
        ]
    )


def _made_of(rules: Rules, result: dict[str, Any]) -> str:
    """The parts that the rules add up, as bars to either side of 0."""
    parts: dict[str, float] = {}
    for names, points in rules.made_of(result["values"]):
        words = " × ".join(word for key, word in WORDS.items() if key in names) or "always"
        parts[words] = parts.get(words, 0.0) + points
    low, high = min((0.0, *parts.values())), max((0.0, *parts.values()))
    span = (high - low) or 1.0
    rows = []
    for words, points in parts.items():
        left, wide = 100.0 * (min(points, 0.0) - low) / span, 100.0 * abs(points) / span
        ink, zero = "#b3561e" if points < 0.0 else "#0b5c8f", f"{-100 * low / span:.2f}"
        bar = (
            f'<svg viewBox="0 0 100 6" preserveAspectRatio="none" aria-hidden="true" '
            f'style="height:.95rem"><rect x="{left:.2f}" width="{wide:.2f}" y="0" height="6" '
            f'fill="{ink}"/><line x1="{zero}" x2="{zero}" y1="0" y2="6" stroke="#1f2328" '
            'stroke-width=".3"/></svg>'
        )
        rows.append([escape(words), number(points, 2), bar])
    rows.append(["<b>total</b>", f"<b>{number(result['total'], 2)}</b>", ""])
    codes = [
        [key, escape(VARIABLES[key][1]), f"{value:.4g}"] for key, value in result["values"].items()
    ]
    return (
        table(("Part", "Points", ""), rows, (1,))
        + f'<p class="quiet small">points = {escape(rules.expression.text)}</p>'
        + table(("Code", "Means", "Here"), codes, (2,))
    )


def _victims(result: dict[str, Any], numbers: dict[str, int], began: float) -> str:
    rows = []
    for row in sorted(result["victims"], key=lambda one: numbers.get(one["name"], 0)):
        found = row["found"]
        rows.append(
            [
                str(numbers.get(row["name"], "")),
                escape(row["name"]),
                number(row["t_sim"] - began) if found else '<span class="none">not found</span>',
                escape(row["robot"] or ""),
                ("yes" if row["credited"] else '<span class="less">no</span>') if found else "",
                escape(row["why"] or ""),
            ]
        )
    return table(("", "Victim", "Found at, s", "By", "Credited", "Why"), rows, (2,))


def _stood(drawn: Drawn, began: float) -> str:
    """When robots stood, and why."""
    rows = [
        [escape(name), number(one.begins - began), number(one.ends - one.begins), escape(one.why)]
        for name, robot in drawn.robots.items()
        for one in robot.standing.spans
    ]
    rule = f"within {standing.NEAR:g} m for {standing.LONG:g} s"
    if not rows:
        return f'<p class="quiet">No robot stood ({rule}).</p>'
    heads = ("Robot", "From, s", "For, s", "Why")
    return f"<h3>When they stood, and why ({rule})</h3>" + table(heads, rows, (1, 2))


def _robots(drawn: Drawn, result: dict[str, Any], lasted: float) -> str:
    rows = []
    lost = result.get("lost") or {}
    for place, (name, robot) in enumerate(drawn.robots.items()):
        driven = sum(
            (one.ends or drawn.last) - one.begins
            for one in robot.modes
            if one.kind == "teleoperated"
        )
        sign = f'<span style="color:{COLOURS[place % len(COLOURS)]}">&#9632;</span> '
        share = lasted or 1.0
        rows.append(
            [
                sign + escape(name),
                escape(robot.kind),
                number(robot.way),
                f"{100 * min(robot.moving / share, 1.0):.0f} %",
                f"{100 * min(driven / share, 1.0):.0f} %",
                str(sum(row["robot"] == name and row["found"] for row in result["victims"])),
                str(sum(not victim for _, victim in robot.touches)),
                str(sum(victim for _, victim in robot.touches)),
                escape(str(lost.get(name, ""))),
            ]
        )
    heads = ("Robot", "Class", "Way, m", "Moving", "Driven by hand", "Found", "Collisions")
    return table((*heads, "Victims touched", "Lost"), rows, range(2, 8))
