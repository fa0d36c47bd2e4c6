"""Frontier-based with return by ratio: what the base knows must be a part of what is known.

Spirin, Cameron and de Hoog, "Time preference for information in multi-agent exploration with
limited communication" (exploration reference 12.3). When robots meet, the one that has it nearest
to the base takes over what the others carry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.known_map import AT_BASE, FREE, RELAYED, KnownMap
from usarsim_exploration.strategies.periodic import Returning
from usarsim_exploration.strategy import BASE, Letter, View, register
from usarsim_server.base.fields import field

REFRESH = 8
"""Steps after which the way to the base is measured again (exploration 12.3)."""
HESITATION = 3.0
"""Steps that a robot without news must be nearer to the base to take over (exploration 12.3)."""


def carried(known: KnownMap) -> NDArray[np.int64]:
    """Free cells that neither the base knows nor others carry there, flat."""
    own = known.bits & (FREE | AT_BASE | RELAYED) == FREE
    return np.flatnonzero(own)


@register("ratio")
@dataclass
class Ratio(Returning):
    """Returns when the base knows less than `target` of what it and this robot know."""

    target: float = field(
        default=0.9, low=0.0, high=1.0, help="part that the base knows or that others carry to it"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._told: Letter = {}
        self._away, self._asked = 0.0, -REFRESH

    def turns_back(self, view: View) -> bool:
        """Only out of reach of the base, and with something new."""
        known = view.known
        news = known.undelivered
        there = known.at_base + known.relayed
        return BASE not in view.linked and news > 0 and there / (there + news) < self.target

    def letter(self, view: View) -> Letter:
        """How long it takes to the base, what it carries, whether it is on its way there."""
        if view.step - self._asked >= REFRESH:
            self._away = view.planner.field(view.cell).distance(view.base)
            self._asked = view.step
        told = {
            "to_base": self._away / view.speed,
            "carried": carried(view.known) if view.known.undelivered else np.empty(0, np.int64),
            "returning": self.returning,
        }
        self._told = told
        return {**super().letter(view), **told}

    def hear(self, view: View) -> None:
        """One of those who meet out of reach of the base goes on to carry all, the others nothing.

        That is who gets there first; whoever has nothing yet, only if it is nearer by
        `HESITATION`; of equal ones the lowest number.
        """
        super().hear(view)
        if BASE in view.linked or not view.linked:
            return
        letters = {number: view.teammates[number].letter for number in view.linked}
        letters[view.number] = self._told
        letters = {number: one for number, one in letters.items() if "to_base" in one}
        carrier = min(
            letters,
            key=lambda number: (
                letters[number]["to_base"]
                + (0.0 if len(letters[number]["carried"]) else HESITATION),
                number,
            ),
        )
        cells = np.unique(np.concatenate([one["carried"] for one in letters.values()]))
        if not len(cells):
            return
        if carrier != view.number:
            view.known.mark(view.step, carried(view.known), RELAYED)
            if self.returning:
                self.resume()
            return
        view.known.unmark(view.step, cells, RELAYED)
        on_the_way = any(one["returning"] for one in letters.values())
        if on_the_way and len(cells) > 1 and not self.returning:
            self.turn_back()
