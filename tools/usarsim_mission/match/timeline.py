"""A run over its time, as one SVG: points and finds, and below what each robot did."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from html import escape

from usarsim_mission.look import COLOURS, number
from usarsim_mission.match.drawn import Drawn, Way

_LEFT, _RIGHT, _TOP, _HIGH, _ROW = 88.0, 975.0, 34.0, 190.0, 30.0
X = Callable[[float], float]
"""Where a time is."""
_STEPS = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200)
MODES = {"autonomous": 0.35, "teleoperated": 1.0}
"""How strong a robot's colour is in a mode; stopped is none."""


def timeline(drawn: Drawn, began: float, numbers: Mapping[str, int]) -> str:
    """The picture.

    Args:
        drawn: what happened. began: s of simulated time when the trial did.
        numbers: of victims, as the map has them.
    """
    last = max([time for time, _ in drawn.scores] + [began + 1.0])
    step = next((one for one in _STEPS if (last - began) / one <= 10.0), 14400)

    def x(time: float) -> float:
        inside = min(max(time, began), last)
        return _LEFT + (_RIGHT - _LEFT) * (inside - began) / (last - began)

    rows = len(drawn.robots)
    base = _TOP + _HIGH + 26.0
    tall = base + _ROW * rows + 30.0
    parts = [
        f'<svg viewBox="0 0 1000 {tall:.0f}" role="img" '
        'aria-label="points over time, and what each robot did">'
        '<defs><pattern id="cut" width="6" height="6" patternUnits="userSpaceOnUse" '
        'patternTransform="rotate(45)"><path d="M0 0h6v6H0z" fill="#fff"/>'
        '<path d="M0 0v6" stroke="#1f2328" stroke-width="4"/></pattern></defs>'
    ]
    for tick in range(0, int(last - began) + 1, step):
        place = f"{x(began + tick):.1f}"
        parts.append(
            f'<line x1="{place}" x2="{place}" y1="{_TOP}" y2="{tall - 24:.0f}" stroke="#eceef0"/>'
            f'<text class="quiet" x="{place}" y="{tall - 8:.0f}" font-size="13" '
            f'text-anchor="middle">{_clock(tick)}</text>'
        )
    parts += _points(drawn, x)
    parts += _finds(drawn, x, numbers, base + _ROW * rows)
    for row, (name, robot) in enumerate(drawn.robots.items()):
        parts += _robot(name, robot, COLOURS[row % len(COLOURS)], base + _ROW * row, x, began)
    parts.append("</svg>")
    return "".join(parts)


def legend(drawn: Drawn) -> str:
    """What the picture shows, in words with their signs."""
    signs = (
        ('<path d="M1 5h14v6H1z" fill="#5f6871" fill-opacity=".35"/>', "drives by itself"),
        ('<path d="M1 5h14v6H1z" fill="#5f6871"/>', "driven by an operator"),
        ('<path d="M1 13h14" stroke="#1f2328" stroke-width="2"/>', "chosen by an operator"),
        ('<path d="M1 5h14v6H1z" fill="url(#cut)" stroke="#5f6871"/>', "no link"),
        ('<path d="M8 3v10" stroke="#1f2328" stroke-width="1.5"/>', "collision"),
        ('<path d="M8 2v12" stroke="#b3261e" stroke-width="3"/>', "victim touched"),
        ('<path d="M2 13h12l-6 -11z" fill="#9a4a00"/>', "told in the table below"),
    )
    return "".join(
        f'<span class="key"><svg viewBox="0 0 16 16">{sign}</svg>{words}</span>'
        for sign, words in (signs if drawn.events else signs[:-1])
    )


