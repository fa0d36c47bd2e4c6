"""Segments, lines and bytes: the rules every message obeys (protocol reference 1.3)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache

from usarsim_server.protocol.numbers import boolean, fixed, printable, vector

_BRACES = str.maketrans("{}", "()")
# Blanks and ASCII control characters; bytes above 127 belong to names and pass through.
_BLANKS = re.compile(r"[\x00-\x20\x7f]+")
_DIGITS = b"0123456789.,-"
_LONG_FRAME = 4096
"""Bytes without digits from which on a report is not remembered."""
# In lines that each end with CR LF: any other control character, blanks at either end of a line,
# runs of them, empty lines.
_UNTIDY = re.compile(rb"[\x00-\x09\x0b\x0c\x0e-\x1f\x7f]|  | \r|(?:\A|\n)[ \r]")


def encode(text: str) -> bytes:
    """Return the bytes of one line, ended by CR LF; nothing for an empty line.

    Runs of blanks, tabs, line ends and other control characters shrink to one blank and vanish at
    the ends, whatever a name contains. Characters outside Latin-1 become question marks.
    """
    if not text.isprintable() or "  " in text or text[:1] == " " or text[-1:] == " ":
        text = _BLANKS.sub(" ", text).strip(" ")
    return text.encode("latin-1", "replace") + b"\r\n" if text else b""


def encode_all(texts: Sequence[str]) -> list[bytes]:
    """Encode many lines, such as those of a report, each as `encode` does.

    Nearly all lines need no change. Without digits and points those of many reports are the same,
    and short; what is tidy then is tidy with them.
    """
    raw = "\r\n".join((*texts, "")).encode("latin-1", "replace")
    frame = raw.translate(None, _DIGITS)
    if len(frame) < _LONG_FRAME and _is_tidy(frame):
        lines = raw.splitlines(keepends=True)
        if len(lines) == len(texts):  # else one has a line end inside
            return lines
    return [encode(text) for text in texts]


@lru_cache(maxsize=256)
def _is_tidy(lines: bytes) -> bool:
    return _UNTIDY.search(lines) is None


def line(head: str, *segments: str) -> str:
    """Join a head and its segments with single blanks."""
    return " ".join((head, *segments))


def listing(head: str, wire_type: str, body: Sequence[str]) -> str:
    """What is told of the items of a type, in one line; nothing gives an empty text."""
    return line(head, segment("Type", wire_type), *body) if body else ""


def segment(key: str, value: str = "") -> str:
    """`{Key value}`, or `{Key}` for an empty value; braces inside become parentheses."""
    text = f"{key} {value}" if value else key
    if "{" in text or "}" in text:
        text = text.translate(_BRACES)
    return f"{{{text}}}"


@lru_cache(maxsize=4096)
def label(key: str, value: str) -> str:
    """`segment` for what never changes, such as types and names; remembered."""
    return segment(key, value)


def number(key: str, value: float, digits: int) -> str:
    """A segment with one decimal number."""
    return segment(key, fixed(value, digits))


def numbers(items: Sequence[tuple[str, float]], digits: int) -> list[str]:
    """Segments with one decimal number each, for `line`; names become words, see `token`.

    For names that come again and again, such as those of joints.
    """
    if not items:
        return []
    names, values = zip(*items, strict=True)
    nearest = printable(values, digits)
    if nearest is None:
        return [number(token(name), value, digits) for name, value in items]
    return [_frame(names, digits) % nearest]


@lru_cache(maxsize=256)
def _frame(names: tuple[str, ...], digits: int) -> str:
    """What `numbers` gives, with templates for the numbers."""
    return " ".join([segment(token(one).replace("%", "%%"), f"%.{digits}f") for one in names])


def count(key: str, value: float) -> str:
    """A segment with an integer."""
    return segment(key, fixed(value, 0))


def flag(key: str, value: bool) -> str:
    """A segment with a boolean."""
    return segment(key, boolean(value))


def triple(key: str, values: Iterable[float], digits: int) -> str:
    """A segment with a vector."""
    return segment(key, vector(values, digits))


@lru_cache(maxsize=64)
def time_segment(time: float, digits: int) -> str:
    """The Time segment: simulated seconds, never negative.

    Remembered, because all lines of all robots at one instant have the same.
    """
    return number("Time", max(time, 0.0), digits)


def token(text: str) -> str:
    """The text as one word: no blanks, no braces, never empty."""
    return _BLANKS.sub("_", text.strip()).translate(_BRACES) or "_"
