"""The little YAML that map servers write: `key: value` lines with numbers, texts and flat lists."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TypeAlias

from usarsim_server.errors import MapImportError, at

Value: TypeAlias = str | list[str]

MAX_LINES = 10_000
CURE = "write lines such as `resolution: 0.05`"

_KEY = re.compile(r"^([A-Za-z_][\w./-]*)\s*:(?:\s+(.*))?$")


def read_yaml(path: Path, text: str) -> dict[str, Value]:
    """Keys of the outermost level; values stay texts. Nested tables are passed over.

    Raises:
        MapImportError: naming the line that makes no sense.
    """
    found: dict[str, Value] = {}
    key, pending = "", ""
    lines = text.split("\n")
    if len(lines) > MAX_LINES:
        raise MapImportError(at(path, f"{len(lines)} lines", "give the YAML file of a map"))
    for number, raw in enumerate(lines, start=1):
        line = _without_comment(raw)
        bare = line.strip()
        if not bare or bare in ("---", "...") or bare.startswith("%"):
            continue
        if pending:
            pending += " " + bare
            if "]" in bare:
                found[key], pending = _flow(path, number, pending), ""
            continue
        if bare.startswith("- ") or bare == "-":
            value = found.setdefault(key, [])
            if not key or (isinstance(value, str) and value):
                raise _wrong(path, number, raw)
            items = value if isinstance(value, list) else []
            items.append(_plain(bare[1:]))
            found[key] = items
            continue
        if line[:1] in (" ", "\t"):
            continue
        match = _KEY.match(bare)
        if match is None:
            raise _wrong(path, number, raw)
        key, value = match[1], (match[2] or "").strip()
        if value.startswith("[") and "]" not in value:
            pending = value
        elif value.startswith("["):
            found[key] = _flow(path, number, value)
        else:
            found[key] = _plain(value)
    if pending:
        raise _wrong(path, len(lines), pending)
    return found


def _without_comment(line: str) -> str:
    """The line up to a ` #` outside quotes."""
    quote = ""
    for place, letter in enumerate(line):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        elif letter == "#" and (place == 0 or line[place - 1] in " \t"):
            return line[:place].rstrip()
    return line.rstrip()


def _flow(path: Path, line: int, text: str) -> list[str]:
    inside, end, rest = text[1:].partition("]")
    if not end or rest.strip() or "[" in inside:
        raise _wrong(path, line, text)
    return [_plain(part) for part in inside.split(",") if part.strip()]


def _plain(text: str) -> str:
    text = text.strip()
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    return text


def _wrong(path: Path, line: int, text: str) -> MapImportError:
    problem = f"{text.strip()[:60]!r} is not understood"
    return MapImportError(at(path, problem, CURE, where=f"line {line}"))
