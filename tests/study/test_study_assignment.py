"""Assignment: balanced squares, a function of seed and number, nothing given out twice."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest

from usarsim_study.assignment import (
    Allocation,
    Cell,
    claim_number,
    imbalance,
    new_code,
    order_index,
    orders,
    read_allocation,
    williams_square,
)
from usarsim_study.errors import StudyError


def crossover(seed: int = 7, participants: int = 8) -> Allocation:
    """Two devices and two layouts."""
    return Allocation(seed, orders(("keyboard", "gamepad"), ("A", "B"), "within"), participants)


class TestSquares:
    """HRI-03."""

    @pytest.mark.parametrize("count", range(2, 9))
    def test_positions_are_balanced(self, count: int) -> None:
        """Each condition stands in each position equally often, each row has all (HRI-03)."""
        square = williams_square(count)
        assert all(sorted(row) == list(range(count)) for row in square)
        for column in zip(*square, strict=True):
            assert set(Counter(column).values()) == {len(square) // count}

    @pytest.mark.parametrize("count", range(2, 9))
    def test_ordered_pairs_are_balanced(self, count: int) -> None:
        """Each condition follows each other one equally often: once in a square of an even number,
        twice in the two squares of an odd one (HRI-03)."""
        pairs = Counter(pair for row in williams_square(count) for pair in pairwise(row))
        assert len(pairs) == count * (count - 1)
        assert set(pairs.values()) == {1 if count % 2 == 0 else 2}

    @pytest.mark.parametrize("count", range(2, 9))
    def test_every_layout_meets_every_condition(self, count: int) -> None:
        """Also with a square of layouts."""
        names = [f"c{one}" for one in range(count)]
        layouts = [f"l{one}" for one in range(count)]
        assert imbalance(orders(names, layouts, "within")) is None
        assert imbalance(orders(names, layouts[:1], "within")) is None
        assert imbalance(orders(names, layouts, "between")) is None


class TestAllocation:
    """O-40 and HRI-04."""

    def test_four_sequences_each_used_twice_after_eight(self) -> None:
        """Four counterbalanced sequences in blocks of four (O-40)."""
        allocation = crossover()
        assert {
            tuple((cell.condition, cell.layout) for cell in order) for order in allocation.orders
        } == {
            (("keyboard", "A"), ("gamepad", "B")),
            (("keyboard", "B"), ("gamepad", "A")),
            (("gamepad", "A"), ("keyboard", "B")),
            (("gamepad", "B"), ("keyboard", "A")),
        }
        for block in (range(1, 5), range(5, 9)):
            assert sorted(allocation.index(number) for number in block) == [0, 1, 2, 3]

    def test_a_function_of_seed_and_number(self) -> None:
        """The same seed gives the same list, however many are planned; another one does not, and
        no block has the same order for ever (HRI-04)."""
        assert crossover(7).text() == crossover(7).text()
        longer = crossover(7, 12).text()
        assert longer.startswith(crossover(7).text())
        assert crossover(8).text() != crossover(7).text()
        blocks = {tuple(order_index(7, 4 * one + n, 4) for n in (1, 2, 3, 4)) for one in range(9)}
        assert len(blocks) > 4

    def test_known_order(self) -> None:
        """Who has nothing but SHA-256 finds the same order."""
        by_hand = sorted(range(4), key=lambda one: hashlib.sha256(f"7/0/{one}".encode()).digest())
        assert [order_index(7, number, 4) for number in (1, 2, 3, 4)] == by_hand

    def test_list_is_written_once_and_hashed(self, tmp_path: Path) -> None:
        """The digest is that of the file; a changed study is refused (HRI-04)."""
        digest = crossover().export(tmp_path)
        written = (tmp_path / "allocation.csv").read_bytes()
        assert hashlib.sha256(written).hexdigest() == digest
        assert crossover().export(tmp_path) == digest
        assert read_allocation(tmp_path / "allocation.csv")[3] == crossover().order(3)
        with pytest.raises(StudyError, match="another study file"):
            crossover(8).export(tmp_path)

    def test_resumption_gives_no_sequence_twice(self, tmp_path: Path) -> None:
        """After every claim the program dies; the next one goes on (HRI-03)."""
        numbers = [claim_number(tmp_path) for _ in range(8)]
        assert numbers == list(range(1, 9))
        assert Counter(crossover().index(one) for one in numbers) == dict.fromkeys(range(4), 2)

    def test_codes_are_random(self) -> None:
        """Codes repeat nothing and say nothing (O-43)."""
        codes: set[str] = set()
        for _ in range(200):
            codes.add(new_code(codes))
        assert len(codes) == 200
        assert all(
            re.fullmatch(r"[B-DF-HJ-NP-TV-XZ][B-DF-HJ-NP-TV-XZ2-9]{5}", one) for one in codes
        )


class TestImbalance:
    """What HRI-01 refuses."""

    def test_position(self) -> None:
        """The keyboard always first."""
        found = imbalance([(Cell("k", "A"), Cell("g", "B")), (Cell("k", "B"), Cell("g", "A"))])
        assert found is not None
        assert "trial 1" in found.problem

    def test_layout(self) -> None:
        """The keyboard always in A."""
        found = imbalance([(Cell("k", "A"), Cell("g", "B")), (Cell("g", "B"), Cell("k", "A"))])
        assert found is not None
        assert "k in A 2" in found.problem

    def test_too_few_layouts(self) -> None:
        """Two layouts for three trials."""
        with pytest.raises(ValueError, match="2 layouts"):
            orders(("a", "b", "c"), ("A", "B"), "within")
