"""Tables of files whose errors name the line: what `tables` reads, and where it stands.

`open_toml` takes the place of `Table(read_toml(path, error), path, error)`. Lines are looked up
only when something is wrong; a key of an inline table has the line of the key that holds it.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import cast

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import parse_toml, read_text

Place = tuple[str | int, ...]
"""Keys and, for entries of lists of tables, numbers from 0, from the top of a file down."""

Lines = Callable[[], Mapping[Place, int]]

_LONG_TEXT = r'"""(?:\\.|[^\\])*?"{3,5}' + r"|'{3}.*?'{3,5}"
_WORD = r'"(?:\\.|[^"\\\n])*"' + r"|'[^'\n]*'|[A-Za-z0-9_-]+"
_TOKENS = re.compile(
    rf"(?P<long>{_LONG_TEXT})|(?P<word>{_WORD})|(?P<blank>#[^\n]*|[ \t]+)|(?P<sign>.)", re.DOTALL
)


class LinedTable(Table):
    """A table whose errors name the line."""

    _lines: Lines = dict
    _keys: Place = ()

    @classmethod
    def top(
        cls,
        content: Mapping[str, object],
        path: Path | str,
        error: type[UsarsimError],
        lines: Lines,
    ) -> LinedTable:
        """The whole file; `lines` tells where its keys stand."""
        table = cls(content, path, error)
        table._lines = lines
        return table

    def error(self, key: str, problem: str, cure: str) -> UsarsimError:
        """As that of `Table`, with the line."""
        lines = self._lines()
        place = (*self._keys, self._written(key)) if key else self._keys
        while place and place not in lines:
            place = place[:-1]
        where = ": ".join(part for part in (self._place, key) if part)
        if place in lines:
            where = f"line {lines[place]}: {where}" if where else f"line {lines[place]}"
        found = self._error(at(self.path, problem, cure, where=where or None))
        found.spot = (*self._keys, self._written(key)) if key else self._keys
        return found

    def table(self, key: str) -> Table:
        """As that of `Table`."""
        return self._lined(super().table(key), key)

    def tables(self, key: str) -> list[Table]:
        """As that of `Table`."""
        values = self._content.get(self._written(key), ())
        numbers = [n for n, one in enumerate(cast(list[object], values)) if one is not None]
        return [
            self._lined(one, key, n) for n, one in zip(numbers, super().tables(key), strict=True)
        ]

    def _below(self, content: Mapping[str, object], place: str) -> Table:
        return LinedTable(content, self.path, self._error, place, hyphens=self._hyphens)

    def _lined(self, table: Table, *keys: str | int) -> Table:
        lined = cast(LinedTable, table)
        lined._lines, lined._keys = self._lines, (*self._keys, *keys)
        return lined


def open_toml(path: Path, error: type[UsarsimError], entry: str = "name") -> LinedTable:
    """The top table of a TOML file; see `toml.read_toml`.

    Raises:
        error: if it cannot be read or is not TOML.
    """
    text = read_text(path, error)
    content = parse_toml(text, path, error, entry)
    return LinedTable.top(content, path, error, lambda: key_lines(text))


@lru_cache(maxsize=1)
def key_lines(text: str) -> Mapping[Place, int]:
    """The line, from 1, of each key and each table header of a valid TOML file.

    Kept for the next error of the same file: those who tell all of its errors ask once for each.
    """
    found: dict[Place, int] = {}
    counts: dict[Place, int] = {}
    table: Place = ()
    for line, words, brackets in _statements(text):
        if not brackets:
            found.setdefault((*table, *words), line)
            continue
        table = ()
        for number, word in enumerate(words):
            table = (*table, word)
            if brackets == 2 and number == len(words) - 1:
                counts[table] = counts.get(table, -1) + 1
            if table in counts:
                found.setdefault(table, line)
                table = (*table, counts[table])
        found.setdefault(table, line)
    return found


def _statements(text: str) -> Iterator[tuple[int, list[str], int]]:
    """Of all that begins a line: its line, its dotted key, the brackets before it (0: a value)."""
    line, depth, brackets, begins, words = 1, 0, 0, True, list[str]()
    for token in itertools.chain(_TOKENS.finditer(text), (None,)):
        kind, part = ("sign", "\n") if token is None else (token.lastgroup, token[0])
        if begins and kind == "word":
            words.append(part[1:-1] if part[0] in "\"'" else part)
        elif part == "\n" and depth <= 0:
            if brackets:
                yield line, words, brackets
            depth, brackets, begins, words = 0, 0, True, []
        elif begins and part == "=":
            yield line, words, 0
            begins = False
        elif begins and part == "[" and not words:
            brackets += 1
        elif not begins and kind == "sign":
            depth += (part in "[{") - (part in "]}")
        line += part.count("\n")
