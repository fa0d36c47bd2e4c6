"""A page of headings, paragraphs, tables and pictures; one HTML file without network."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from importlib.resources import files

Rows = Sequence[Sequence[str]]

_MARKUP = re.compile(r"\\|<(?=[A-Za-z/!?])|(?<=\])[(:\[]")
"""What begins a tag, or makes a link or a picture of what stands in brackets before it."""


class Page:
    """Collects headings, paragraphs, tables and pictures once, for HTML and Markdown."""

    def __init__(self, title: str) -> None:
        self._html: list[str] = []
        self._markdown: list[str] = [f"# {_marked(title)}"]
        self._title = title

    def heading(self, text: str) -> None:
        """Begin a section."""
        self._html.append(f"<h2>{html.escape(text)}</h2>")
        self._markdown.append(f"## {_marked(text)}")

    def paragraph(self, text: str, kind: str = "") -> None:
        """A paragraph of plain text; `kind` is its class."""
        attribute = f' class="{kind}"' if kind else ""
        self._html.append(f"<p{attribute}>{html.escape(text)}</p>")
        self._markdown.append(_marked(text))

    def picture(self, svg: str, caption: str) -> None:
        """A picture, unless it is empty; Markdown tells what it shows."""
        if not svg:
            return
        told = html.escape(caption)
        self._html.append(f"<figure>{svg}<figcaption>{told}</figcaption></figure>")
        self._markdown.append(f"*{_marked(caption)} (picture in report.html)*")

    def table(self, heads: Sequence[str], rows: Rows, kind: str = "") -> None:
        """A table whose first column names the row."""
        top = "".join(f'<th scope="col">{html.escape(one)}</th>' for one in heads)
        body = "".join(
            f'<tr><th scope="row">{html.escape(row[0])}</th>'
            + "".join(f"<td>{html.escape(cell)}</td>" for cell in row[1:])
            + "</tr>"
            for row in rows
        )
        attribute = f' class="{kind}"' if kind else ""
        self._html.append(
            f"<div><table{attribute}><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
        )
        lines = [heads, ["---"] * len(heads), *rows]
        escaped = (" | ".join(_marked(cell).replace("|", "\\|") for cell in line) for line in lines)
        self._markdown.append("\n".join(f"| {line} |" for line in escaped))

    def html(self) -> str:
        """The page."""
        style = files("usarsim_report").joinpath("report.css").read_text(encoding="utf-8")
        title = html.escape(self._title)
        return (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{title}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
            f"<h1>{title}</h1>\n" + "\n".join(self._html) + "\n</main>\n</body>\n</html>\n"
        )

    def markdown(self) -> str:
        """The same as Markdown."""
        return "\n\n".join(self._markdown) + "\n"


def _marked(text: str) -> str:
    """A line of text for Markdown, whose readers would run tags and load pictures that it names."""
    return _MARKUP.sub(r"\\\g<0>", " ".join(text.splitlines()))
