"""Curves as SVG: a frame, axes with ticks, labelled series; nothing has to be installed for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

WIDTH, HEIGHT = 640, 400
FRAME = (64.0, 76.0, 616.0, 344.0)
"""Left, top, right and bottom of the frame in which points lie, pixels."""
TICKS = 6
"""Ticks of an axis, about."""
_TEXT, _SMALL = 14, 12
_GLYPH = 0.58
"""Mean width of a letter over the size of the type, rather more than less."""
_GAP = 8.0
"""Pixels between two labels, at least."""
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""Colours that people with any kind of colour vision tell apart (Okabe and Ito)."""
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Series:
    """One curve.

    Attributes:
        name: in the legend.
        points: x and y, by rising x.
    """

    name: str
    points: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Plot:
    """Some curves over one quantity. The y axis begins at 0.

    Attributes:
        key: part of the file's name.
        title: above the frame.
        x, y: names of the axes, with units.
        series: at least one, with at least one point.
        log_x: put x on a logarithmic scale; then all x must be above 0.
    """

    key: str
    title: str
    x: str
    y: str
    series: tuple[Series, ...]
    log_x: bool = False

    @property
    def xs(self) -> list[float]:
        """All x that any series has, rising."""
        return sorted({x for one in self.series for x, _ in one.points})

    @property
    def limits(self) -> tuple[float, float, float, float]:
        """Least x, greatest x, least y (0), greatest y of the frame.

        Raises:
            ValueError: if there is nothing to plot, or a value that has no place on its scale.
        """
        points = [point for one in self.series for point in one.points]
        if not points:
            raise ValueError(f"{self.key}: nothing to plot")
        if not all(math.isfinite(x) and math.isfinite(y) and y >= 0.0 for x, y in points):
            raise ValueError(f"{self.key}: values must be finite, and y not negative")
        xs = [x for x, _ in points]
        if self.log_x and min(xs) <= 0.0:
            raise ValueError(f"{self.key}: a logarithmic scale has no place for {min(xs):g}")
        low, high = (min(xs), max(xs)) if self.log_x else (min(0.0, *xs), max(xs))
        if low == high:
            low, high = (low / 2.0, high * 2.0) if self.log_x else (low, low + 1.0)
        return low, high, 0.0, self.y_ticks[-1]

    @property
    def y_ticks(self) -> list[float]:
        """Ticks of the y axis, from 0 to the top of the frame."""
        return nice_ticks(0.0, max(y for one in self.series for _, y in one.points) or 1.0)


def nice_ticks(low: float, high: float, wanted: int = TICKS) -> list[float]:
    """Round numbers that cover a range, about so many; the last is not below `high`.

    Raises:
        ValueError: if the range has no length.
    """
    if not high > low:
        raise ValueError("ticks need a range")
    rough = (high - low) / wanted
    power = 10.0 ** math.floor(math.log10(rough))
    # Rounding must not skip a step that fits.
    step = next(power * one for one in _STEPS if power * one >= rough * (1.0 - 1e-9))
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [number * step for number in range(first, last + 1)]


def place(plot: Plot, x: float, y: float) -> tuple[float, float]:
    """Where a point lies in the picture, pixels from the upper left corner."""
    low, high, bottom, top = plot.limits
    left, upper, right, lower = FRAME
    part = math.log(x / low) / math.log(high / low) if plot.log_x else (x - low) / (high - low)
    return left + part * (right - left), lower - (y - bottom) / (top - bottom) * (lower - upper)


