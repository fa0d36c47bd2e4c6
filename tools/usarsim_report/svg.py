"""Pictures of reports: inline SVG; the same numbers give the same bytes.

No date, identifiers from a fixed salt, text as text in the page's own typeface.
"""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

COLOURS = ("#2f5d8a", "#c2661a", "#3d7d5a", "#84507a", "#7b6a2a", "#4b4b4b", "#a03a3a", "#2a8a8a")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
INK, MUTED, HAIR, TIE = "#222222", "#6a6a6a", "#d6d6d6", "#b9c0c7"

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.titlepad": 9.0,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "xtick.major.size": 0.0,
    "ytick.major.size": 2.5,
    "ytick.major.width": 0.7,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


def picture(
    name: str, label: str, width: float, height: float, draw: Callable[[Figure], None]
) -> str:
    """An SVG element.

    Args:
        name: unique on the page, for identifiers.
        label: what it shows, for those who cannot see it.
        width, height: inches.
        draw: fills the figure.
    """
    with mpl.rc_context({**_STYLE, "svg.hashsalt": name}):
        figure = Figure((width, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    svg = out.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    svg = re.sub(r"font-family: [^;\"]*;? ?|font: ([0-9.]+px) [^;\"]*", _size_only, svg)
    size = re.search(r'viewBox="0 0 ([0-9.]+) ', svg)
    shown = round(float(size[1])) if size else 0
    head = f'<svg role="img" aria-label="{html.escape(label)}" style="max-width:{shown}pt"'
    svg = re.sub(r'<svg (height|width)="[^"]*"|<svg', lambda _: head, svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) (?:width|height)="[^"]*pt"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) (?:width|height)="[^"]*pt"', r"\1", svg, count=1)
    return re.sub(r"[ \t]*\n[ \t]*", "\n", svg).strip()


def _size_only(found: re.Match[str]) -> str:
    """A font without its family: the page's own is used."""
    return f"font-size: {found[1]}" if found[1] else ""
