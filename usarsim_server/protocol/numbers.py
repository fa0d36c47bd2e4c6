"""Numbers, booleans and vectors, in and out (protocol reference 2.1 to 2.3).

Reading is tolerant and total: every text has a value and it is always finite. Printing is strict:
a decimal point whatever the locale, a fixed number of digits, never an exponent, `nan`, `inf` or a
negative zero.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAX_MAGNITUDE = 1e15
"""Largest magnitude that is read or printed; anything beyond is clamped.

Far outside every physical quantity, yet sums and products of a few such numbers stay finite, and
whole numbers up to here are exact in double precision.
"""

_SLACK = 1e-3
"""Part of the last printed digit by which a value may fall short and still count as reached.

Absorbs binary representation and accumulated rounding (0.098 is 0.09799.. somewhere along the
way, the clock shows 63.3999999), not real differences: 1.9999999 prints 2.00, 1.999 prints 1.99.
"""

_TRUE = frozenset({"true", "1", "yes", "on"})
_FALSE = frozenset({"false", "0", "no", "off"})
_NUMBER = re.compile(
    r"[ \t]*([+-]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?)", re.ASCII
)
# Digits, comma, digits and no point; a further comma would make it a list.
_DECIMAL_COMMA = re.compile(
    r"[ \t]*([+-]?[0-9]++),([0-9]++(?:[eE][+-]?[0-9]++)?+)(?![.,])", re.ASCII
)
# One blank separated component of a vector, comma as decimal point allowed.
_COMPONENT = re.compile(
    r"[+-]?(?:[0-9]+(?:\.[0-9]*|,[0-9]+)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", re.ASCII
)
_BLANK_RUN = re.compile(r"[ \t]+")
_SEPARATOR_RUN = re.compile(r"[, \t]+")
# More digits than a double can tell apart; keeps a hostile 64 KiB number cheap.
_MAX_NUMBER_TEXT = 400


def read_number(text: str) -> float:
    """Read the number a text begins with; 0 if there is none.

    Accepts a sign, a missing leading zero, an exponent, a decimal comma between digits, leading
    blanks and trailing junk. Never returns nan or an infinity; magnitudes beyond `MAX_MAGNITUDE`
    are clamped to it.
    """
    text = text[:_MAX_NUMBER_TEXT]
    if "," in text and (comma := _DECIMAL_COMMA.match(text)):
        value = float(f"{comma[1]}.{comma[2]}")
    elif plain := _NUMBER.match(text):
        value = float(plain[1])
    else:
        return 0.0
    if not -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE:
        return math.copysign(MAX_MAGNITUDE, value)
    return value + 0.0  # turns a negative zero into a plain one


def is_number(text: str) -> bool:
    """Whether a text begins with a number, so that `read_number` does not make one up."""
    text = text[:_MAX_NUMBER_TEXT]
    return bool(_DECIMAL_COMMA.match(text) or _NUMBER.match(text))


def is_bool(text: str) -> bool:
    """Whether a text says either; `read_bool` takes all others for false."""
    return text.strip(" \t").lower() in _TRUE | _FALSE


def vector_parts(text: str) -> list[str]:
    """The parts of a text that `read_vector` takes for numbers, surplus ones too."""
    return [part for part in _SEPARATOR_RUN.split(text) if part]


def read_int(text: str) -> int:
    """Read a number as `read_number` does and truncate it toward zero."""
    return int(read_number(text))


def read_bool(text: str) -> bool:
    """Whether the text is `true`, `1`, `yes` or `on` in any case."""
    return text.strip(" \t").lower() in _TRUE


def read_vector(text: str, count: int = 3) -> tuple[float, ...]:
    """Read `count` numbers that are separated by commas, blanks or both.

    Blanks separate first: if they give exactly `count` numbers, a comma inside one of them is a
    decimal comma (`0,5 1,0 1,8`), also when a comma stands before each blank
    (`0,0000, 0,0000, 0,0000`, the six-part form of .NET clients). Everything else is split at
    every run of commas and blanks. Missing components are 0, surplus ones are ignored.
    """
    tokens = _BLANK_RUN.split(text.strip(" \t"))
    if len(tokens) == count:
        if all(token.endswith(",") for token in tokens[:-1]):
            tokens = [token.removesuffix(",") for token in tokens[:-1]] + tokens[-1:]
        if all(_COMPONENT.fullmatch(token) for token in tokens):
            return tuple(read_number(token) for token in tokens)
    parts = [part for part in _SEPARATOR_RUN.split(text) if part][:count]
    numbers = [read_number(part) for part in parts]
    return (*numbers, *(0.0,) * (count - len(numbers)))


def read_triple(text: str) -> tuple[float, float, float]:
    """Read three numbers as `read_vector` does."""
    x, y, z = read_vector(text, 3)
    return x, y, z


_EXACT = 1e14
"""Decimal digits up to which doubles tell all numbers apart."""


def fixed(value: float, digits: int) -> str:
    """Print a number with exactly `digits` digits after the point, truncated toward zero.

    The original's formatter truncates, too (protocol reference 2.1). Values that miss the next
    step by less than a thousandth of the last digit are taken up to it. Not-a-number and
    infinities print as 0.
    """
    value = float(value)
    scale, template = _scale_and_template(digits)
    scaled = value * scale
    if -_EXACT < scaled < _EXACT:
        # The nearest double of so few digits prints as just these.
        return template % (int(scaled + (_SLACK if scaled >= 0.0 else -_SLACK)) / scale)
    if not math.isfinite(value):
        return template % 0.0
    scaled = min(max(value, -MAX_MAGNITUDE), MAX_MAGNITUDE) * scale
    units = int(scaled + math.copysign(_SLACK, scaled))
    text = f"{abs(units):0{digits + 1}d}"
    sign = "-" if units < 0 else ""
    return f"{sign}{text[:-digits]}.{text[-digits:]}" if digits else f"{sign}{text}"


@cache
def _scale_and_template(digits: int) -> tuple[float, str]:
    return 10.0**digits, f"%.{digits}f"


@lru_cache(maxsize=256)
def _joined_template(digits: int, count: int) -> str:
    return ",".join([_scale_and_template(digits)[1]] * count)


def single(value: float, digits: int) -> str:
    """Print a number as the original's own formatter does: single precision, truncated.

    There is no slack: 1.3 is a little less than that in single precision and prints 1.2999, as
    recorded from the original, and a small negative number keeps its sign (side channels
    reference 3.2). Not-a-number and infinities print as 0.

    Args:
        value: to print.
        digits: digits after the point, at least one.
    """
    value = float(value)
    if not math.isfinite(value):
        value = 0.0
    nearest = float(np.float32(min(max(value, -MAX_MAGNITUDE), MAX_MAGNITUDE)))
    # 24 significant bits times a power of ten below 2^29 is exact in double precision.
    units = f"{int(abs(nearest) * 10.0**digits):0{digits + 1}d}"
    return f"{'-' if nearest < 0.0 else ''}{units[:-digits]}.{units[-digits:]}"


def vector(values: Iterable[float], digits: int) -> str:
    """Print numbers joined by commas without blanks, each as `fixed` does."""
    numbers = [float(value) for value in values]
    nearest = printable(numbers, digits)
    if nearest is None:
        return ",".join([fixed(one, digits) for one in numbers])
    return _joined_template(digits, len(numbers)) % nearest


def printable(values: Iterable[float], digits: int) -> tuple[float, ...] | None:
    """Numbers that plain `%` formatting with so many digits prints as `fixed` prints these; None if
    there are none, for too large ones."""
    scale, _ = _scale_and_template(digits)
    nearest = []
    for value in values:
        scaled = value * scale
        if not -_EXACT < scaled < _EXACT:
            return None
        nearest.append(int(scaled + (_SLACK if scaled >= 0.0 else -_SLACK)) / scale)
    return tuple(nearest)


def ranges(values: ArrayLike, digits: int) -> str:
    """Print an array of numbers like `vector`, fast enough for scans of a thousand beams.

    Args:
        values: numbers of any shape, taken row by row.
        digits: digits after the point.
    """
    numbers = np.asarray(values, dtype=np.float64).ravel()
    if digits not in _TABLED or not len(numbers):
        return vector(numbers.tolist(), digits)
    # Called as they are: the methods of arrays take twice as long.
    least, most = np.minimum.reduce(numbers), np.maximum.reduce(numbers)
    if not (least > -_WHOLE and most < _WHOLE):
        return vector(numbers.tolist(), digits)
    if digits <= _FEW and least >= 0.0 and most < _SHORT:
        texts = _short_texts(digits).take((numbers * 10.0**digits + _SLACK).astype(np.intp))
        return texts.tobytes().translate(None, _FILL)[1:].decode("ascii")
    scaled = numbers * 10.0**digits
    units = (scaled + np.copysign(_SLACK, scaled)).astype(np.int64)
    whole, rest = np.divmod(np.abs(units), 10**digits)
    whole[units < 0] += _WHOLE + 1
    before, behind = _texts(digits)
    text = np.empty((len(units), 2), dtype=before.dtype)
    text[:, 0], text[:, 1] = before.take(whole), behind.take(rest)
    # The first comma is one too many.
    return text.tobytes().translate(None, _FILL)[1:].decode("ascii")


_TABLED = range(1, 5)
"""Numbers of digits for which `ranges` looks numbers up."""
_WHOLE = 10_000
"""Whole numbers up to which it does."""
_FEW, _SHORT = 2, 99.0
"""Digits up to which, and number below which, it does so by one step, as for most scans."""
_FILL = b"\0"


@cache
def _short_texts(digits: int) -> NDArray[np.uint64]:
    """A comma and the whole number, eight characters each, filled up."""
    return _filled([f",{units / 10**digits:.{digits}f}" for units in range(100 * 10**digits)])


@cache
def _texts(digits: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Eight characters each, filled up: a comma, whole numbers and a point, first without and then
    with a minus sign; the digits behind the point."""
    before = [f",{sign}{number}." for sign in ("", "-") for number in range(_WHOLE + 1)]
    behind = [f"{number:0{digits}d}" for number in range(10**digits)]
    return _filled(before), _filled(behind)


def _filled(texts: list[str]) -> NDArray[np.uint64]:
    return np.frombuffer(b"".join([text.encode().rjust(8, _FILL) for text in texts]), np.uint64)


def boolean(value: bool) -> str:
    """`True` or `False`, the only spellings clients know."""
    return "True" if value else "False"
