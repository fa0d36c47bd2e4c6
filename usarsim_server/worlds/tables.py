"""Strict reading of one TOML table: every value is checked, every key has to be used."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from usarsim_server import errors
from usarsim_server.errors import WorldError
from usarsim_server.simulation.frames import Vector

T = TypeVar("T")

_FORBIDDEN = frozenset("{},:")
"""Characters with a meaning on the wire or in names of geoms."""


class Table:
    """One table of a file, read key by key.

    Args:
        path: the file, for error messages.
        content: the parsed table.
        place: what the user calls this table, for example `[[victim]] 3`; empty for the top.
    """

    def __init__(self, path: Path, content: Mapping[str, object], place: str = "") -> None:
        self.path = path
        self._content = content
        self._place = place
        self._asked: set[str] = set()

    def error(self, key: str, problem: str, cure: str) -> WorldError:
        """The error for a key of this table, to be raised by the caller."""
        where = f"{self._place}: {key}" if self._place else key
        return WorldError(errors.at(self.path, problem, cure, where=where))

    def has(self, key: str) -> bool:
        """Whether the key is written."""
        self._asked.add(key)
        return key in self._content

    def finish(self) -> None:
        """Complain about the first key that nobody asked for."""
        for key in self._content:
            if key not in self._asked:
                close = difflib.get_close_matches(key, sorted(self._asked), n=1, cutoff=0.4)
                hint = f"did you mean {close[0]}? " if close else ""
                known = ", ".join(sorted(self._asked))
                raise self.error(key, "unknown key", f"{hint}known keys: {known}")

    # ---- plain values ---------------------------------------------------------------------

    def text(self, key: str, *, default: str | None = None) -> str:
        """A string on one line or several; without default it must be there and not be empty."""
        value = self._value(key, default)
        if not isinstance(value, str):
            raise self._wrong(key, value, "text in quotes")
        if default is None and not value.strip():
            raise self.error(key, "is empty", "write some text")
        return value

    def word(self, key: str, *, default: str | None = None) -> str:
        """A name that can travel on the wire."""
        value = self.text(key, default=default)
        return self._check_word(key, value)

    def words(self, key: str, *, default: Sequence[str]) -> tuple[str, ...]:
        """A list of names that can travel on the wire."""
        value = self._value(key, default)
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise self._wrong(key, value, 'a list of names such as ["A", "B"]')
        for item in value:
            if not isinstance(item, str):
                raise self._wrong(key, item, "text in quotes")
            self._check_word(key, item)
        return tuple(value)

    def choice(self, key: str, options: Sequence[str]) -> str:
        """One of several words."""
        value = self.text(key)
        if value not in options:
            raise self.error(key, f"{value!r} is not known", f"write one of {', '.join(options)}")
        return value

    def number(
        self, key: str, *, default: float | None, low: float = -math.inf, high: float = math.inf
    ) -> float:
        """A finite number within limits; without default it must be there."""
        if default is not None and not self.has(key):
            return float(default)
        value = self._finite(key, self._value(key, default))
        if not low <= value <= high:
            raise self.error(
                key, f"{value} is out of range", f"write a number from {low} to {high}"
            )
        return value

    def flag(self, key: str, *, default: bool) -> bool:
        """True or false."""
        value = self._value(key, default)
        if not isinstance(value, bool):
            raise self._wrong(key, value, "true or false")
        return value

    def integer(self, key: str, *, default: int | None, low: int, high: int) -> int:
        """A whole number within limits; without default it must be there."""
        value = self._value(key, default)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self._wrong(key, value, "a whole number")
        if not low <= value <= high:
            raise self.error(
                key, f"{value} is out of range", f"write a number from {low} to {high}"
            )
        return value

    # ---- lists of numbers -----------------------------------------------------------------

    def vector(self, key: str, *, default: Vector | None = None) -> Vector:
        """Three finite numbers."""
        x, y, z = self._numbers(key, 3, default)
        return x, y, z

    def interval(self, key: str) -> tuple[float, float]:
        """Two finite numbers, the smaller one first."""
        low, high = self._numbers(key, 2, None)
        if low >= high:
            raise self.error(key, f"[{low}, {high}] is empty", "write the smaller number first")
        return low, high

    def _numbers(self, key: str, count: int, default: Sequence[float] | None) -> list[float]:
        value = self._value(key, default)
        if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != count:
            example = ", ".join(f"{n}.0" for n in range(1, count + 1))
            raise self._wrong(key, value, f"{count} numbers such as [{example}]")
        return [self._finite(key, item) for item in value]

    # ---- tables ---------------------------------------------------------------------------

    def table(self, key: str) -> Table:
        """A table below this one; empty if it is not written."""
        value = self._value(key, {})
        if not isinstance(value, Mapping):
            raise self._wrong(key, value, f"a table, [{key}]")
        return Table(self.path, value, f"{self._place}: {key}" if self._place else f"[{key}]")

    def tables(self, key: str) -> list[Table]:
        """A list of tables, written `[[key]]`; empty if there is none."""
        value = self._value(key, [])
        if not isinstance(value, list) or not all(isinstance(item, Mapping) for item in value):
            raise self._wrong(key, value, f"a list of tables, each beginning with [[{key}]]")
        return [
            Table(self.path, item, f"[[{key}]] {number}")
            for number, item in enumerate(value, start=1)
        ]

    def free(self, key: str) -> Mapping[str, object]:
        """A table whose keys are nobody's business here."""
        value = self._value(key, {})
        if not isinstance(value, Mapping):
            raise self._wrong(key, value, "a table")
        return MappingProxyType(dict(value))

    def raw(self, key: str) -> object:
        """The value as it stands in the file, or None; the caller checks it."""
        return self._content[key] if self.has(key) else None

    # ---- helpers --------------------------------------------------------------------------

    def _value(self, key: str, default: T | None) -> object | T:
        if self.has(key):
            return self._content[key]
        if default is None:
            raise self.error(key, "is missing", f"add {key} = ...")
        return default

    def _wrong(self, key: str, value: object, wanted: str) -> WorldError:
        return self.error(key, f"{value!r} is not {wanted}", f"write {wanted}")

    def _finite(self, key: str, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._wrong(key, value, "a number")
        try:
            number = float(value)
        except OverflowError:  # whole numbers may be as long as one likes
            number = math.inf
        if not math.isfinite(number):
            raise self.error(key, f"{number} is not finite", "write an ordinary number")
        return number

    def _check_word(self, key: str, value: str) -> str:
        bad = next(
            (c for c in value if c in _FORBIDDEN or c.isspace() or not c.isprintable()), None
        )
        if not value or bad is not None or not value.isascii():
            raise self.error(
                key,
                f"{value!r} cannot travel on the wire",
                "use letters, digits, _ - + . and no blanks, braces, commas or colons",
            )
        return value
