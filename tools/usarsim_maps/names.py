"""Names that MuJoCo and the wire can carry, made from names that maps have."""

from __future__ import annotations

import re

__all__ = ["NameBook", "safe"]

_UNSAFE = re.compile(r"[^A-Za-z0-9_.+\-]+")

LONGEST = 120


def safe(name: str) -> str:
    """A name of letters, digits and `_ . + -` only; `unnamed` if nothing is left."""
    return _UNSAFE.sub("_", name.strip()).strip("_")[:LONGEST] or "unnamed"


class NameBook:
    """Hands out names that differ, whatever their capitals (item 69)."""

    def __init__(self, *reserved: str) -> None:
        self._taken = {name.lower() for name in reserved}
        self._next: dict[str, int] = {}

    def take(self, name: str) -> str:
        """The safe form of a name, with `-2`, `-3`, ... behind it where it is taken."""
        plain = safe(name)
        answer, number = plain, self._next.get(plain.lower(), 2)
        while answer.lower() in self._taken:
            answer = f"{plain}-{number}"
            number += 1
        self._next[plain.lower()] = number
        self._taken.add(answer.lower())
        return answer
