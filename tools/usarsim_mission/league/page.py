"""The page of a league: ranks with the spread of points, all matches, what the points are made of.

One HTML file without network. Runs are linked where their reports lie.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from usarsim_mission.league.gathering import Played
from usarsim_mission.league.standings import Entry, League, Standing
from usarsim_mission.look import facts, number, page, table

REPORT = "report.html"
_TOLD = (
    ("VF", "Found", 1),
    ("VC", "Credited", 1),
    ("A", "Floor", 2),
    ("M", "Map", 2),
    ("T", "Time left", 2),
    ("FM", "Wrong marks", 1),
    ("C", "Victims touched", 1),
    ("K", "Collisions", 1),
    ("L", "Robots lost", 1),
)
"""Variables of the rules that are told of each team, and their decimals."""


def league_page(league: League, folder: Path) -> str:
    """The page.

    Args:
        league: of which. folder: in which it will lie; links are seen from there.
    """
    return page("League", _parts(league, folder))


def _parts(league: League, folder: Path) -> Iterator[str]:
    yield "<h1>League</h1>"
    missions = ", ".join(league.missions) or "no match that all teams have"
    rules = ", ".join(league.rules)
    yield f'<p class="quiet">{escape(missions)}, scored by {escape(rules)}</p>'
    apart = sum(len(one.apart) for row in league.standings for one in row.entries.values())
    runs = sum(len(one.counted) for row in league.standings for one in row.entries.values())
    missing = sum(len(league.matches) - row.played for row in league.standings)
    best = [row.team for row in league.standings if row.rank == 1]
    yield facts(
        [
            ("first" if len(best) < 2 else "first, with equal points", escape(", ".join(best)))
            if best
            else ("no team has played all matches", "–"),
            ("teams", str(len(league.standings))),
            ("matches", str(len(league.matches))),
            ("runs that count", str(runs)),
            ("matches missing", str(missing)),
            ("runs that do not count", str(apart)),
        ]
    )
    if league.dropped:
        listed = escape(", ".join(map(str, league.dropped)))
        yield f'<p class="warn">Left out, as some team has not played them: {listed}.</p>'
    yield "<h2>Ranks</h2>" + _ranks(league)
    yield f'<p class="quiet small">{_explained(league)}</p>'
    if league.matches:
        yield "<h2>Matches</h2>" + _matches(league, folder)
    yield "<h2>What the points are made of</h2>" + _values(league)
    yield '<p class="quiet small">Means of all runs that count; floor, map and time from 0 to 1.'
    if flawed := _flawed(league, folder):
        yield "<h2>Runs that were not whole</h2>" + flawed


def _ranks(league: League) -> str:
    """A row per team, with a dot for each match on an axis that all rows share."""
    points = [
        entry.points
        for row in league.standings
        for entry in row.entries.values()
        if entry.points is not None
    ]
    low, high = min((0.0, *points)), max((1.0, *points))
    places = league.by == "places"
    heads = ["", "Team", *(["Mean place"] if places else []), "Mean points", "Spread"]
    heads += [f"{number(low, 0)} to {number(high, 0)} points", "Won", "Played"]
    rows = []
    for row in league.standings:
        of = len(league.matches)
        played = f"{row.played} of {of}"
        rows.append(
            [
                '<span class="none">–</span>' if row.rank is None else str(row.rank),
                f"<b>{escape(row.team)}</b>",
                *([number(row.score, 2)] if places else []),
                number(row.mean),
                "" if row.deviation is None else f"± {number(row.deviation)}",
                _strip(row, low, high),
                str(row.won),
                played if row.played == of else f'<span class="less">{played}</span>',
            ]
        )
    right = [at for at, head in enumerate(heads) if head in ("Mean place", "Mean points", "Won")]
    return table(heads, rows, right)


def _strip(row: Standing, low: float, high: float) -> str:
    """The points of all matches as dots, and their mean as a line."""

    def x(value: float) -> float:
        return 8.0 + 304.0 * (value - low) / (high - low)

    told = [(match, one.points) for match, one in row.entries.items() if one.points is not None]
    dots = "".join(
        f'<circle cx="{x(points):.1f}" cy="12" r="4" fill="#0b5c8f" fill-opacity=".45">'
        f"<title>{escape(str(match))}: {number(points)}</title></circle>"
        for match, points in told
    )
    mean = ""
    if row.mean is not None:
        place = f"{x(row.mean):.1f}"
        mean = f'<line x1="{place}" x2="{place}" y1="3" y2="21" stroke="#1f2328" stroke-width="2"/>'
    said = "no points" if row.mean is None else f"points of {len(told)} matches"
    return (
        f'<svg viewBox="0 0 320 24" style="width:20rem;max-width:40vw" role="img" '
        f'aria-label="{said}"><line x1="8" x2="312" y1="12" y2="12" stroke="#dcdfe3"/>'
        f'<line x1="{x(0.0):.1f}" x2="{x(0.0):.1f}" y1="7" y2="17" stroke="#5f6871"/>'
        f"{dots}{mean}</svg>"
    )


def _explained(league: League) -> str:
    what = "points" if league.by == "points" else "places, as missions have different rules"
    return (
        f"Ranked by the mean of {what}; equals share a rank. A dot is a match, the line the mean, "
        "the short one 0. A team that has not played all matches has no rank: what is missing is "
        "not 0 points."
    )


def _matches(league: League, folder: Path) -> str:
    """A row per match, a column per team; the best is set off by weight and a star."""
    heads = ["Match", *(row.team for row in league.standings)]
    rows = [
        [escape(str(match)), *(_cell(row.entries[match], folder) for row in league.standings)]
        for match in league.matches
    ]
    return table(heads, rows, range(1, len(heads)))


def _cell(entry: Entry, folder: Path) -> str:
    if entry.points is None:
        why = ", ".join(dict.fromkeys(run.flaw for run in entry.apart)) or "missing"
        return f'<span class="none">{escape(why)}</span>'
    text = number(entry.points)
    if len(entry.counted) == 1:
        text = _linked(text, entry.counted[0], folder)
    else:
        text += f' <span class="quiet">({len(entry.counted)} runs)</span>'
    flawed = "†" if any(run.flaw for run in entry.counted) else ""
    star = '<span class="best" title="best">★ </span>' if entry.place == 1 else ""
    return f"{star}{text}{flawed}"


def _linked(text: str, run: Played, folder: Path) -> str:
    report = run.folder / REPORT
    if not report.is_file():
        return text
    path = Path(os.path.relpath(report, folder)).as_posix()
    return f'<a href="{escape(quote(path))}">{text}</a>'


def _values(league: League) -> str:
    """A row per team with the means of what the rules count."""
    told: Sequence[tuple[str, str, int]] = [
        one for one in _TOLD if any(row.values.get(one[0]) for row in league.standings)
    ]
    rows = [
        [escape(row.team), *(number(row.values.get(key), digits) for key, _, digits in told)]
        for row in league.standings
    ]
    return table(["Team", *(head for _, head, _ in told)], rows, range(1, len(told) + 1))


def _flawed(league: League, folder: Path) -> str:
    """What was cut off or ended by an error, whether it counts or not; empty if nothing was."""
    rows = []
    for row in league.standings:
        for match, entry in row.entries.items():
            for run in (*entry.counted, *entry.apart):
                if run.flaw:
                    counts = "yes" if run in entry.counted else "no"
                    points = _linked(number(run.points), run, folder)
                    cells = (match, row.team, run.flaw)
                    rows.append([*(escape(str(one)) for one in cells), points, counts])
    heads = ("Match", "Team", "Why", "Points until then", "Counts")
    return table(heads, rows, (3,)) if rows else ""
