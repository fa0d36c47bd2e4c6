"""Reading TOML tables key by key, strictly, with errors a user can act on.

A `TableReader` remembers which keys were asked for. `finish` refuses what is left over, so a
misspelt key never passes silently.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn, TypeVar

from usarsim_server import toml
from usarsim_server.errors import RobotDescriptionError, at

Vector = tuple[float, float, float]
_T = TypeVar("_T")

_KINDS: Mapping[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
    list: "a list",
    dict: "a table",
}


def read_toml(path: Path) -> dict[str, object]:
    """Parse a TOML file.

    Raises:
        RobotDescriptionError: if it cannot be read or is not TOML.
    """
    return toml.read_toml(path, RobotDescriptionError, "wheel")


def nearest(word: str, words: Sequence[str]) -> str:
    """The cure for an unknown word: the most similar known one, or all of them."""
    by_lower = {known.lower(): known for known in words}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1)
    if close:
        return f"did you mean {by_lower[close[0]]!r}?"
    return f"known are: {', '.join(words)}" if words else "nothing is known here"


class TableReader:
    """One TOML table on its way to become a value.

    Every getter raises `RobotDescriptionError` if the key has a wrong type or value, or is
    missing and has no default.
    """

    def __init__(self, table: Mapping[str, object], path: Path, where: str = "") -> None:
        self._table = table
        self._path = path
        self._where = where
        self._known: list[str] = []

    @property
    def place(self) -> str:
        """Where this table stands: `file` or `file: table`."""
        return f"{self._path}: {self._where}" if self._where else str(self._path)

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    def fail(self, problem: str, cure: str, key: str = "") -> NoReturn:
        """Raise the error of this table or of one of its keys."""
        where = " ".join(part for part in (self._where, key) if part)
        raise RobotDescriptionError(at(self._path, problem, cure, where=where or None))

    def has(self, key: str) -> bool:
        """Whether the table has the key; asking makes the key known."""
        self._known.append(key)
        return key in self._table

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> float:
        """A finite number within the closed interval from `low` to `high`."""
        if not self.has(key):
            return self._default(key, default, "a number")
        return self._finite(self._table[key], key, low, high)

    def whole(self, key: str, default: int | None = None, *, low: int, high: int) -> int:
        """A whole number within the closed interval from `low` to `high`."""
        number = self.number(key, default, low=low, high=high)
        if number != int(number):
            self.fail(f"is {number:g}", "write a whole number", key)
        return int(number)

    def numbers(
        self,
        key: str,
        counts: Sequence[int],
        default: tuple[float, ...] | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> tuple[float, ...]:
        """A list of finite numbers; its length must be one of `counts`."""
        wanted = " or ".join(str(count) for count in counts)
        if not self.has(key):
            return self._default(key, default, f"a list of {wanted} numbers")
        values = self._table[key]
        if not isinstance(values, list):
            self.fail(f"is {_kind(values)}", f"write a list of {wanted} numbers", key)
        if len(values) not in counts:
            self.fail(f"has {len(values)} numbers", f"write {wanted}", key)
        return tuple(self._finite(value, key, low, high) for value in values)

    def vector(
        self,
        key: str,
        default: Vector | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> Vector:
        """Three finite numbers."""
        x, y, z = self.numbers(key, (3,), default, low=low, high=high)
        return x, y, z

    def text(self, key: str, default: str | None = None) -> str:
        """A text without control characters."""
        if not self.has(key):
            return self._default(key, default, "a text")
        return self._text(self._table[key], key)

    def choice(self, key: str, options: Sequence[str], default: str | None = None) -> str:
        """One of the given words."""
        word = self.text(key, default)
        if word not in options:
            self.fail(f"is {word!r}", f"write one of: {', '.join(options)}", key)
        return word

    def boolean(self, key: str, default: bool) -> bool:
        """True or false."""
        if not self.has(key):
            return default
        value = self._table[key]
        if not isinstance(value, bool):
            self.fail(f"is {_kind(value)}", "write true or false", key)
        return value

    def is_false(self, key: str) -> bool:
        """Whether the key is `false`, for tables that can be switched off."""
        return self.has(key) and self._table[key] is False

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts; empty if the key is missing."""
        if not self.has(key):
            return ()
        values = self._table[key]
        if not isinstance(values, list):
            self.fail(f"is {_kind(values)}", "write a list of texts", key)
        return tuple(self._text(value, key) for value in values)

    def table(self, key: str) -> TableReader:
        """A table of its own; empty if the key is missing."""
        value = self._table[key] if self.has(key) else {}
        if not isinstance(value, dict):
            self.fail(f"is {_kind(value)}", f"write a table under [{key}]", key)
        return TableReader(value, self._path, f"[{key}]")

    def tables(self, key: str) -> list[TableReader]:
        """A list of tables, each named in its errors by number and, if it has one, by name.

        Tables within tables are named by all of them.
        """
        values = self._table[key] if self.has(key) else []
        if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
            self.fail("is not a list of tables", f"write [[{key}]] above each of them", key)
        outer = f"{self._where} " if self._where else ""
        return [
            TableReader(value, self._path, f"{outer}[[{key}]] number {number}{_name(value)}")
            for number, value in enumerate(values, start=1)
        ]

    def rest(self, *also: str) -> dict[str, object]:
        """All keys nobody asked for, for a reader that comes later; numbers are finite.

        Args:
            also: keys to hand on although somebody asked for them.
        """
        left = {
            key: value
            for key, value in self._table.items()
            if key not in self._known or key in also
        }
        for key, value in left.items():
            self._check_free(value, key)
        self._known.extend(left)
        return left

    def finish(self, hints: Mapping[str, str] | None = None) -> None:
        """Refuse keys nobody asked for.

        Args:
            hints: cures for keys that users are likely to try although they do not exist.
        """
        for key in self._table:
            if key not in self._known:
                cure = (hints or {}).get(key) or nearest(key, list(dict.fromkeys(self._known)))
                self.fail(f"unknown key {key!r}", cure)

    def _default(self, key: str, default: _T | None, kind: str) -> _T:
        if default is None:
            self.fail("is missing", f"add {key} = {kind}", key)
        return default

    def _finite(self, value: object, key: str, low: float, high: float) -> float:
        # bool is an int to Python, but not to whoever wrote `mass = true`.
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(f"is {_kind(value)}", "write a number", key)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.fail("is not a finite number", "write an ordinary number", key)
        if not low <= number <= high:
            self.fail(f"is {number:g}", f"write a number {_interval(low, high)}", key)
        return number

    def _text(self, value: object, key: str) -> str:
        if not isinstance(value, str):
            self.fail(f"is {_kind(value)}", 'write a text in quotes: "..."', key)
        if not value.isprintable():
            self.fail("has control characters", "write one line of printable text", key)
        return value

    def _check_free(self, value: object, key: str) -> None:
        if isinstance(value, dict):
            for name, inner in value.items():
                self._check_free(inner, f"{key}.{name}")
        elif isinstance(value, list):
            for inner in value:
                self._check_free(inner, key)
        elif isinstance(value, str):
            self._text(value, key)
        elif not isinstance(value, bool):
            self._finite(value, key, -math.inf, math.inf)


def _kind(value: object) -> str:
    return _KINDS.get(type(value), f"a {type(value).__name__}")


def _name(table: Mapping[str, object]) -> str:
    name = table.get("name")
    return f" ({name})" if isinstance(name, str) and name.isprintable() else ""


def _interval(low: float, high: float) -> str:
    if high == math.inf:
        return f"of at least {low:g}"
    if low == -math.inf:
        return f"of at most {high:g}"
    return f"between {low:g} and {high:g}"
