"""Tables in CSV: those that we write, and those that come back from a spreadsheet.

Excel saves what it has opened as its country writes: with semicolons or tabs between cells, with a
comma in numbers, with a byte order mark, sometimes with a line `sep=;` before the header. All of
that is read.

A cell of text that begins as a formula does would be run by a spreadsheet, and names come from
strangers. Such a cell is written with an apostrophe before it, which spreadsheets take as "this is
text"; it is taken away when we read the table again. Numbers stay as they are.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.toml import read_text

DELIMITERS = ",;\t"
"""What may stand between cells, the usual one first."""

_SEPARATOR = re.compile(r"sep=([,;\t])", re.IGNORECASE)
"""The first line by which Excel says what stands between cells."""
_QUOTED = re.compile(r'"[^"]*"')
_FORMULA = re.compile(r"'*[=+\-@\t\r\n＝＋－＠]")
_ESCAPED = re.compile(r"'+[=+\-@\t\r\n＝＋－＠]")
_DECIMAL = re.compile(r"[+-]?[0-9]+,[0-9]+(?:[eE][+-]?[0-9]+)?")


class Sheet:
    """A table that was read.

    Attributes:
        path: of the file. heads: names of the columns. rows: number of the line from 1, and the
            cells by the name of their column.
    """

    def __init__(
        self,
        path: Path | str,
        heads: Sequence[str],
        rows: Sequence[tuple[int, dict[str, str]]],
        delimiter: str,
    ) -> None:
        """Take what was read; `delimiter` stood between the cells."""
        self.path, self.heads, self.rows = path, tuple(heads), tuple(rows)
        self._foreign = delimiter != ","

    def number(self, text: str) -> float:
        """A number; with a comma for a point where no comma stands between cells.

        Raises:
            ValueError: it is none.
        """
        if self._foreign and _DECIMAL.fullmatch(text.strip()):
            text = text.replace(",", ".")
        return float(text)


def read_csv(path: Path, error: type[UsarsimError], cure: str, limit: int | None = None) -> Sheet:
    """Read a table with a header.

    Args:
        path: of the file.
        error: what is raised.
        cure: what to do about a file that is none.
        limit: bytes that it may have; None stands for `files.MAX_TEXT`.

    Raises:
        error: it cannot be read, is not UTF-8, or a row has more or fewer cells than the header.
    """
    text = read_text(path, error) if limit is None else read_text(path, error, limit)
    return parse_csv(text, path, error, cure)


def parse_csv(text: str, path: Path | str, error: type[UsarsimError], cure: str) -> Sheet:
    """The table in the text of a file; see `read_csv`."""
    first, _, rest = text.partition("\n")
    skipped = 0
    if told := _SEPARATOR.fullmatch(first.strip('" ')):
        delimiter, text, skipped = told[1], rest, 1
    else:
        bare = _QUOTED.sub("", first)
        delimiter = max(DELIMITERS, key=bare.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    heads: list[str] | None = None
    rows: list[tuple[int, dict[str, str]]] = []
    try:
        for line, cells in _numbered(reader):
            where = f"line {line + skipped}"
            if not any(cells):
                continue
            if heads is None:
                heads = [cell.strip() for cell in cells]
                continue
            if len(cells) != len(heads):
                problem = f"{len(cells)} cells, not {len(heads)} as in the header"
                raise error(at(path, problem, cure, where=where))
            rows.append((line + skipped, dict(zip(heads, map(_plain, cells), strict=True))))
    except csv.Error as cause:
        where = f"line {reader.line_num + skipped}"
        raise error(at(path, f"is no CSV: {cause}", cure, where=where)) from None
    return Sheet(path, heads or (), rows, delimiter)


def _numbered(reader: Any) -> Iterator[tuple[int, list[str]]]:
    """Rows, and the line in which each begins."""
    line = 1
    for cells in reader:
        yield line, cells
        line = reader.line_num + 1


class _File(Protocol):
    def write(self, text: str, /) -> object:
        """Take some text."""


class CsvWriter:
    """Writes rows as CSV: None is an empty cell, numbers are written so that they read back."""

    def __init__(self, file: _File) -> None:
        """Write to a file that was opened with `newline=""`."""
        self._writer = csv.writer(file, lineterminator="\n")

    def row(self, cells: Iterable[object]) -> None:
        """Write a row."""
        self._writer.writerow([_guarded(cell) if type(cell) is str else cell for cell in cells])

    def rows(self, rows: Iterable[Iterable[object]]) -> None:
        """Write rows."""
        for cells in rows:
            self.row(cells)


Cellular = str | int | float | None
"""What a cell of a table holds; None is left empty."""


def csv_text(heads: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """A whole table; see `CsvWriter`."""
    out = io.StringIO()
    writer = CsvWriter(out)
    writer.row(heads)
    writer.rows(rows)
    return out.getvalue()


def _guarded(text: str) -> str:
    """A cell that no spreadsheet takes for a formula, or for the end of a row."""
    if "\r" in text:  # which `csv` does not put into quotes
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    if _FORMULA.match(text) is None:
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def _plain(text: str) -> str:
    """The opposite of `_guarded`."""
    return text[1:] if text[:1] == "'" and _ESCAPED.match(text) else text
