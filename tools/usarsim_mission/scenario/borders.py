"""Where zones of different rules meet, and the blue bands that announce it.

The same borders by which the referee judges (`usarsim_mission.zones`), as areas that can be
painted: of each piece of an edge beyond which another rule holds, and robots can get there, the
rectangle that reaches so far to either side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from usarsim_mission.scoring import ZoneRule, ZoneRules
from usarsim_server.worlds.polygons import Corner, contains, sides

Area = tuple[str, str, Sequence[Corner]]
"""Name, colour and corners of a zone."""

_PIECE = 0.1
"""m of an edge that are looked at at a time."""
_BESIDE = 0.15
"""m to either side of an edge, where the rules are looked up."""
_SHORTEST = 0.3
"""m of a border that gets a band: a robot fits through."""


def derived_bands(
    zones: Sequence[Area],
    rules: ZoneRules,
    width: float,
    passes: Callable[[Corner, Corner], bool],
) -> list[tuple[Corner, ...]]:
    """The rectangles of all bands.

    Args:
        zones: those with a rule. rules: by colour.
        width: m that a band reaches to either side.
        passes: whether robots get from a place to one beside it.
    """
    found: list[tuple[Corner, ...]] = []
    seen: set[tuple[Corner, Corner]] = set()
    for _, _, corners in zones:
        for start, end in sides(corners):
            for one, other in _pieces(start, end, zones, rules, passes):
                ends = (_rounded(one), _rounded(other))
                if ends in seen or ends[::-1] in seen:
                    continue
                seen.add(ends)
                found.append(_rectangle(one, other, width))
    return found


def _pieces(
    start: Corner,
    end: Corner,
    zones: Sequence[Area],
    rules: ZoneRules,
    passes: Callable[[Corner, Corner], bool],
) -> Iterator[tuple[Corner, Corner]]:
    """The parts of an edge that robots can cross to where another rule holds."""
    (x0, y0), (x1, y1) = start, end
    length = math.hypot(x1 - x0, y1 - y0)
    count = max(1, round(length / _PIECE))
    ax, ay = (y0 - y1) / length * _BESIDE, (x1 - x0) / length * _BESIDE
    begin: int | None = None
    for number in range(count + 1):
        share = (number + 0.5) / count
        x, y = x0 + (x1 - x0) * share, y0 + (y1 - y0) * share
        crossed = number < count and (
            _rule(x + ax, y + ay, zones, rules) != _rule(x - ax, y - ay, zones, rules)
            and passes((x + ax, y + ay), (x - ax, y - ay))
        )
        if crossed and begin is None:
            begin = number
        elif not crossed and begin is not None:
            if (number - begin) / count * length >= _SHORTEST:
                yield _between(start, end, begin / count), _between(start, end, number / count)
            begin = None


def _rule(x: float, y: float, zones: Sequence[Area], rules: ZoneRules) -> ZoneRule:
    place = np.array([[x, y]])
    colour = next((colour for _, colour, area in zones if contains(area, place)[0]), None)
    return rules.of(colour)


def _between(start: Corner, end: Corner, share: float) -> Corner:
    return start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share


def _rectangle(one: Corner, other: Corner, width: float) -> tuple[Corner, ...]:
    (x0, y0), (x1, y1) = one, other
    length = math.hypot(x1 - x0, y1 - y0)
    ax, ay = (y0 - y1) / length * width, (x1 - x0) / length * width
    corners = ((x0 - ax, y0 - ay), (x1 - ax, y1 - ay), (x1 + ax, y1 + ay), (x0 + ax, y0 + ay))
    return tuple(map(_rounded, corners))


def _rounded(place: Corner) -> Corner:
    return round(place[0], 3) + 0.0, round(place[1], 3) + 0.0
