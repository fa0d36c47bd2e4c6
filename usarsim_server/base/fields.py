"""Declares the fields of a dataclass that stand in a file: one declaration serves all.

From `speed: float = field(default=1.0, unit="m/s", low=0.0, help="...")` follow its reading and its
checks (`tables.Table.read`), the texts of errors, the help of an option and the rows of tables in
`docs/` (`markdown`).
"""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Any, Literal, TypeVar, overload

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Limits:
    """Which numbers a key takes: from `low` to `high`, and more than `above`."""

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    unit: str = ""  # of the numbers, for errors
    also: str = ""  # what else may be written, for errors

    def hold(self, number: float) -> bool:
        """Whether a number is within."""
        return self.low <= number <= self.high and number > self.above

    def __str__(self) -> str:
        """The limits in words, with a blank before; empty if there are none."""
        if self.above > -math.inf:
            text = f" greater than {_plain(self.above)}"
            text += f" and of at most {_plain(self.high)}" if self.high < math.inf else ""
        elif self.low > -math.inf and self.high < math.inf:
            text = f" from {_plain(self.low)} to {_plain(self.high)}"
        elif self.low > -math.inf:
            text = f" of at least {_plain(self.low)}"
        else:
            text = f" of at most {_plain(self.high)}" if self.high < math.inf else ""
        unit = self.unit and (f" {self.unit}" if text else f" in {self.unit}")
        return text + unit + self.also


_REQUIRED: Any = object()
"""The default of what has to be written."""

Parse = Callable[[Any, str], Any]
"""Reads the value of a key that is written, or raises the table's error."""


@overload
def field(*, default: T, **about: Any) -> T: ...
@overload
def field(*, factory: Callable[[], T], **about: Any) -> T: ...
@overload
def field(**about: Any) -> Any: ...
def field(
    *,
    default: Any = _REQUIRED,
    factory: Callable[[], Any] | None = None,
    **about: Any,
) -> Any:
    """Declare a field of a dataclass that stands in a file; how, its annotation says.

    `bool`, `int`, `float`, `str`, a `Literal` or an `Enum` of words, `Vector`, tuples of numbers or
    texts, and other dataclasses with declared fields (a table; a tuple of them is a list of
    tables). `| None` with the default None makes a key optional.

    Args:
        default: where the key is absent; it must be there if there is neither this nor `factory`.
        factory: makes the default.
        about: see `_About`; and further facts for whoever asks `keys`: `shown` is the default as
            pages show it, `rows` are further rows of a page's table, for keys that `parse` reads
            beside this one.
    """
    known = {one.name for one in dataclasses.fields(_About)}
    more = {name: about.pop(name) for name in tuple(about) if name not in known}
    metadata = {_About: _About(**about, more=more)}
    if factory is not None:
        return dataclasses.field(default_factory=factory, metadata=metadata)
    if default is _REQUIRED:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True)
class _About:
    """What `field` may be told of a field."""

    absent: Any = _REQUIRED  # where the key is absent, of a field that has no default
    help: str = ""  # one line: what it means
    unit: str = ""  # of a number
    low: float = -math.inf  # <= a number, or each number of a list
    high: float = math.inf  # >= a number
    above: float = -math.inf  # < a number
    counts: Sequence[int] = ()  # how many numbers a list may have
    choices: Sequence[str] = ()  # the words that a `str` may be
    any_case: bool = False  # upper and lower case of such words count the same
    words: Mapping[str, object] = dataclasses.field(default_factory=dict)
    """Words that may stand for a value beside ordinary ones, such as `{"off": None}`."""
    key: str = ""  # in files, if not the name of the field
    parse: Parse | None = None  # reads what the annotation does not say
    expects: str = ""  # what to write, where the annotation does not say it
    convert: Callable[[Any], Any] | None = None
    """Applied to what was read; defaults are converted already."""
    more: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def limits(self) -> Limits:
        """Of a number, in figures and in words."""
        also = "".join(f', or "{word}"' for word in self.words)
        return Limits(self.low, self.high, self.above, self.unit, also)


@dataclass(frozen=True, slots=True, eq=False)
class Key:
    """One declared field of a dataclass."""

    name: str  # of the field
    key: str  # in files
    default: Callable[[], Any]  # makes the value of an absent key, `_REQUIRED` if it must be there
    wanted: str  # what to write, in words
    help: str  # one line
    more: Mapping[str, Any]  # whatever else was declared
    _about: _About
    _get: Callable[[Any, str, Any], Any]
    _whole: bool
    """The getter is asked even if the key is absent: a table whose keys may all be absent."""

    @property
    def required(self) -> bool:
        """Whether the key must be there."""
        return self.default() is _REQUIRED

    @property
    def limits(self) -> Limits:
        """Of numbers."""
        return self._about.limits

    @property
    def default_text(self) -> str:
        """The default as it would be written; empty if there is none."""
        if "shown" in self.more:
            return str(self.more["shown"])
        value = self.default()
        word = next((word for word, meant in self._about.words.items() if meant == value), None)
        if word is not None:
            return f'"{word}"'
        if value is _REQUIRED:
            return "required"
        if value is None or value in ((), {}, "", math.inf):
            return ""
        value = getattr(value, "value", value)
        if isinstance(value, bool):
            return str(value).lower()
        return f"{value:g}" if isinstance(value, float) else json.dumps(value)

    def read(self, table: Any, default: Any) -> Any:
        """The value in a table; `default` if the key is absent."""
        about = self._about
        if not table.has(self.key) and not (self._whole and default is not None):
            if default is _REQUIRED:
                raise table.error(self.key, "is missing", f"add {self.key} = {self.wanted}")
            return default
        word = table.raw(self.key)
        if isinstance(word, str) and word in about.words:
            return about.words[word]
        value = self._get(table, self.key, None if default is _REQUIRED else default)
        return value if about.convert is None else about.convert(value)


