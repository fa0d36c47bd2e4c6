"""Adds the line to errors of a TOML file: finds where a table or a key is written."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from usarsim_study.errors import StudyError

_ENTRY = re.compile(r"\[\[(?P<name>[\w-]+)\]\] (?P<number>\d+)")
_HEADER = re.compile(r"^[ \t]*\[", re.MULTILINE)


def line_of(text: str, where: str) -> int | None:
    """The line, from 1, of a place as errors name it: `[[form]] 2 (tlx): [[item]] 3: low`.

    Args:
        text: of the file.
        where: the place; tables are joined by `: `, the last part may be a key.

    Returns:
        None if it is written in a way that this function does not know.
    """
    start, path, found = 0, "", False
    key = ""
    for part in where.split(": "):
        entry = _ENTRY.match(part)
        if entry is not None:
            path = f"{path}.{entry['name']}" if path else entry["name"]
            header = rf"^[ \t]*\[\[[ \t]*{re.escape(path)}[ \t]*\]\]"
            matches = list(re.finditer(header, text[start:], re.MULTILINE))
            if len(matches) < int(entry["number"]):
                return None
            start += matches[int(entry["number"]) - 1].end()
            found = True
        elif part.startswith("[") and part.endswith("]"):
            path = part.strip("[]")
            match = re.search(rf"^[ \t]*\[[ \t]*{re.escape(path)}[ \t]*\]", text, re.MULTILINE)
            if match is None:
                return None
            start, found = match.end(), True
        else:
            key = part
            break
    following = _HEADER.search(text, start)
    body = text[start : following.start() if following else len(text)]
    match = re.search(rf"^[ \t]*\"?{re.escape(key)}\"?[ \t]*=", body, re.MULTILINE) if key else None
    if match is None and not found:
        return None
    return 1 + text.count("\n", 0, start + (match.end() if match else 0))


@contextmanager
def telling_lines(path: Path, text: str) -> Iterator[None]:
    """Errors of the block that name a place in this file also name its line."""
    try:
        yield
    except StudyError as error:
        message = str(error)
        place, found, rest = message.removeprefix(f"{path}: ").rpartition(" (")
        if not found or not message.startswith(f"{path}: ") or place.startswith("line "):
            raise
        parts = place.split(": ")
        for count in range(len(parts) - 1, 0, -1):
            line = line_of(text, ": ".join(parts[:count]))
            if line is not None:
                raise StudyError(f"{path}: line {line}: {place} ({rest}") from None
        raise
