"""Reads tables of TOML files strictly: what is wrong becomes one error with file, place and cure.

A table is read key by key (`Table.number`, `.text`, ...), or at once into a dataclass whose fields
are declared with `field`. Reading a key makes it known; `finish` refuses all others. The check, the
error texts, the help of an option and the key tables of `docs/` follow from the declaration:

    @dataclass(frozen=True, slots=True)
    class Lamp:
        color: Vector = field(default=(1.0, 1.0, 1.0), low=0.0, high=1.0, help="red, green, blue")
        kind: Literal["spot", "point"] = field(default="point", help="shape of its light")
        reach: float = field(default=10.0, unit="m", above=0.0, help="where its light ends")

    table = Table(read_toml(path, WorldError), path, WorldError)
    lamps = table.all("lamp", Lamp)  # `table.read(Lamp, base)` fills in what is absent from base
    table.finish()

What a declaration cannot say is read by a getter, or by a function: `field(parse=...)`.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.fields import Limits, keys

T = TypeVar("T")
Vector = tuple[float, float, float]

_FORBIDDEN = frozenset("{},:")  # they mean something on the wire or in names of geoms
_LONGEST_VALUE = 60  # characters of a wrong value in an error
_FEW = 25  # so many known keys are listed beside the one that was probably meant


def finite(value: object) -> float | None:
    """A value of a TOML file as a finite number; None if it is none, or too large for one."""
    # bool is an int to Python, but not to whoever wrote `range = true`.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # whole numbers may be as long as one likes
        return None
    return number if math.isfinite(number) else None


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word that one resembles most, whatever the case; None if it resembles none."""
    by_lower = {one.lower(): one for one in known}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1)
    close += [one for one in by_lower if len(word) > 2 and one.startswith(word.lower())]
    return by_lower[close[0]] if close else None


def suggest(word: str, known: Sequence[str]) -> str:
    """The cure for an unknown word: the most similar known one, or all of them."""
    close = nearest(word, known)
    if close is not None:
        return f"did you mean {close!r}?"
    return f"known are: {', '.join(known)}" if known else "nothing is known here"