def as_svg(plot: Plot) -> str:
    """The picture, a whole document. Ends with a line feed.

    Raises:
        ValueError: see `Plot.limits`.
    """
    left, upper, right, lower = FRAME
    middle = (left + right) / 2.0
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'height="{HEIGHT}" font-family="Helvetica, Arial, sans-serif" font-size="{_SMALL}" '
        'fill="#333">',
        f"<title>{escape(plot.title)}</title>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
        _text(left, 26.0, plot.title, f'font-size="{_TEXT}" font-weight="bold"'),
        *_legend(plot),
        *_x_axis(plot),
        *_y_axis(plot),
        f'<rect x="{left:g}" y="{upper:g}" width="{right - left:g}" height="{lower - upper:g}" '
        'fill="none" stroke="#888"/>',
        _text(middle, HEIGHT - 14.0, plot.x, 'text-anchor="middle"'),
        _text(
            18.0,
            (upper + lower) / 2.0,
            plot.y,
            f'text-anchor="middle" transform="rotate(-90 18 {(upper + lower) / 2.0:g})"',
        ),
        *(_curve(plot, number) for number in range(len(plot.series))),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _legend(plot: Plot) -> list[str]:
    """Names of the series beside their marks, in one row, or two if there are many."""
    parts, x, y = [], FRAME[0], 46.0
    for number, one in enumerate(plot.series):
        wide = 26.0 + _width(one.name) + 2.0 * _GAP
        if x + wide > WIDTH and x > FRAME[0]:
            x, y = FRAME[0], y + 18.0
        parts.append(_line(x, y - 4.0, x + 20.0, y - 4.0, f'stroke="{_color(number)}"', 2.0))
        parts.append(_mark(number, x + 10.0, y - 4.0))
        parts.append(_text(x + 26.0, y, one.name, 'class="series"'))
        x += wide
    return parts


def _x_axis(plot: Plot) -> list[str]:
    low, high, _, _ = plot.limits
    _, upper, _, lower = FRAME
    # On a logarithmic scale, and for a few sizes, those that were measured tell most.
    ticks = plot.xs if plot.log_x else [x for x in nice_ticks(low, high) if low <= x <= high]
    parts, free = [], -math.inf
    for tick in ticks:
        x, _ = place(plot, tick, 0.0)
        half = _width(_number(tick)) / 2.0
        parts.append(_line(x, upper, x, lower, 'stroke="#e6e6e6"', 1.0))
        if x - half < free:
            continue
        free = x + half + _GAP
        parts.append(_text(x, lower + 18.0, _number(tick), 'text-anchor="middle" class="tick"'))
    return parts


def _y_axis(plot: Plot) -> list[str]:
    left, _, right, _ = FRAME
    parts = []
    for tick in plot.y_ticks:
        _, y = place(plot, plot.xs[0], tick)
        parts.append(_line(left, y, right, y, 'stroke="#e6e6e6"', 1.0))
        parts.append(_text(left - 8.0, y + 4.0, _number(tick), 'text-anchor="end" class="tick"'))
    return parts


def _curve(plot: Plot, number: int) -> str:
    one, color = plot.series[number], _color(number)
    places = [place(plot, x, y) for x, y in one.points]
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    marks = "".join(_mark(number, x, y) for x, y in places)
    return (
        f"<g data-name={quoteattr(one.name)}>"
        f'<polyline points="{corners}" fill="none" stroke="{color}" stroke-width="2"/>{marks}</g>'
    )


def _mark(number: int, x: float, y: float) -> str:
    """A dot, a square, a diamond or a triangle: series are told apart without colours, too."""
    fill = f'fill="{_color(number)}"'
    if number % 4 == 0:
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" {fill}/>'
    shapes: Sequence[Sequence[tuple[float, float]]] = (
        ((-3.5, -3.5), (3.5, -3.5), (3.5, 3.5), (-3.5, 3.5)),
        ((0.0, -5.0), (5.0, 0.0), (0.0, 5.0), (-5.0, 0.0)),
        ((0.0, -5.0), (4.5, 4.0), (-4.5, 4.0)),
    )
    corners = " ".join(f"{x + a:.1f},{y + b:.1f}" for a, b in shapes[number % 4 - 1])
    return f'<polygon points="{corners}" {fill}/>'


def _color(number: int) -> str:
    return _COLORS[number % len(_COLORS)]


def _line(x1: float, y1: float, x2: float, y2: float, stroke: str, width: float) -> str:
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} {stroke} stroke-width="{width:g}"/>'


def _text(x: float, y: float, text: str, more: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" {more}>{escape(text)}</text>'


def _width(text: str) -> float:
    return _GLYPH * _SMALL * len(text)


def _number(value: float) -> str:
    return f"{value:.6g}"
