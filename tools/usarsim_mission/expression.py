"""The expression that makes points of counts and shares: numbers, + - * / ^, ( ), min, max, clamp.

A text becomes a tree of `Node`s by recursive descent. Each variable has a range in which its value
lies, and the tree is checked by interval arithmetic: where a divisor may be 0, a power may have no
value or a result may leave the numbers, the expression is refused before anything runs. So
`value` cannot fail. Ranges do not know that two variables hang together; where `V - VF` divides,
`max(1, V - VF)` says what is meant.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from usarsim_server.base.tables import suggest

MAX_DEPTH = 50
"""Parentheses, signs and powers within each other."""
MAX_LENGTH = 2000
"""Characters."""
GREATEST = 1e15
"""No part of an expression may become greater, so that counts stay exact."""

Range = tuple[float, float]
"""The least and the greatest value of something."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[^\W\d]\w*)|(?P<sign>\S))"
)
_FUNCTIONS = {"min": (2, None), "max": (2, None), "clamp": (1, 3)}
"""Least and greatest number of arguments."""


class ExpressionError(ValueError):
    """An expression cannot be used.

    Attributes:
        column: where, from 1.
        line: of the text, from 1.
        where: both in words; the line only of a text that has several.
    """

    def __init__(self, problem: str, cure: str, text: str, place: int) -> None:
        self.line = text.count("\n", 0, place) + 1
        self.column = place - text.rfind("\n", 0, place)
        self.problem, self.cure = problem, cure
        line = f"line {self.line}, " if "\n" in text else ""
        self.where = f"{line}column {self.column}"
        super().__init__(f"{self.where}: {problem} ({cure})")


@dataclass(frozen=True, slots=True)
class Node:
    """A number, a variable or something made of them; `place` is its character in the text."""

    kind: str  # "number", a sign, "negative", the name of a function or of a variable
    place: int
    number: float = 0.0
    parts: tuple[Node, ...] = ()


class Expression:
    """One expression.

    Attributes:
        text: as it was written.
        names: of the variables in it.
    """

    def __init__(self, text: str, ranges: Mapping[str, Range]) -> None:
        """Read and check a text.

        Args:
            text: of the expression.
            ranges: of every variable that may stand in it.

        Raises:
            ExpressionError: it is none, or has no value somewhere in the ranges.
        """
        self.text = text
        self._root = _Parser(text, tuple(ranges)).whole()
        self.names = frozenset(one.kind for one in _all(self._root) if one.kind in ranges)
        self.check(ranges)

    def check(self, ranges: Mapping[str, Range]) -> Range:
        """The range of its value; the variables may be known better by now.

        Raises:
            ExpressionError: it has no value somewhere in the ranges.
        """
        return _range(self._root, ranges, self.text)

    def value(self, variables: Mapping[str, float]) -> float:
        """Its value; each variable has to be in its range."""
        return _value(self._root, variables)

    def summands(self, variables: Mapping[str, float]) -> list[tuple[frozenset[str], float]]:
        """What it adds up, products of sums multiplied out: names of variables, and values."""
        names = frozenset(variables)
        return [(found & names, value) for found, value in _summands(self._root, variables)]


