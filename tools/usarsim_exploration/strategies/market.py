"""Market: frontiers are sold one by one to the robot whose tour they leave the shortest.

Sequential single-item auctions with the MiniMax rule (Lagoudakis et al., "Auction-based multi-robot
routing", RSS 2005), held by radio: each robot's letter says what the way to each frontier costs it,
by its own map, and whoever hears the same bids finds the same winners, so nobody has to be the
auctioneer. Who has nothing yet buys first. A robot wins a bundle, a tour of frontiers, and drives
to the first of them; nobody else goes to the others while it is out of contact.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_exploration.bidding import Aim
from usarsim_exploration.environment import Cell
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.strategy import Letter, View, register, straight
from usarsim_server.base.fields import field

Bids = Mapping[Cell, float]
"""What the way to each frontier costs a robot, cells."""


def places_of(bids: Iterable[Bids], spacing: float) -> list[Cell]:
    """The frontiers that are for sale: places nearer to each other than `spacing` are one."""
    found: list[Cell] = []
    for one in bids:
        found += [cell for cell in one if all(straight(cell, p) >= spacing for p in found)]
    return found


def sell(bids: Mapping[int, Bids], bundle: int, spacing: float) -> dict[int, list[Cell]]:
    """Hold the auction.

    Args:
        bids: of each robot. bundle: how many frontiers a robot may win. spacing: see `places_of`.

    Returns:
        The tour of each robot; places as the first bidder named them.
    """
    numbers = sorted(bids)
    places = places_of((bids[number] for number in numbers), spacing)
    tours: dict[int, list[Cell]] = {number: [] for number in numbers}
    if not places:
        return tours
    there = np.array(places, np.float64)
    price = np.full((len(numbers), len(places)), np.inf)
    for row, number in enumerate(numbers):
        for cell, cost in bids[number].items():
            near = np.hypot(*(there - cell).T) < spacing
            price[row, near] = np.minimum(price[row, near], cost)
    biddable = np.isfinite(price)
    while np.isfinite(price).any():
        idle = np.array([not tours[number] for number in numbers])[:, None] & np.isfinite(price)
        first = np.where(idle, price, np.inf) if idle.any() else price
        row, column = divmod(int(first.argmin()), len(places))
        tour, length = tours[numbers[row]], price[row, column]
        tour.append(places[column])
        price[:, column], biddable[:, column] = np.inf, False
        onward = length + np.hypot(*(there - there[column]).T)
        price[row] = np.where(biddable[row] & (len(tour) < bundle), onward, np.inf)
    return tours


@register("market")
@dataclass
class Market(Seeker):
    """Sequential auctions with bundles."""

    parts = True

    bundle: int = field(default=3, low=1, high=100, help="frontiers that a robot may win at once")
    spacing: float = field(
        default=10.0, low=0.0, high=1000.0, unit="cells",
        help="frontiers of two maps that are nearer to each other are one",
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        self._bids: dict[Cell, float] = {}
        self._tour: list[Cell] = []

    def due(self, view: View) -> bool:
        """At the same steps for all, so that the letters before hold bids of one moment."""
        return view.step % self.replan == 1 % self.replan

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """Hold the auction, and go to the first that this robot wins; else to the nearest."""
        bids: dict[int, Bids] = {view.number: {one.cell: one.distance for one in aims}}
        for mate in view.explorers(self.memory):
            told = {(x, y): cost for x, y, cost in mate.letter.get("bids", ())}
            if mate.number not in view.linked:  # it drives its tour, so nobody else needs to
                told = dict.fromkeys(mate.letter.get("tour", ()), 0.0)
            bids[mate.number] = told
        for mate in self.beside(view):  # what it told may be old, and so no bid for what is new
            bids[mate.number] = bids[view.number]
        self._tour = sell(bids, self.bundle, self.spacing)[view.number]
        if not self._tour:  # who is left over, too, parts from others in its cell
            nearest = sorted(aims, key=lambda one: one.distance)
            return nearest[len(self.companions(view)) % len(nearest)]
        return min(aims, key=lambda one: straight(one.cell, self._tour[0]))

    def guess(self, view: View, aims: Sequence[Aim]) -> None:
        """Nothing: the auction has parted them, unless both are on the way to one place."""

    def letter(self, view: View) -> Letter:
        """Bids, made anew in the step before an auction, and the tour."""
        if view.step % self.replan == 0:
            self._bids = {one.cell: round(one.distance, 1) for one in self.aims(view)}
        bids = [(*cell, cost) for cell, cost in self._bids.items()]
        return {**super().letter(view), "bids": bids, "tour": list(self._tour)}
