"""Who meets which conditions in which order: counterbalanced, random by a seed, never twice.

Sequences come from Williams squares: each condition stands in each position equally often, and for
even numbers of conditions each follows each other one equally often. Participant n gets a sequence
that depends on the study's seed and n alone: each block of participants uses every sequence once,
in an order drawn by SHA-256.

The list of all assignments is written before the first session and hashed into every log. It is
the only file that names conditions, so it is also the key of a blind study. A participant's number
is claimed by creating a file that must not exist yet, so that no crash and no second session gives
a number out twice.

Source: E. J. Williams, "Experimental designs balanced for the estimation of residual effects of
treatments", Australian Journal of Scientific Research A 2 (1949) 149-168.
"""

from __future__ import annotations

import hashlib
import os
import secrets
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from usarsim_server.base.csv_files import csv_text, read_csv
from usarsim_server.base.errors import at
from usarsim_server.base.files import write_text
from usarsim_study.errors import StudyError

ALLOCATION = "allocation.csv"
NUMBERS = "numbers"
"""Folder of claimed numbers."""
SPARE = 2
"""The list has so many times the planned participants: some will not come."""

_CODE_LETTERS = "BCDFGHJKLMNPQRSTVWXZ"
_CODE_SIGNS = _CODE_LETTERS + "23456789"
"""No vowels: no words, no FALSE, no NA; and nothing that looks like something else."""
_CODE_LENGTH = 6

_AGAIN = "export it again"

Design = Literal["within", "between"]


@dataclass(frozen=True, slots=True)
class Cell:
    """What one trial is: names of a condition and of a layout."""

    condition: str
    layout: str


Order = tuple[Cell, ...]
"""The trials of one participant, in order."""