class _Parser:
    """sum = product {(+|-) product}; product = signed {(*|/) signed};
    signed = (-|+) signed | power; power = atom [^ signed]."""

    def __init__(self, text: str, names: tuple[str, ...]) -> None:
        self._text, self._names, self._depth = text, names, 0
        if len(text) > MAX_LENGTH:
            raise ExpressionError("is too long", f"use {MAX_LENGTH} characters", text, MAX_LENGTH)
        found = list(_TOKEN.finditer(text))
        self._tokens = [(one.lastgroup or "", one[one.lastgroup or 0], one) for one in found]
        self._next = 0

    def whole(self) -> Node:
        """All of the text."""
        if not self._tokens:
            raise ExpressionError("is empty", "write an expression such as VC", self._text, 0)
        node = self._sum()
        if self._next < len(self._tokens):
            what = "there is one ) too many" if self._sign() == ")" else "an operator is missing"
            raise self._error(f"{what} before {self._word()!r}", "use + - * / ^ between values")
        return node

    def _sum(self) -> Node:
        return self._row(("+", "-"), self._product)

    def _product(self) -> Node:
        return self._row(("*", "/"), self._signed)

    def _row(self, signs: tuple[str, str], part: Callable[[], Node]) -> Node:
        node = part()
        while (sign := self._sign()) in signs:
            place = self._place()
            self._next += 1
            node = Node(sign, place, parts=(node, part()))
        return node

    def _signed(self) -> Node:
        sign, place = self._sign(), self._place()
        if sign not in ("-", "+"):
            return self._power()
        self._next += 1
        inner = self._deeper(self._signed)
        return inner if sign == "+" else Node("negative", place, parts=(inner,))

    def _power(self) -> Node:
        base = self._atom()
        if self._sign() != "^":
            return base
        place = self._place()
        self._next += 1
        return Node("^", place, parts=(base, self._deeper(self._signed)))

    def _atom(self) -> Node:
        place = self._place()
        if self._next >= len(self._tokens):
            raise self._error("a value is missing at the end", "write a number or a variable")
        kind, word, _ = self._tokens[self._next]
        if kind == "number":
            self._next += 1
            number = float(word)
            if number > GREATEST:
                raise ExpressionError(f"{word} is too large", "use less", self._text, place)
            return Node("number", place, number)
        if word == "(":
            self._next += 1
            node = self._deeper(self._sum)
            self._expect(")")
            return node
        if kind != "name":
            cure = "write a number, a variable or ("
            raise self._error(f"{word!r} stands where a value should", cure)
        self._next += 1
        if self._sign() == "(":
            return self._call(word, place)
        if word not in self._names:
            raise self._unknown(word, place)
        return Node(word, place)

    def _call(self, word: str, place: int) -> Node:
        if word not in _FUNCTIONS:
            cure = suggest(word, tuple(_FUNCTIONS))
            raise ExpressionError(f"there is no function {word}", cure, self._text, place)
        self._next += 1
        parts = [self._deeper(self._sum)]
        while self._sign() == ",":
            self._next += 1
            parts.append(self._deeper(self._sum))
        self._expect(")")
        least, most = _FUNCTIONS[word]
        if len(parts) < least or (most is not None and len(parts) > most) or len(parts) > 100:
            takes = {"clamp": "clamp(x) or clamp(x, least, most)"}.get(word, f"{word}(a, b)")
            problem = f"{word} does not take {len(parts)} values"
            raise ExpressionError(problem, f"write {takes}", self._text, place)
        if word == "clamp" and len(parts) == 2:
            cure = "write clamp(x) or clamp(x, least, most)"
            raise ExpressionError("clamp does not take 2 values", cure, self._text, place)
        return Node(word, place, parts=tuple(parts))

    def _unknown(self, word: str, place: int) -> ExpressionError:
        if word == "total":
            cure = "write it with the variables, without total"
            return ExpressionError("total stands in itself", cure, self._text, place)
        if word in _FUNCTIONS:
            return ExpressionError(f"{word} has no ( )", f"write {word}(...)", self._text, place)
        cure = suggest(word, self._names)
        return ExpressionError(f"unknown variable {word}", cure, self._text, place)

    def _deeper(self, part: Callable[[], Node]) -> Node:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._error("is nested too deeply", f"nest at most {MAX_DEPTH} deep")
        node = part()
        self._depth -= 1
        return node

    def _expect(self, sign: str) -> None:
        if self._sign() != sign:
            raise self._error(f"{sign} is missing", "close what was opened")
        self._next += 1

    def _sign(self) -> str:
        if self._next >= len(self._tokens):
            return ""
        kind, word, _ = self._tokens[self._next]
        return word if kind == "sign" else ""

    def _word(self) -> str:
        return self._tokens[self._next][1]

    def _place(self) -> int:
        if self._next >= len(self._tokens):
            return len(self._text.rstrip())
        kind, _, match = self._tokens[self._next]
        return match.start(kind)

    def _error(self, problem: str, cure: str) -> ExpressionError:
        return ExpressionError(problem, cure, self._text, self._place())


def _all(node: Node) -> Iterator[Node]:
    yield node
    for part in node.parts:
        yield from _all(part)


def _value(node: Node, variables: Mapping[str, float]) -> float:
    if node.kind == "number":
        return node.number
    if not node.parts:
        return variables[node.kind]
    return _applied(node.kind, [_value(part, variables) for part in node.parts])