@cache
def keys(cls: type) -> tuple[Key, ...]:
    """The declared fields of a dataclass, in order."""
    hints = typing.get_type_hints(cls)
    found = []
    for one in dataclasses.fields(cls):
        about = one.metadata.get(_About)
        if about is None:
            continue
        hint = hints[one.name]
        whole = dataclasses.is_dataclass(hint) and about.parse is None
        wanted, get = _getter(hint, about)
        found.append(
            Key(
                one.name,
                about.key or one.name,
                _default_of(one),
                about.expects or wanted,
                about.help,
                about.more,
                about,
                get,
                whole,
            )
        )
    return tuple(found)


def markdown(*classes: type) -> str:
    """The rows of all declared fields as a table of a page."""
    rows = ["| Key | Value | Default | Meaning |", "|---|---|---|---|"]
    for key in (key for cls in classes for key in keys(cls)):
        rows.append(f"| `{key.key}` | {key.wanted} | {key.default_text} | {key.help} |")
        rows += (f"| `{row[0]}` | {' | '.join(row[1:])} |" for row in key.more.get("rows", ()))
    return "\n".join(dict.fromkeys(rows)) + "\n"


def _default_of(one: dataclasses.Field[Any]) -> Callable[[], Any]:
    if one.default_factory is not dataclasses.MISSING:
        return one.default_factory
    absent = one.metadata[_About].absent
    value = absent if one.default is dataclasses.MISSING else one.default
    return lambda: value


def _getter(hint: Any, about: _About) -> tuple[str, Callable[[Any, str, Any], Any]]:
    """What to write for a key of a type, and how to read it."""
    parse, limits = about.parse, about.limits
    if parse is not None:
        return about.expects, lambda table, key, default: parse(table, key)
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        return _getter(next(part for part in parts if part is not types.NoneType), about)
    if origin is tuple:
        return _list_getter(parts, about)
    if dataclasses.is_dataclass(hint):
        return "a table", lambda table, key, default: table.one(key, hint, default)
    enum = hint if isinstance(hint, type) and issubclass(hint, Enum) else None
    options = tuple(about.choices) or (tuple(one.value for one in enum) if enum else ())
    options = parts if origin is Literal else options
    if options:

        def choose(table: Any, key: str, default: object) -> object:
            word = table.choice(key, options, any_case=about.any_case)
            return word if enum is None else enum(word)

        return f"one of {', '.join(options)}{limits.also}", choose
    if hint is bool:
        return "true or false", lambda table, key, default: table.flag(key)
    if hint is int:
        return f"a whole number{limits}", lambda table, key, default: table.check_count(
            key, table.raw(key), limits, default
        )
    if hint is float:
        return f"a number{limits}", lambda table, key, default: table.check_number(
            key, table.raw(key), limits, None if about.convert else default
        )
    if hint is str:
        return "text in quotes", lambda table, key, default: table.text(key, default)
    if origin in (Mapping, dict):
        return "a table", lambda table, key, default: table.free(key)
    raise TypeError(f"nobody knows how to read a field of type {hint}; declare parse=")


def _list_getter(
    parts: tuple[Any, ...], about: _About
) -> tuple[str, Callable[[Any, str, Any], Any]]:
    """The same for tuples."""
    element, limits = parts[0], about.limits
    if dataclasses.is_dataclass(element):
        return "a list of tables", lambda table, key, default: table.all(key, element)
    if element is str:
        return "a list of texts", lambda table, key, default: table.texts(key)
    counts = about.counts or (() if parts[-1] is Ellipsis else (len(parts),))
    wanted = f"{' or '.join(map(str, counts)) or 'a list of'} numbers{limits}"

    def read(table: Any, key: str, default: object) -> tuple[Any, ...]:
        one = table.check_count if element is int else table.check_number
        found: tuple[Any, ...] = table.check_numbers(key, counts, limits, one)
        return found

    return wanted, read


def _plain(number: float) -> str:
    """A number as people write it."""
    short = isinstance(number, int) or (number == int(number) and abs(number) < 1e7)
    return str(int(number)) if short else f"{number:g}"
