"""What an import has to tell its user: counts, missing files, warnings; collected, not printed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

MAX_WARNINGS = 500
"""Different warnings that are kept; a broken file could give millions."""

MAX_NAMES = 20
"""Different names that are kept for each kind of thing that was left out."""


@dataclass(frozen=True, slots=True)
class Remark:
    """One thing the user should know."""

    subject: str  # object or file it is about
    text: str  # what happened and what to do about it
    times: int = 1  # how often


@dataclass(slots=True, eq=False)
class Findings:
    """A notebook that readers and builder share during one import."""

    classes: Counter[str] = field(default_factory=Counter)  # objects read, by class
    skipped: Counter[str] = field(default_factory=Counter)  # objects left out, by class
    skipped_names: dict[str, list[str]] = field(default_factory=dict)  # some of their names
    facts: dict[str, object] = field(default_factory=dict)  # by name
    _missing: Counter[tuple[str, str]] = field(default_factory=Counter)
    _warnings: Counter[tuple[str, str]] = field(default_factory=Counter)

    def count(self, kind: str, times: int = 1) -> None:
        """An actor, node or element of this class was read."""
        self.classes[kind] += times

    def skip(self, kind: str, name: str = "", times: int = 1) -> None:
        """Count something that is in the file and not in the world (worlds reference 13, item 16).

        Args:
            kind: its class, element or type, as the file calls it.
            name: as in the file; empty if it has none.
            times: how many there are.
        """
        self.skipped[kind] += times
        names = self.skipped_names.setdefault(kind, [])
        if name and name not in names and len(names) < MAX_NAMES:
            names.append(name)

    def missing(self, kind: str, name: str) -> None:
        """A `mesh`, `texture`, `model` or `file` that the map names was not found (worlds 70)."""
        self._missing[kind, name] += 1

    def warn(self, subject: str, text: str) -> None:
        """Something worth knowing about one subject; equal warnings are counted."""
        key = (subject, text)
        if key in self._warnings or len(self._warnings) < MAX_WARNINGS:
            self._warnings[key] += 1

    def fact(self, name: str, value: object) -> None:
        """A number or word for the report; replaces an earlier one."""
        self.facts[name] = value

    def missing_list(self) -> list[tuple[str, str, int]]:
        """Kind, name and number of uses of everything missing, once each, sorted."""
        return sorted((kind, name, times) for (kind, name), times in self._missing.items())

    def warnings(self) -> list[Remark]:
        """In the order of first appearance."""
        return [Remark(subject, text, n) for (subject, text), n in self._warnings.items()]