def _summands(node: Node, variables: Mapping[str, float]) -> Iterator[tuple[frozenset[str], float]]:
    """The names and values of what a node adds up; what is no sum is one summand."""
    match node.kind, node.parts:
        case ("+" | "-") as sign, (a, b):
            yield from _summands(a, variables)
            for names, value in _summands(b, variables):
                yield names, value if sign == "+" else -value
        case "negative", (a,):
            for names, value in _summands(a, variables):
                yield names, -value
        case "*", (a, b):
            right = list(_summands(b, variables))
            for names, value in _summands(a, variables):
                for others, other in right:
                    yield names | others, value * other
        case "/", (a, b):
            below, divisor = frozenset(one.kind for one in _all(b)), _value(b, variables)
            for names, value in _summands(a, variables):
                yield names | below, value / divisor
        case _:
            yield frozenset(one.kind for one in _all(node)), _value(node, variables)


def _applied(kind: str, values: list[float]) -> float:
    """An operator or a function of values for which it has a value."""
    match kind, values:
        case "negative", [a]:
            return -a
        case "+", [a, b]:
            return a + b
        case "-", [a, b]:
            return a - b
        case "*", [a, b]:
            return a * b
        case "/", [a, b]:
            return a / b
        case "^", [a, b]:
            return float(a**b)
        case "clamp", [a]:
            return min(max(a, 0.0), 1.0)
        case "clamp", [a, least, most]:
            return min(max(a, least), most)
        case "max", _:
            return max(values)
    return min(values)


def _range(node: Node, ranges: Mapping[str, Range], text: str) -> Range:
    """The least and greatest value of a node; an operator's lie where its parts have theirs."""
    if node.kind == "number":
        return node.number, node.number
    if not node.parts:
        return ranges[node.kind]
    parts = [_range(part, ranges, text) for part in node.parts]
    if node.kind == "/" and parts[1][0] <= 0.0 <= parts[1][1]:
        what = "is" if parts[1] == (0.0, 0.0) else "may be"
        problem = f"division by zero: what stands below / {what} 0"
        cure = "divide by max(1, ...), or by what is never 0"
        raise ExpressionError(problem, cure, text, node.place)
    if node.kind == "^":
        _check_power(node, parts[0], parts[1], text)
    ends = [_applied(node.kind, list(one)) for one in _corners(parts)] if parts else []
    if node.kind == "^" and parts[0][0] < 0.0 < parts[0][1]:
        ends.append(0.0)  # an even power is least in the middle
    least, most = min(ends), max(ends)
    if max(-least, most) > GREATEST:
        cure = f"keep it below {GREATEST:g}, for example by min(...)"
        raise ExpressionError("its value may become too large", cure, text, node.place)
    return least, most


def _corners(parts: list[Range]) -> Iterator[tuple[float, ...]]:
    """The ends of ranges; of many, which only min and max have, all least and all greatest."""
    if len(parts) > 3:
        yield tuple(low for low, _ in parts)
        yield tuple(high for _, high in parts)
        return
    ends: list[tuple[float, ...]] = [()]
    for part in parts:
        ends = [(*end, value) for end in ends for value in part]
    yield from ends


def _check_power(node: Node, base: Range, exponent: Range, text: str) -> None:
    """Refuse powers without a value, and such as leave the numbers."""
    whole = exponent[0] == exponent[1] and exponent[0] == math.floor(exponent[0])
    if base[0] < 0.0 and not whole:
        cure = "use a whole number above ^, or max(0, ...) below it"
        raise ExpressionError("the power of a negative number", cure, text, node.place)
    if base[0] <= 0.0 <= base[1] and exponent[0] < 0.0:
        cure = "divide by max(1, ...), or by what is never 0"
        raise ExpressionError("division by zero: a negative power of 0", cure, text, node.place)
    largest = max(abs(base[0]), abs(base[1]), 1.0)
    smallest = min(abs(base[0]), abs(base[1])) or 1.0
    digits = max(
        exponent[1] * math.log10(largest), exponent[0] * math.log10(min(smallest, 1.0)), 0.0
    )
    if digits > 300.0 or max(abs(exponent[0]), abs(exponent[1])) > 300.0:
        cure = "use a smaller power"
        raise ExpressionError("its value may become too large", cure, text, node.place)
