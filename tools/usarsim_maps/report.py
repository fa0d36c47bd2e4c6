"""What an import tells its user: a table, and the same as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from usarsim_maps.build.builder import Built
from usarsim_maps.files import read_head
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Array, Scene
from usarsim_server.base.errors import MapImportError

MOST_LINES = 40
"""Of missing files, of warnings and of starts in the text; JSON has all."""


@dataclass(frozen=True, slots=True)
class Report:
    """The outcome of one import; every field is plain data."""

    source: Mapping[str, Any]  # path, format, scale, up, mirrored, assumed of the map
    extents: tuple[float, float, float] | None
    """m along x, y, z, of what has an end; `lower` and `upper` are the corners. None if there are
    only endless planes."""
    lower: tuple[float, float, float] | None
    upper: tuple[float, float, float] | None
    classes: Mapping[str, int]  # actors or nodes by class
    skipped: Mapping[str, int]
    """How many things of each class are in the map and not in the world."""
    skipped_names: Mapping[str, list[str]]  # some of their names, by class
    starts: tuple[tuple[str, float | None, float], ...]
    """Name, m above the floor (None: no floor), m of overlap."""
    totals: Mapping[str, Any]  # pieces, meshes, memory (MiB), objects, victims and so on
    missing: tuple[tuple[str, str, int], ...]  # kind, name, uses
    warnings: tuple[tuple[str, str, int], ...]  # subject, text, times
    transparent: tuple[str, ...]  # materials and things that lasers pass, by their names
    clear: tuple[tuple[str, float], ...]
    """Materials that cameras see through, with their opacity."""
    licence: str  # a note on copying
    seconds: float  # of wall time that the import took

    def data(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    def text(self) -> str:
        """For people."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        source = self.source
        state = " (assumed; check it, or give --scale)" if source["assumed"] else ""
        if source.get("unit"):
            state = f" ({source['unit']}; if things are too large or small, give --scale)"
        yield f"map        {source['path']} ({source['format']})"
        yield (
            f"scale      {source['units_per_metre']:g} units per metre{state}, {source['up']} up"
            + (", mirrored" if source["mirrored"] else "")
        )
        if self.extents and self.lower and self.upper:
            size = " x ".join(f"{value:.2f}" for value in self.extents)
            yield f"extents    {size} m, from {_place(self.lower)} to {_place(self.upper)}"
        else:
            yield "extents    none: there are only endless planes"
        for name, value in self.totals.items():
            number = f"{value:.2f}" if isinstance(value, float) else value
            yield f"{name:<10} {number}"
        if self.classes:
            yield "read       " + _counts(self.classes)
        if self.skipped:
            yield "left out   " + _counts(self.skipped, self.skipped_names)
        if self.transparent:
            yield "lasers pass " + ", ".join(self.transparent[:MOST_LINES])
        if self.clear:
            told = ", ".join(f"{name} ({100.0 * a:.0f} %)" for name, a in self.clear[:MOST_LINES])
            but = ", but for what they pass" if self.transparent else ""
            yield f"clear      {told} opaque for cameras; lasers see them as they are felt{but}"
        yield f"licence    {self.licence}"
        yield from _table("START", "ABOVE FLOOR", self._start_rows())
        yield from _table(
            "MISSING", "USES", [(f"{kind} {name}", str(uses)) for kind, name, uses in self.missing]
        )
        yield from _table(
            "NOTE",
            "",
            [(f"{s}: {t}" + (f" ({n} times)" if n > 1 else ""), "") for s, t, n in self.warnings],
        )

    def _start_rows(self) -> list[tuple[str, str]]:
        rows = []
        for name, height, overlap in self.starts:
            text = "no floor" if height is None else f"{height:.2f} m"
            rows.append((name, text + (f", blocked by {overlap:.2f} m" if overlap > 0.02 else "")))
        return rows


def make_report(scene: Scene, built: Built, findings: Findings, seconds: float) -> Report:
    """Put a report together."""
    source = scene.source
    totals: dict[str, Any] = {
        "starts": len(built.checks),
        "victims": len(scene.victims),
        "path nodes": len(scene.path_nodes),
        "objects": len(scene.objects),
        "movable": sum(thing.movable for thing in scene.objects),
        "brushes": len(scene.brushes),
        "lights": len(scene.lights),
        "materials": len(built.finishes),
        "pieces": built.pieces,
        "seen": built.seen,
        "memory MiB": built.memory,
        **findings.facts,
    }
    lower, upper = built.extents or (None, None)
    return Report(
        source={
            "path": str(source.path),
            "format": source.format,
            "units_per_metre": source.units_per_metre,
            "up": source.up,
            "mirrored": source.mirrored,
            "assumed": source.assumed,
            "unit": source.unit,
        },
        extents=None if lower is None or upper is None else _triple(upper - lower),
        lower=None if lower is None else _triple(lower),
        upper=None if upper is None else _triple(upper),
        classes=dict(sorted(findings.classes.items())),
        skipped=dict(sorted(findings.skipped.items())),
        skipped_names={kind: names for kind, names in findings.skipped_names.items() if names},
        starts=tuple(
            (place.name, place.height if math.isfinite(place.height) else None, place.overlap)
            for place in built.checks
        ),
        totals=totals,
        missing=tuple(findings.missing_list()),
        warnings=tuple((w.subject, w.text, w.times) for w in findings.warnings()),
        transparent=built.clear.passed,
        clear=built.clear.clear,
        licence=source.licence or licence_note(source.path),
        seconds=seconds,
    )


def licence_note(source: Path) -> str:
    """What a licence file beside the map says, or advice."""
    for pattern in ("LICEN[CS]E*", "COPYING*", "licen[cs]e*", "copying*"):
        for path in sorted(source.parent.glob(pattern)):
            try:
                head = read_head(path).decode("utf-8", "replace")
            except MapImportError:
                continue
            first = next((line.strip() for line in head.splitlines() if line.strip()), "")
            return f"{path.name} beside the map says: {first[:80]}"
    return "none found beside the map; ask its author before passing the result on"


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _place(values: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in values) + ")"


def _counts(counts: Mapping[str, int], names: Mapping[str, list[str]] | None = None) -> str:
    """Counts by class in one line, with the names of some things of a class where there are any."""
    told = []
    for kind, number in counts.items():
        some = (names or {}).get(kind, [])
        more = ", ..." if len(some) < number else ""
        told.append(f"{number} {kind}" + (f" ({', '.join(some)}{more})" if some else ""))
    return ", ".join(told)


def _table(head: str, other: str, rows: list[tuple[str, str]]) -> Iterator[str]:
    if not rows:
        return
    yield ""
    shown = rows[:MOST_LINES]
    width = max(len(head), *(len(row[0]) for row in shown)) if other else 0
    yield f"{head.ljust(width)}  {other}".rstrip()
    for name, value in shown:
        yield f"{name.ljust(width)}  {value}".rstrip()
    if len(rows) > len(shown):
        yield f"... and {len(rows) - len(shown)} more (see the JSON report)"
