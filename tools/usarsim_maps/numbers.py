"""Numbers as people and exporters write them: sums by hand, decimal commas, `-1.#IND`.

Programs that read with C's `scanf` take more than a strict reader does, and authors of worlds lean
on that. What can be read in one way only is read; whatever else is a `ValueError`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

LONGEST = 200
"""Characters of one number; longer words are no sums that anybody has written."""

MAX_DEPTH = 20
"""Brackets within brackets."""

_PLAIN = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TOKEN = re.compile(rf"\s*(?:({_PLAIN})[fF]?(?![\w.])|(pi|PI|M_PI|math\.pi)(?![\w.])|([-+*/()]))")
_NOTHING = re.compile(r"[-+]?(?:1\.#(?:IND|QNAN|SNAN|INF)\d*|nan\([^()]*\)|nanf?|inff?)", re.I)
_COMMA = re.compile(r"[-+]?(?:\d*,\d+|\d+)(?:[eE][-+]?\d+)?")
"""A word whose only comma may be that of a decimal number."""

_SEPARATOR = re.compile(r"[\s,]+")
_SPREAD = re.compile(r"\s*([*/])\s*|(?<=\()\s+|\s+(?=\))")
"""Space inside a sum that cannot be space between two numbers."""


def read_number(word: str) -> float:
    """The value of a word: a number, a sum such as `-3.14/2` or `2*(1+pi)`, or a decimal comma.

    What C libraries print for values that are none, such as `nan(ind)` and `-1.#IND00`, is NaN;
    so is a division by zero. What can be read as no number is a `ValueError`.
    """
    try:
        return float(word)
    except ValueError:
        pass
    word = word.strip().replace("\N{MINUS SIGN}", "-")
    if len(word) > LONGEST:
        raise ValueError(f"{word[:40]!r}... is no number")
    if _NOTHING.fullmatch(word):
        return math.nan
    if "," in word and _COMMA.fullmatch(word):
        return float(word.replace(",", "."))
    return _Sum(word).value()


def read_numbers(text: str, *counts: int) -> list[float]:
    """All numbers of a text, separated by space or commas.

    Args:
        text: such as `1 2 3`, `1, 2, 3` or, if three numbers are wanted, `1,5 2 3`.
        counts: how many numbers there may be. They decide what commas mean; without any, commas
            separate.

    Raises:
        ValueError: a word is no number, or commas can be read in two ways.
    """
    words = text.split()
    if not any(sign in text for sign in ",*/()"):
        return [read_number(word) for word in words]
    words = _SPREAD.sub(r"\1", text).split()
    if "," in text:
        apart = [word for word in _SEPARATOR.split(text) if word]
        decimal = len(words) in counts and "." not in text and all(map(_COMMA.fullmatch, words))
        if decimal and len(apart) in counts:
            raise ValueError(f"{text[:40]!r} can be read in two ways; write decimal points")
        words = words if decimal else apart
    return [read_number(word) for word in words]


def read_whole(word: str | bytes) -> int:
    """A whole number, also one written as `3.0`; else a `ValueError`."""
    try:
        return int(word)
    except ValueError:
        value = float(word)
    if not value.is_integer():
        raise ValueError(f"{word[:40]!r} is no whole number")
    return int(value)


class _Sum:
    """An expression of numbers, pi, the four operations and brackets."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens: list[str | float] = []
        place = 0
        while place < len(text):
            found = _TOKEN.match(text, place)
            if found is None:
                raise self._wrong()
            number, pi, sign = found.groups()
            self._tokens.append(sign or (math.pi if pi else float(number)))
            place = found.end()
        self._tokens.reverse()  # the next one is the last

    def value(self) -> float:
        """Of the whole text."""
        try:
            value = self._added(0)
        except (IndexError, TypeError):
            raise self._wrong() from None
        if self._tokens:
            raise self._wrong()
        return value

    def _wrong(self) -> ValueError:
        return ValueError(f"{self._text[:40]!r} is no number")

    def _next(self, signs: Sequence[str]) -> str:
        """The next sign if it is one of these; empty if not."""
        if self._tokens and isinstance(self._tokens[-1], str) and self._tokens[-1] in signs:
            return str(self._tokens.pop())
        return ""

    def _added(self, depth: int) -> float:
        value = self._multiplied(depth)
        while sign := self._next("+-"):
            other = self._multiplied(depth)
            value = value + other if sign == "+" else value - other
        return value

    def _multiplied(self, depth: int) -> float:
        value = self._single(depth)
        while sign := self._next("*/"):
            other = self._single(depth)
            if sign == "*":
                value *= other
            else:
                value = value / other if other else math.nan
        return value

    def _single(self, depth: int) -> float:
        if depth > MAX_DEPTH:
            raise self._wrong()
        if sign := self._next("+-"):
            value = self._single(depth + 1)
            return -value if sign == "-" else value
        if self._next("("):
            value = self._added(depth + 1)
            if not self._next(")"):
                raise self._wrong()
            return value
        token = self._tokens.pop()
        if isinstance(token, str):
            raise self._wrong()
        return token
