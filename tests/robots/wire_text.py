"""Reads types and values out of lines, for tests."""

from __future__ import annotations

import re

DIALECTS = ("ut2004", "udk")


def kind(line: str) -> str:
    """Value of the first Type segment, empty if there is none."""
    found = re.search(r"\{Type (\w+)\}", line)
    return found.group(1) if found is not None else ""


def values(line: str, key: str) -> list[str]:
    """Values of a key, of segments of their own or inside a multi-pair segment."""
    return re.findall(rf"[{{ ]{key} ([^{{}} ]*)", line)
