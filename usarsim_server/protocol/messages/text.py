"""Segments, lines and bytes: the rules every message obeys (protocol reference 1.3)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache

from usarsim_server.protocol.numbers import boolean, fixed, vector

_BRACES = str.maketrans("{}", "()")
# Blanks and ASCII control characters; bytes above 127 belong to names and pass through.
_BLANKS = re.compile(r"[\x00-\x20\x7f]+")
_BLANK_BYTES = re.compile(rb"[\x00-\x20\x7f]+")
_CONTROLS = bytes([*range(32), 127])


def encode(text: str) -> bytes:
    """Return the bytes of one line, ended by CR LF; nothing for an empty line.

    Runs of blanks, tabs, line ends and other control characters shrink to one blank and vanish at
    the ends, whatever a name contains. Characters outside Latin-1 become question marks.
    """
    raw = text.encode("latin-1", "replace")
    # To leave nothing out is the fastest way through a long line.
    clean = len(raw.translate(None, _CONTROLS)) == len(raw) and b"  " not in raw
    if not clean or raw[:1] == b" " or raw[-1:] == b" ":
        raw = _BLANK_BYTES.sub(b" ", raw).strip(b" ")
    return raw + b"\r\n" if raw else b""


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
