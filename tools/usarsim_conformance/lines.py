"""Lines of a server as a strict but patient client reads them; written for this kit alone."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import cached_property

_SEGMENT = re.compile(r"\{([^{}]*)\}")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def number(text: str | None) -> float:
    """The number that a text is; NaN for anything else."""
    return float(text) if text is not None and _NUMBER.fullmatch(text) else math.nan


def numbers(text: str | None) -> tuple[float, ...]:
    """Numbers between commas; NaN in the place of what is none."""
    return tuple(number(part) for part in text.split(",")) if text else ()


@dataclass(frozen=True)
class Line:
    """One line of a server."""

    raw: bytes  # all bytes, the line end included

    @cached_property
    def text(self) -> str:
        """Without the line end, one character per byte."""
        return self.raw.rstrip(b"\r\n").decode("latin-1")

    @cached_property
    def head(self) -> str:
        """The word before the first brace, as spelled."""
        return self.text.partition("{")[0].strip()

    @cached_property
    def segments(self) -> tuple[tuple[str, str], ...]:
        """Name and value of what stands in braces; a value may hold further pairs."""
        found = (body.strip().partition(" ") for body in _SEGMENT.findall(self.text))
        return tuple((name, value.strip()) for name, _, value in found)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all segments in order."""
        return tuple(name for name, _ in self.segments)

    def get(self, name: str) -> str | None:
        """Value of the first segment of a name, exactly spelled."""
        return next((value for key, value in self.segments if key == name), None)

    def number(self, name: str) -> float:
        """Value of a segment as a number; NaN if there is none."""
        return number(self.get(name))

    def numbers(self, name: str) -> tuple[float, ...]:
        """Value of a segment as numbers between commas."""
        return numbers(self.get(name))

    @property
    def type(self) -> str:
        """Value of Type, empty without one."""
        return self.get("Type") or ""

    @property
    def time(self) -> float:
        """Value of Time, NaN without one."""
        return self.number("Time")

    def items(self) -> list[dict[str, str]]:
        """What is said of each named item, whether in one segment of pairs or in several."""
        found: list[dict[str, str]] = []
        for name, value in self.segments:
            words = [name, *value.split(" ")]
            if name == "Name":
                found.append({})
            if not found:
                continue
            if name == "Name" and len(words) > 2:
                found[-1].update(zip(words[0::2], words[1::2], strict=False))
            else:
                found[-1].setdefault(name, value)
        return found

    def __str__(self) -> str:
        return self.text if len(self.text) <= 160 else f"{self.text[:120]} ... {self.text[-30:]}"


@dataclass
class Lines:
    """Cuts a stream of bytes into lines, whatever ends them; nothing of it is lost."""

    _rest: bytes = field(default=b"")

    def feed(self, data: bytes) -> list[Line]:
        """Lines that are complete now; each ends with LF, and keeps in `raw` what stands before."""
        *done, self._rest = (self._rest + data).split(b"\n")
        return [Line(text + b"\n") for text in done]

    @property
    def rest(self) -> bytes:
        """What has come of the next line."""
        return self._rest