def williams_square(count: int) -> tuple[tuple[int, ...], ...]:
    """Orders of so many conditions, as numbers from 0.

    Returns:
        `count` rows for an even count, twice as many for an odd one.

    Raises:
        ValueError: there must be at least one.
    """
    if count < 1:
        raise ValueError("an order needs at least one condition")
    first = [(place + 1) // 2 if place % 2 else -(place // 2) for place in range(count)]
    rows = [tuple((one + shift) % count for one in first) for shift in range(count)]
    if count % 2 and count > 1:
        rows += [row[::-1] for row in rows]
    return tuple(rows)


def orders(conditions: Sequence[str], layouts: Sequence[str], design: Design) -> tuple[Order, ...]:
    """All sequences of a study, each to be used equally often.

    Within participants: every order of a Williams square of the conditions, with every order of a
    cyclic square of the layouts. Two of each make the four sequences of a crossover. Between
    participants: one trial, each condition with each layout.

    Raises:
        ValueError: fewer layouts than conditions, but more than one: some would come twice.
    """
    if design == "between":
        return tuple((Cell(one, layout),) for layout in layouts for one in conditions)
    if 1 < len(layouts) < len(conditions):
        raise ValueError(
            f"{len(layouts)} layouts cannot be spread evenly over {len(conditions)} trials"
        )
    found = []
    for row in williams_square(len(conditions)):
        for shift in range(len(layouts)):
            places = [layouts[(at + shift) % len(layouts)] for at in range(len(row))]
            found.append(
                tuple(Cell(conditions[one], place) for one, place in zip(row, places, strict=True))
            )
    return tuple(found)


def order_index(seed: int, number: int, count: int) -> int:
    """Which of `count` sequences participant `number` (from 1) gets."""
    block, place = divmod(number - 1, count)
    drawn = sorted(
        range(count),
        key=lambda one: hashlib.sha256(f"{seed}/{block}/{one}".encode()).digest(),
    )
    return drawn[place]


@dataclass(frozen=True, slots=True)
class Allocation:
    """The assignments of a study.

    Attributes:
        seed: of the study.
        orders: its sequences.
        participants: how many are planned.
    """

    seed: int
    orders: tuple[Order, ...]
    participants: int

    def index(self, number: int) -> int:
        """The sequence of a participant, its number from 0."""
        return order_index(self.seed, number, len(self.orders))

    def order(self, number: int) -> Order:
        """The trials of a participant."""
        return self.orders[self.index(number)]

    def text(self) -> str:
        """The list as CSV: number, sequence, trial (from 1), condition, layout."""
        rows = (
            (number, index + 1, trial, cell.condition, cell.layout)
            for number in range(1, SPARE * self.participants + 1)
            for index in [self.index(number)]
            for trial, cell in enumerate(self.orders[index], start=1)
        )
        return csv_text(("number", "sequence", "trial", "condition", "layout"), rows)

    @property
    def digest(self) -> str:
        """SHA-256 of the list, hexadecimal."""
        return hashlib.sha256(self.text().encode()).hexdigest()

    def export(self, folder: Path) -> str:
        """Write the list, unless it is there; its digest.

        Raises:
            StudyError: another list is there: the study was changed after it had begun.
        """
        path = folder / ALLOCATION
        if path.exists():
            if path.read_bytes() != self.text().encode():
                raise StudyError(
                    f"{path}: belongs to another study file (continue with the one that this study "
                    "began with, or begin in a new folder)"
                )
        else:
            write_text(path, self.text(), private=True)
        return self.digest


def read_allocation(path: Path) -> dict[int, Order]:
    """The orders of all participants by number, from the list.

    Raises:
        StudyError: it is not there or something else.
    """
    found: dict[int, list[Cell]] = {}
    if not path.exists():
        raise StudyError(at(path, "is not there", "run the study"))
    try:
        for _, row in read_csv(path, StudyError, _AGAIN).rows:
            trials = found.setdefault(int(row["number"]), [])
            if int(row["trial"]) != len(trials) + 1:
                raise ValueError("trials are out of order")
            trials.append(Cell(row["condition"], row["layout"]))
    except (KeyError, ValueError) as error:
        raise StudyError(at(path, f"is no list of assignments: {error}", _AGAIN)) from None
    return {number: tuple(trials) for number, trials in found.items()}


def new_code(taken: Iterable[str] = ()) -> str:
    """A random code for a participant; it says nothing about whoever bears it."""
    known = set(taken)
    while True:
        rest = (secrets.choice(_CODE_SIGNS) for _ in range(_CODE_LENGTH - 1))
        code = secrets.choice(_CODE_LETTERS) + "".join(rest)
        if code not in known:
            return code


def claim_number(folder: Path) -> int:
    """The next participant's number; nobody gets it again, whatever happens.

    Raises:
        OSError: the folder cannot be written.
    """
    numbers = folder / NUMBERS
    numbers.mkdir(parents=True, exist_ok=True)
    number = 1 + max(
        (int(one.name) for one in numbers.iterdir() if one.name.isdecimal()), default=0
    )
    while True:
        try:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            os.close(os.open(numbers / f"{number:04}", flags, 0o666))
        except FileExistsError:
            number += 1
        else:
            return number


@dataclass(frozen=True, slots=True)
class Imbalance:
    """Why a set of sequences is not balanced."""

    problem: str
    cure: str


def imbalance(sequences: Sequence[Order]) -> Imbalance | None:
    """Why sequences that are each used equally often are not balanced; None if they are.

    Each condition must stand in each position equally often, and meet each layout equally often.
    """
    length = {len(order) for order in sequences}
    if len(length) > 1:
        return Imbalance("sequences have different numbers of trials", "give each as many")
    conditions = sorted({cell.condition for order in sequences for cell in order})
    layouts = sorted({cell.layout for order in sequences for cell in order})
    for place in range(next(iter(length), 0)):
        counts = {
            one: sum(order[place].condition == one for order in sequences) for one in conditions
        }
        if len(set(counts.values())) > 1:
            told = ", ".join(f"{one} {count} times" for one, count in counts.items())
            return Imbalance(
                f"as trial {place + 1} conditions are not equally often: {told}",
                "add sequences until each stands in each position equally often",
            )
    pairs = {
        (one, layout): sum(Cell(one, layout) in order for order in sequences)
        for one in conditions
        for layout in layouts
    }
    if len(set(pairs.values())) > 1:
        told = ", ".join(f"{one} in {where} {count}" for (one, where), count in pairs.items())
        return Imbalance(
            f"conditions do not meet layouts equally often: {told}",
            "add sequences until each condition meets each layout equally often",
        )
    return None