def _points(drawn: Drawn, x: X) -> Iterator[str]:
    """The points as they were from one second to the next."""
    totals = [total for _, total in drawn.scores]
    low, high = min((0.0, *totals)), max((0.0, *totals))
    high = high if high > low else low + 1.0

    def y(total: float) -> float:
        return _TOP + _HIGH * (high - total) / (high - low)

    told = [0.0, *(one for one in (high, low) if abs(y(one) - y(0.0)) > 14.0)]
    for value in told:
        yield (
            f'<line x1="{_LEFT}" x2="{_RIGHT}" y1="{y(value):.1f}" y2="{y(value):.1f}" '
            f'stroke="{"#5f6871" if value == 0.0 else "#dcdfe3"}"/>'
            f'<text class="quiet" x="{_LEFT - 8}" y="{y(value) + 4:.1f}" font-size="13" '
            f'text-anchor="end">{number(value)}</text>'
        )
    line = "".join(f"H{x(time):.1f}V{y(total):.1f}" for time, total in drawn.scores)
    if drawn.scores:
        first = f"M{_LEFT} {y(drawn.scores[0][1]):.1f}"
        yield f'<path d="{first}{line}" fill="none" stroke="#0b5c8f" stroke-width="2"/>'
        yield (
            f'<path d="M{_LEFT} {y(0.0):.1f}V{y(drawn.scores[0][1]):.1f}{line}V{y(0.0):.1f}Z" '
            'fill="#0b5c8f" fill-opacity=".08"/>'
        )


def _finds(drawn: Drawn, x: X, numbers: Mapping[str, int], bottom: float) -> Iterator[str]:
    """A line for each find, with the number of the victim, and signs of what else happened."""
    right = 0.0
    for time, victim in drawn.found:
        place, name = f"{x(time):.1f}", numbers.get(victim, "?")
        right = max(x(time), right + 24.0)  # beside the one before, not on it
        yield (
            f'<line x1="{place}" x2="{place}" y1="28" y2="{bottom:.0f}" stroke="#0a7d5a" '
            f'stroke-dasharray="3 4"/><circle cx="{right:.1f}" cy="18" r="11" fill="#0a7d5a"/>'
            f'<text x="{right:.1f}" y="22.5" font-size="13" font-weight="700" text-anchor="middle" '
            f'style="fill:#fff">{name}<title>{escape(victim)}, {number(time)} s</title></text>'
        )
    for time, words in drawn.events:
        spot = x(time)
        yield (
            f'<path d="M{spot - 6:.1f} {_TOP + _HIGH + 14:.0f}h12l-6 -11z" fill="#9a4a00">'
            f"<title>{escape(words)}</title></path>"
        )


def _robot(name: str, robot: Way, colour: str, top: float, x: X, began: float) -> Iterator[str]:
    """A strip of what a robot did."""
    yield (
        f'<text x="{_LEFT - 8}" y="{top + 18:.0f}" font-size="14" font-weight="600" '
        f'text-anchor="end" style="fill:{colour}">{escape(name)}</text>'
        f'<line x1="{_LEFT}" x2="{_RIGHT}" y1="{top + 13:.0f}" y2="{top + 13:.0f}" '
        'stroke="#c9ced3"/>'
    )
    for span in robot.modes:
        strength = MODES.get(span.kind)
        if strength is not None and span.ends is not None and span.ends > began:
            yield (
                f'<rect x="{x(span.begins):.1f}" y="{top + 6:.0f}" height="14" '
                f'width="{x(span.ends) - x(span.begins):.1f}" fill="{colour}" '
                f'fill-opacity="{strength}"><title>{escape(name)} {span.kind}</title></rect>'
            )
    for span in robot.cuts:
        if span.ends is not None and span.ends > began:
            yield (
                f'<rect x="{x(span.begins):.1f}" y="{top + 6:.0f}" height="14" '
                f'width="{max(2.0, x(span.ends) - x(span.begins)):.1f}" fill="url(#cut)">'
                f"<title>{escape(name)} without a link</title></rect>"
            )
    for span in robot.chosen:
        if span.ends is not None and span.ends > began:
            yield (
                f'<line x1="{x(span.begins):.1f}" x2="{x(span.ends):.1f}" y1="{top + 23:.0f}" '
                f'y2="{top + 23:.0f}" stroke="#1f2328" stroke-width="2"/>'
            )
    for time, victim in robot.touches:
        colour, width, reach = ("#b3261e", 3, 3) if victim else ("#1f2328", 1, 0)
        yield (
            f'<line x1="{x(time):.1f}" x2="{x(time):.1f}" y1="{top + 6 - reach:.0f}" '
            f'y2="{top + 20 + reach:.0f}" stroke="{colour}" stroke-width="{width}"/>'
        )


def _clock(seconds: int) -> str:
    """A time of a trial: s, or minutes:seconds."""
    return f"{seconds} s" if seconds < 60 else f"{seconds // 60}:{seconds % 60:02d}"