class Table:
    """One table of a file, read key by key.

    All getters return the default where the key is absent; a getter without default raises then.
    They raise the error of the table where the value does not fit.
    """

    def __init__(
        self,
        content: Mapping[str, object],
        path: Path | str,
        error: type[UsarsimError],
        place: str = "",
        *,
        kind: str = "",
        hyphens: bool = False,
    ) -> None:
        """Begin to read.

        Args:
            content: the parsed table.
            path: the file, or where else the table stands, for errors.
            error: class of all errors.
            place: what the user calls this table, for example `[[victim]] 3`; empty for the top.
            kind: of what the keys are, such as `a SICK`, for errors.
            hyphens: keys may be written with hyphens for underscores.
        """
        self.path = path
        self._content = content
        self._error = error
        self._place = place
        self._kind = kind
        self._hyphens = hyphens
        self._known: dict[str, None] = {}

    @property
    def place(self) -> str:
        """Where this table stands: `file` or `file: table`."""
        return f"{self.path}: {self._place}" if self._place else str(self.path)

    def error(self, key: str, problem: str, cure: str) -> UsarsimError:
        """The error for a key of this table, or for the table (no key), to be raised."""
        where = ": ".join(part for part in (self._place, key) if part)
        return self._error(at(self.path, problem, cure, where=where or None))

    def wrong(self, key: str, value: object, wanted: str, cure: str = "") -> UsarsimError:
        """The error for a value that is not what is wanted."""
        return self.error(key, f"{shown(value)} is not {wanted}", f"write {cure or wanted}")

    def has(self, key: str) -> bool:
        """Whether the key is written; asking makes it known."""
        self._known[key] = None
        return self._written(key) in self._content

    def raw(self, key: str) -> object:
        """The value as it stands in the file, or None; the caller checks it."""
        return self._content[self._written(key)] if self.has(key) else None

    def finish(self, hints: Mapping[str, str] | None = None) -> None:
        """Refuse the first key that nobody asked for.

        Args:
            hints: cures for keys that users are likely to try although they do not exist.
        """
        known = {self._written(key): key for key in self._known}
        for key in self._content:
            if self._hyphens and key not in known and key.replace("-", "_") in self._known:
                raise self.error(key, "given twice", f"write {key.replace('-', '_')} once")
            if key not in known:
                cure = (hints or {}).get(key)
                if cure is None:
                    close = nearest(key, self._known)
                    cure = "remove it;" if close is None else f"did you mean {close}?"
                    if close is None or len(self._known) <= _FEW:
                        cure += f" known keys: {', '.join(sorted(self._known)) or 'none'}"
                kind = f" of {self._kind}" if self._kind else ""
                raise self.error(key, f"unknown key{kind}", cure)

    def rest(self, *also: str) -> dict[str, object]:
        """All keys nobody asked for, for a reader that comes later; numbers are finite.

        Args:
            also: keys to hand on although somebody asked for them.
        """
        left = {k: v for k, v in self._content.items() if k not in self._known or k in also}
        for key, value in left.items():
            self._check_free(value, key)
        self._known.update(dict.fromkeys(left))
        return left

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
        above: float = -math.inf,
        unit: str = "",
    ) -> float:
        """A finite number in [low, high] that is also greater than `above`."""
        limits = Limits(low, high, above, unit)
        if not self.has(key):
            return self._default(key, default, f"a number{limits}")
        return self.check_number(key, self.raw(key), limits, default)

    def count(self, key: str, default: int | None = None, *, low: int, high: int) -> int:
        """A whole number in [low, high]."""
        limits = Limits(low, high)
        if not self.has(key):
            return self._default(key, default, f"a whole number{limits}")
        return self.check_count(key, self.raw(key), limits, default)

    def flag(self, key: str, default: bool | None = None) -> bool:
        """True or false."""
        if not self.has(key):
            return self._default(key, default, "true or false")
        value = self.raw(key)
        if not isinstance(value, bool):
            raise self.wrong(key, value, "true or false")
        return value

    def text(self, key: str, default: str | None = None, *, lines: bool = False) -> str:
        """A text; one without default must not be empty.

        Args:
            key: to read.
            default: where it is absent.
            lines: it may have several lines, and control characters.
        """
        if not self.has(key):
            return self._default(key, default, '"..."')
        value = self._text(key, self.raw(key), lines)
        if default is None and not value.strip():
            raise self.error(key, "is empty", "write some text")
        return value

    def texts(self, key: str, default: Sequence[str] = ()) -> tuple[str, ...]:
        """A list of texts."""
        values = self._list(key, 'a list of texts such as ["A", "B"]', default)
        return tuple(self._text(key, value) for value in values)

    def word(self, key: str, default: str | None = None) -> str:
        """A name that can travel on the wire."""
        return self._word(key, self.text(key, default))

    def words(self, key: str, default: Sequence[str] = ()) -> tuple[str, ...]:
        """A list of names that can travel on the wire."""
        values = self._list(key, 'a list of names such as ["A", "B"]', default)
        return tuple(self._word(key, self._text(key, value)) for value in values)

    def choice(
        self,
        key: str,
        options: Sequence[str],
        default: str | None = None,
        *,
        any_case: bool = False,
    ) -> str:
        """One of several words, as `options` spells it.

        Args:
            key: to read.
            options: the words.
            default: where the key is absent.
            any_case: upper and lower case count the same.
        """
        wanted = f"one of {', '.join(options)}"
        if not self.has(key):
            return self._default(key, default, wanted)
        value = self._text(key, self.raw(key), cure=wanted)
        for option in options:
            if value == option or (any_case and value.strip().lower() == option.lower()):
                return option
        close = nearest(value, options)
        hint = "" if close is None else f"did you mean {close}? "
        raise self.error(key, f"{shown(value)} is not known", f"{hint}write {wanted}")

    def numbers(
        self,
        key: str,
        counts: Sequence[int] = (),
        default: Sequence[float] | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
        above: float = -math.inf,
        unit: str = "",
    ) -> tuple[float, ...]:
        """A list of finite numbers within limits, as many as one of `counts`; none: any number."""
        if not self.has(key) and default is not None:
            return tuple(default)
        return self.check_numbers(key, counts, Limits(low, high, above, unit), self.check_number)

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

    def interval(self, key: str) -> tuple[float, float]:
        """Two finite numbers, the smaller one first."""
        first, second = self.numbers(key, (2,))
        if first >= second:
            raise self.error(key, f"[{first}, {second}] is empty", "write the smaller number first")
        return first, second

    def table(self, key: str) -> Table:
        """A table below this one; empty if it is not written."""
        place = f"{self._place}: {key}" if self._place else f"[{key}]"
        return self._below(self.free(key), place)

    def tables(self, key: str) -> list[Table]:
        """A list of tables, written `[[key]]`; empty if there is none.

        Each is named in its errors by number and, if it has one, by name or tag. None in the place
        of a table, which no file holds, is left out and keeps its number.
        """
        values = self.raw(key) if self.has(key) else []
        if not isinstance(values, list) or not all(
            one is None or isinstance(one, Mapping) for one in values
        ):
            raise self.wrong(key, values, f"a list of tables, each beginning with [[{key}]]")
        outer = f"{self._place}: " if self._place else ""
        return [
            self._below(value, f"{outer}[[{key}]] {number}{_name(value)}")
            for number, value in enumerate(values, start=1)
            if value is not None
        ]

    def free(self, key: str) -> Mapping[str, object]:
        """A table whose keys are nobody's business here."""
        value = self.raw(key) if self.has(key) else {}
        if not isinstance(value, Mapping):
            raise self.wrong(key, value, f"a table, [{key}]")
        return MappingProxyType(dict(value))

    def read(self, cls: type[T], base: T | None = None, **given: object) -> T:
        """The value whose declared fields stand in this table; `finish` is left to the caller.

        Args:
            cls: a dataclass with fields made by `field`.
            base: where absent keys, and fields that are not declared, come from.
            given: fields that are not read, by name.
        """
        values = dict(given)
        for key in keys(typing.cast(Any, cls)):
            if key.name not in given:
                default = key.default() if base is None else getattr(base, key.name)
                values[key.name] = key.read(self, default)
        if base is not None:
            return typing.cast(T, dataclasses.replace(typing.cast(Any, base), **values))
        return cls(**values)

    def one(self, key: str, cls: type[T], base: T | None = None) -> T:
        """The declared value in a table below this one, which may be absent; see `read`."""
        inner = self.table(key)
        value = inner.read(cls, base)
        inner.finish()
        return value

    def all(self, key: str, what: type[T] | Callable[[Table], T]) -> tuple[T, ...]:
        """The values of a list of tables: declared ones of a class, or read by a function."""
        found = []
        for inner in self.tables(key):
            read: Callable[[Any], Any] = what
            found.append(inner.read(what) if isinstance(what, type) else read(inner))
            inner.finish()
        return tuple(found)

    def _below(self, content: Mapping[str, object], place: str) -> Table:
        return Table(content, self.path, self._error, place, hyphens=self._hyphens)

    def _written(self, key: str) -> str:
        """The key as it is spelt in the file."""
        hyphened = key.replace("_", "-") if self._hyphens else key
        return key if key in self._content else hyphened

    def _default(self, key: str, default: T | None, wanted: str) -> T:
        if default is None:
            raise self.error(key, "is missing", f"add {key} = {wanted}")
        return default

    def check_number(
        self, key: str, value: object, limits: Limits, default: float | None = None
    ) -> float:
        """A value as a finite number within limits."""
        number = finite(value)
        if number is not None and limits.hold(number):
            return number
        problem = "is out of range"
        if number is None:
            plain = isinstance(value, int | float) and not isinstance(value, bool)
            problem = "is not a finite number" if plain else "is not a number"
        cure = f"write a number{limits}{_example(key, default)}"
        raise self.error(key, f"{shown(value)} {problem}", cure)

    def check_count(
        self, key: str, value: object, limits: Limits, default: int | None = None
    ) -> int:
        """A value as a whole number within limits."""
        cure = f"a whole number{limits}{_example(key, default)}"
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.wrong(key, value, "a whole number", cure)
        if not limits.hold(value):
            raise self.error(key, f"{shown(value)} is out of range", f"write {cure}")
        return value

    def check_numbers(
        self,
        key: str,
        counts: Sequence[int],
        limits: Limits,
        read: Callable[[str, object, Limits], T],
    ) -> tuple[T, ...]:
        """The list under a key, each item read by `check_number` or `check_count`."""
        wanted = "a list of numbers such as [1.0, 2.0]"
        if counts:
            example = ", ".join(f"{number}.0" for number in range(1, counts[0] + 1))
            wanted = f"{' or '.join(map(str, counts))} numbers such as [{example}]"
        values = self._list(key, wanted, None)
        if counts and len(values) not in counts:
            raise self.wrong(key, values, wanted)
        return tuple(read(key, value, limits) for value in values)

    def _text(
        self, key: str, value: object, lines: bool = False, cure: str = "text in quotes"
    ) -> str:
        if not isinstance(value, str):
            raise self.wrong(key, value, "text", cure)
        if not lines and not value.isprintable():
            raise self.error(key, "has control characters", "write one line of printable text")
        return value

    def _word(self, key: str, value: str) -> str:
        bad = (c in _FORBIDDEN or c.isspace() for c in value)
        if not value or not value.isascii() or any(bad):
            cure = "use letters, digits, _ - + . and no blanks, braces, commas or colons"
            raise self.error(key, f"{shown(value)} cannot travel on the wire", cure)
        return value

    def _list(self, key: str, wanted: str, default: Sequence[T] | None) -> Sequence[object]:
        if not self.has(key):
            return self._default(key, default, wanted)
        values = self.raw(key)
        if isinstance(values, str) or not isinstance(values, Sequence):
            raise self.wrong(key, values, wanted)
        return values

    def _check_free(self, value: object, key: str) -> None:
        if isinstance(value, Mapping):
            for name, inner in value.items():
                self._check_free(inner, f"{key}.{name}")
        elif isinstance(value, list):
            for inner in value:
                self._check_free(inner, key)
        elif isinstance(value, str):
            self._text(key, value)
        elif not isinstance(value, bool):
            self.check_number(key, value, Limits())


def shown(value: object) -> str:
    """A value as an error shows it, on one line."""
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."


def _example(key: str, default: float | None) -> str:
    usable = default is not None and math.isfinite(default)
    return f", for example {key} = {default}" if usable else ""


def _name(table: Mapping[str, object]) -> str:
    name = table.get("name", table.get("tag"))
    return f" ({name})" if isinstance(name, str) and name.isprintable() and name else ""
