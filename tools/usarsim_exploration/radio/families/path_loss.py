"""Radios that fade with distance and walls, by the propagation models of the wireless server.

There is one implementation of the law (`usarsim_server.radio`). MRESim's constants take the range
of the pair, in cells, for the reference distance; the others count metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, Self

from usarsim_exploration.radio.models import Floats, Radio, register
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.radio import models as server

CAUTION = 1.1
"""A robot expects walls that attenuate so much more, and a range so much shorter
(exploration 10.3)."""


@register("path-loss")
@dataclass(frozen=True)
class PathLoss(Radio):
    """S = P - 10 N log10(d / d0) - min(k, C) A; linked at the cut-off or above (exploration 10.3).

    Attributes:
        law: the server's model.
        per_range: d0 is the range of the pair in cells, as distances are; else all are m.
        strict: a signal must be stronger than the cut-off (MRESim), not only as strong.
        count: what k counts. by_first: the range of a pair is that of its lower number (MRESim).
    """

    counts_walls = True
    law: server.PathLoss = server.PRESETS["mresim"]
    per_range: bool = True
    strict: bool = True
    by_first: bool = False
    count: Literal["walls", "cells"] = field(
        default="walls", help="whether each wall attenuates, or each cell of it"
    )

    @classmethod
    def read(cls, table: Table) -> Self:
        """The constants of the `preset`, unless the table says otherwise."""
        preset = table.choice("preset", tuple(server.PRESETS), "mresim")
        law = table.read(server.PathLoss, server.PRESETS[preset])
        ours = preset == "mresim" and not table.has("reference_distance")
        return table.read(cls, law=law, per_range=ours, strict=preset == "mresim")

    @property
    def wall_cells(self) -> bool:
        """Whether cells of walls count."""
        return self.count == "cells"

    def reach(self, one: Floats, other: Floats) -> Floats:
        """The smaller range, or that of the lower number; pairs are given by number."""
        return one if self.by_first else super().reach(one, other)

    def strength(self, distance: float, reach: float, walls: int, cell: float) -> float:
        """dBm of a signal; see `hears`."""
        if self.per_range:
            return _scaled(self.law, reach).strength(distance, walls)
        return self.law.strength(distance * cell, walls)

    def hears(self, distance: float, reach: float, walls: int, cell: float) -> bool:
        """Whether the signal is strong enough."""
        strength = self.strength(distance, reach, walls, cell)
        return strength > self.law.cutoff if self.strict else self.law.connects(strength)

    def expected(self, reach: float) -> tuple[Radio, float]:
        """Stronger walls, and a shorter range where the range matters."""
        law = replace(self.law, wall_attenuation=CAUTION * self.law.wall_attenuation)
        return replace(self, law=law, strict=False), reach / CAUTION


@lru_cache(maxsize=256)
def _scaled(law: server.PathLoss, reach: float) -> server.PathLoss:
    return replace(law, reference_distance=reach)
