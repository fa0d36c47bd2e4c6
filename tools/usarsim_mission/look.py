"""How reports of missions look: one style for all of them, in one HTML file without network."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#7a5195", "#6b6b6b")
"""Of robots: Okabe and Ito's, which colour-blind people tell apart, and two more."""
ZONES = {"yellow": "#e3c400", "orange": "#ee8a1d", "red": "#d63a3a", "blue": "#3b63d8"}
MINUS = "−"
_CSS = """
:root{--ink:#1f2328;--muted:#5f6871;--hair:#dcdfe3;--soft:#f5f6f7;--accent:#0b5c8f;--good:#0a7d5a;
--warn:#9a4a00}
*{box-sizing:border-box}
html{font:16px/1.5 "Source Sans 3","Source Sans Pro","Helvetica Neue",Arial,"Liberation Sans",
sans-serif;color:var(--ink);background:#fff;-webkit-text-size-adjust:100%}
body{margin:0}main{max-width:64rem;margin:0 auto;padding:3rem 1.25rem 4rem}
h1{font-size:1.9rem;line-height:1.2;font-weight:600;letter-spacing:-.01em;margin:0 0 .35rem}
h2{font-size:1.1rem;line-height:1.3;font-weight:600;margin:2.75rem 0 .75rem}
h3{font-size:1rem;line-height:1.3;font-weight:600;margin:1.75rem 0 .5rem}
p{margin:.6rem 0 .8rem;max-width:46rem;overflow-wrap:anywhere}
a{color:var(--accent)}.quiet{color:var(--muted)}.small{font-size:.85rem}
.warn{border-left:4px solid var(--warn);background:#fff6ec;padding:.6rem .9rem;margin:1.2rem 0;
max-width:none}
.facts{display:flex;flex-wrap:wrap;gap:1rem 1.5rem;margin:1.6rem 0 0;align-items:baseline}
.facts div{color:var(--muted);font-size:.85rem;line-height:1.3}
.facts b{display:block;color:var(--ink);font-size:1.35rem;font-weight:600;
font-variant-numeric:tabular-nums}
.facts .first b{font-size:2.3rem;line-height:1.1;letter-spacing:-.02em;color:var(--accent)}
.wide{overflow-x:auto}figure+.wide{margin-top:1.5rem}
table{border-collapse:collapse;width:100%;font-size:.9rem;line-height:1.4;
font-variant-numeric:tabular-nums}
th,td{padding:.38rem 1rem .38rem 0;text-align:left;vertical-align:top}
th:last-child,td:last-child{padding-right:0}
thead th{font-weight:600;color:var(--muted);border-bottom:1px solid var(--ink);
vertical-align:bottom}
tbody th{font-weight:400}tbody tr+tr>*{border-top:1px solid var(--hair)}
.n{text-align:right;white-space:nowrap}.best{font-weight:600;color:var(--good)}
.none{color:var(--muted)}.less{color:var(--warn);font-weight:600}
svg{display:block;width:100%;height:auto}svg text{font-family:inherit;fill:var(--ink)}
svg .quiet{fill:var(--muted)}
figure{margin:0;break-inside:avoid}figcaption{color:var(--muted);font-size:.85rem;margin-top:.5rem}
.key{display:inline-flex;align-items:center;gap:.35rem;margin-right:1.1rem;white-space:nowrap}
.key svg{width:1rem;height:1rem;flex:none}
@media print{@page{margin:16mm}html{font-size:10.5pt}main{max-width:none;padding:0}
.wide{overflow:visible}h2{break-after:avoid}tr{break-inside:avoid}}
"""


def page(title: str, parts: Iterable[str]) -> str:
    """A whole page.

    Args:
        title: plain text. parts: HTML of what stands in it.
    """
    head = (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_CSS}</style>\n<main>"
    )
    return "\n".join((head, *parts, "</main>\n</html>\n"))


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table of cells that are HTML.

    Args:
        heads: of the columns, plain text. rows: the first cell of each names it.
        numbers: columns that stand to the right.
    """

    def cells(row: Sequence[str], tag: str) -> str:
        return "".join(
            f"<{tag if column or tag == 'th scope=col' else 'th scope=row'}"
            f"{' class=n' if column in numbers else ''}>{cell}"
            for column, cell in enumerate(row)
        )

    body = "\n".join(f"<tr>{cells(row, 'td')}" for row in rows)
    head = cells([escape(one) for one in heads], "th scope=col")
    return f'<div class="wide"><table><thead><tr>{head}<tbody>\n{body}\n</table></div>'


def number(value: float | None, digits: int = 1) -> str:
    """A number for people; a dash where there is none."""
    if value is None:
        return '<span class="none">–</span>'
    text = f"{value:.{digits}f}"
    return text.replace("-", MINUS) if float(text) else text.lstrip("-")


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """Values with their names below; the first is the largest. Values are HTML."""
    told = [
        f"<div{' class=first' if not place else ''}><b>{value}</b>{escape(name)}</div>"
        for place, (name, value) in enumerate(pairs)
    ]
    return f'<div class="facts">{"".join(told)}</div>'
