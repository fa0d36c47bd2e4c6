"""Ranks teams by what they did in the matches that they played.

A match is a seed of a mission. What a team has there is the mean of its runs that count; a match
without one is missing, which is not 0 points: a team that has not played all matches has no rank,
and its mean is told beside. Ranks are those of competitions: equals share one, and the next is
skipped (1, 1, 3).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from usarsim_mission.league.gathering import Gathered, Match, Played

By = Literal["points", "places"]
_DIGITS = 9
"""Decimals to which scores are told: what is equal in them is a tie."""


@dataclass(frozen=True, slots=True)
class Entry:
    """What a team has in one match.

    Attributes:
        points: mean of the runs that count; None if there is none.
        place: by points in this match, equals share; None without points.
        counted: runs that count. apart: runs that do not.
    """

    points: float | None
    place: int | None
    counted: tuple[Played, ...] = ()
    apart: tuple[Played, ...] = ()


@dataclass(frozen=True, slots=True)
class Standing:
    """A team in the table.

    Attributes:
        rank: None if matches are missing.
        score: by which it is ranked: mean of points, or of places. None if it has none.
        mean, deviation, least, most: of its points by match; None where there are too few.
        won: matches of whose best it is one. played: matches that it has.
        values: means of the variables of the rules over its runs that count.
    """

    team: str
    rank: int | None
    score: float | None
    mean: float | None
    deviation: float | None
    least: float | None
    most: float | None
    won: int
    played: int
    entries: Mapping[Match, Entry] = field(repr=False)
    values: Mapping[str, float] = field(repr=False)


@dataclass(frozen=True, slots=True)
class League:
    """The whole table.

    Attributes:
        by: what decides. matches: that count. dropped: that do not, as some team lacks them.
    """

    by: By
    standings: tuple[Standing, ...]
    matches: tuple[Match, ...]
    dropped: tuple[Match, ...]
    runs: tuple[Played, ...]
    rules: tuple[str, ...]

    @property
    def missions(self) -> tuple[str, ...]:
        """Names of all missions."""
        return tuple(dict.fromkeys(match.mission for match in self.matches))


def rank(
    gathered: Gathered, *, by: By | None = None, common: bool = False, flawed: bool = False
) -> League:
    """The table of a league.

    Args:
        gathered: all runs.
        by: `points`: the mean of points; `places`: the mean of places, which compares missions
            of different rules. None: points if all matches have the same rules.
        common: only matches count that every team has.
        flawed: runs count that were cut off or ended by an error.
    """
    rules = tuple(dict.fromkeys(run.rules for run in gathered.runs))
    decides: By = by or ("points" if len(rules) <= 1 else "places")
    table = {match: _entries(match, gathered, flawed) for match in gathered.matches}
    matches = gathered.matches
    if common:
        matches = tuple(
            match for match in matches if all(one.counted for one in table[match].values())
        )
    dropped = tuple(match for match in gathered.matches if match not in matches)
    rows = [
        _standing(team, {match: table[match][team] for match in matches}, decides)
        for team in gathered.teams
    ]
    return League(decides, _ranked(rows, decides), matches, dropped, gathered.runs, rules)


def _entries(match: Match, gathered: Gathered, flawed: bool) -> dict[str, Entry]:
    """What each team has in a match."""
    found: dict[str, Entry] = {}
    for team in gathered.teams:
        runs = [run for run in gathered.runs if run.team == team and run.match == match]
        counted = tuple(run for run in runs if flawed or not run.flaw)
        apart = tuple(run for run in runs if run not in counted)
        points = round(_mean([run.points for run in counted]), _DIGITS) if counted else None
        found[team] = Entry(points, None, counted, apart)
    places = _places([one.points for one in found.values()], most=True)
    return {
        team: Entry(one.points, place, one.counted, one.apart)
        for (team, one), place in zip(found.items(), places, strict=True)
    }


def _standing(team: str, entries: Mapping[Match, Entry], by: By) -> Standing:
    """A team's row, without its rank."""
    points = [one.points for one in entries.values() if one.points is not None]
    places = [float(one.place) for one in entries.values() if one.place is not None]
    told = points if by == "points" else places
    runs = [run for one in entries.values() for run in one.counted]
    mean = _mean(points) if points else None
    spread = None
    if mean is not None and len(points) > 1:
        spread = math.sqrt(math.fsum((one - mean) ** 2 for one in points) / (len(points) - 1))
    names = runs[0].values if runs else {}
    return Standing(
        team,
        None,
        round(_mean(told), _DIGITS) if told else None,
        mean,
        spread,
        min(points, default=None),
        max(points, default=None),
        sum(one.place == 1 for one in entries.values()),
        len(points),
        entries,
        {name: _mean([run.values[name] for run in runs]) for name in names},
    )


def _ranked(rows: Sequence[Standing], by: By) -> tuple[Standing, ...]:
    """Rows with ranks, best first; below those without one, by what they have."""
    whole = [row for row in rows if row.entries and row.played == len(row.entries)]
    ranks = _places([row.score for row in whole], most=by == "points")
    placed = [replace(row, rank=one) for row, one in zip(whole, ranks, strict=True)]
    rest = [row for row in rows if row not in whole]
    sign = -1.0 if by == "points" else 1.0

    def order(row: Standing) -> tuple[int, int, float, str]:
        score = math.inf if row.score is None else sign * row.score
        return row.rank or 0, -row.played, score, row.team.casefold()

    return (*sorted(placed, key=order), *sorted(rest, key=order))


def _places(values: Sequence[float | None], *, most: bool) -> list[int | None]:
    """The place of each value among those that there are: one more than how many are better."""
    known = [one for one in values if one is not None]

    def place(value: float) -> int:
        return 1 + sum(other > value if most else other < value for other in known)

    return [None if value is None else place(value) for value in values]


def _mean(values: Iterable[float]) -> float:
    several = list(values)
    return math.fsum(several) / len(several)
