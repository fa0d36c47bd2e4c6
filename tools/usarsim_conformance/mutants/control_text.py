"""What the small server reads and writes: numbers, segments, items in either form."""

from __future__ import annotations

import math
import re

_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?")
_PLAIN = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|\.\d+)")


def fixed(value: float, digits: int) -> str:
    """A number with so many digits after the point."""
    return f"{value:.{digits}f}"


def vector(values: list[float] | tuple[float, ...], digits: int) -> str:
    """Numbers joined by commas."""
    return ",".join(fixed(value, digits) for value in values)


def pairs_of(line: str) -> list[tuple[str, str]]:
    """Name and value of every segment."""
    found = re.findall(r"\{([^{}]*)\}", line)
    parts = (text.strip().replace("\t", " ").partition(" ") for text in found)
    return [(name, value.strip()) for name, _, value in parts]


def read_number(text: str) -> float:
    """A number at the beginning of a text; 0 for anything else, never infinite."""
    found = _NUMBER.match(text.strip())
    value = float(found[0].replace(",", ".")) if found else 0.0
    return max(-1e6, min(1e6, value)) if math.isfinite(value) else 0.0


def read_vector(text: str) -> list[float]:
    """Three numbers between commas or blanks, decimal commas included; missing ones are 0."""
    words = text.split()
    if len(words) == 3 and all(_PLAIN.fullmatch(word) for word in words):
        return [read_number(word) for word in words]
    numbers = [read_number(word) for word in re.split(r"[ ,]+", text.strip()) if word]
    return [*numbers, 0.0, 0.0, 0.0][:3]
