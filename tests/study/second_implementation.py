"""Tests and effect sizes a second time: by counting every case, in fractions, without libraries.

Ranks, signs and exchanges are enumerated one by one with whole numbers and fractions; tails of t
and chi-squared come from the continued fraction of the incomplete beta function (DLMF 8.17.22) and
the finite sums of the chi-squared distribution (Abramowitz and Stegun 26.4.4, 26.4.5). Run this
file to write `reference_values.json` again.
"""

from __future__ import annotations

import json
import math
from fractions import Fraction
from itertools import combinations, product
from pathlib import Path
from typing import Any

STORED = Path(__file__).with_name("reference_values.json")
Numbers = list[Fraction]


def ranks(values: Numbers) -> Numbers:
    """Ranks from 1; equal values share their mean rank."""
    return [
        Fraction(
            sum(other < one for other in values) * 2 + sum(other == one for other in values) + 1, 2
        )
        for one in values
    ]


def mean(values: Numbers) -> Fraction:
    """Arithmetic mean."""
    return sum(values, Fraction()) / len(values)


def variance(values: Numbers) -> Fraction:
    """Of a sample."""
    middle = mean(values)
    return sum(((one - middle) ** 2 for one in values), Fraction()) / (len(values) - 1)


def both_sides(cases: Numbers, found: Fraction) -> Fraction:
    """Twice the smaller share of equally likely cases that are as extreme, at most 1."""
    below = Fraction(sum(one <= found for one in cases), len(cases))
    above = Fraction(sum(one >= found for one in cases), len(cases))
    return min(Fraction(1), 2 * min(below, above))


def beta_tail(x: float, a: float, b: float) -> float:
    """Regularised incomplete beta function I_x(a, b)."""
    if x <= 0.0 or x >= 1.0:
        return float(x >= 1.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - beta_tail(1.0 - x, b, a)
    front = math.exp(
        math.lgamma(a + b)
        - math.lgamma(a)
        - math.lgamma(b)
        + a * math.log(x)
        + b * math.log(1.0 - x)
    )
    value = 0.0
    for m in range(400, 0, -1):  # from the far end of the fraction
        even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        odd = -(a + m - 1) * (a + b + m - 1) * x / ((a + 2 * m - 2) * (a + 2 * m - 1))
        value = odd / (1.0 + even / (1.0 + value))
    return front / a / (1.0 + value)


def t_p(t: float, freedom: float) -> float:
    """Both sides of Student's t."""
    return beta_tail(freedom / (freedom + t * t), freedom / 2.0, 0.5)


def chi_squared_p(value: float, freedom: int) -> float:
    """Upper tail of chi-squared."""
    half = value / 2.0
    if freedom % 2 == 0:
        return math.exp(-half) * sum(half**k / math.factorial(k) for k in range(freedom // 2))
    total = math.erfc(math.sqrt(half))
    for k in range(1, (freedom - 1) // 2 + 1):
        total += math.exp(-half) * half ** (k - 0.5) / math.gamma(k + 0.5)
    return total


def paired(first: Numbers, second: Numbers) -> dict[str, float]:
    """As `statistics.paired`."""
    differences = [b - a for a, b in zip(first, second, strict=True)]
    kept = [one for one in differences if one]
    ranked = ranks([abs(one) for one in kept])
    won = sum((rank for rank, one in zip(ranked, kept, strict=True) if one > 0), Fraction())
    sums = [
        sum((rank for rank, up in zip(ranked, signs, strict=True) if up), Fraction())
        for signs in product((0, 1), repeat=len(kept))
    ]
    flipped = [
        sum((one * sign for one, sign in zip(differences, signs, strict=True)), Fraction())
        for signs in product((-1, 1), repeat=len(differences))
    ]
    positive = sum(one > 0 for one in kept)
    coins = [Fraction(sum(signs)) for signs in product((0, 1), repeat=len(kept))]
    t = float(mean(differences)) / math.sqrt(variance(differences) / len(differences))
    return {
        "t": t,
        "t_p": t_p(t, len(differences) - 1),
        "w": float(won),
        "wilcoxon_p": float(both_sides(sums, won)),
        "sign_p": float(both_sides(coins, Fraction(positive))),
        "permutation_p": float(both_sides(flipped, sum(differences, Fraction()))),
        "rank_biserial": float((won - (sum(ranked, Fraction()) - won)) / sum(ranked, Fraction())),
        "dz": float(mean(differences)) / math.sqrt(variance(differences)),
    }


def unpaired(first: Numbers, second: Numbers) -> dict[str, float]:
    """As `statistics.unpaired`."""
    together = second + first
    ranked = ranks(together)
    places = range(len(together))
    found = sum(ranked[: len(second)], Fraction())
    chosen = list(combinations(places, len(second)))
    sums = [sum((ranked[at] for at in one), Fraction()) for one in chosen]
    totals = [sum((together[at] for at in one), Fraction()) for one in chosen]
    pairs = [(b > a) - (b < a) for a in first for b in second]
    parts = variance(first) / len(first), variance(second) / len(second)
    t = float(mean(second) - mean(first)) / math.sqrt(sum(parts))
    freedom = sum(parts) ** 2 / (
        parts[0] ** 2 / (len(first) - 1) + parts[1] ** 2 / (len(second) - 1)
    )
    squares = variance(first) * (len(first) - 1) + variance(second) * (len(second) - 1)
    pooled = squares / (len(first) + len(second) - 2)
    return {
        "t": t,
        "t_p": t_p(t, float(freedom)),
        "u": float(found - Fraction(len(second) * (len(second) + 1), 2)),
        "mann_whitney_p": float(both_sides(sums, found)),
        "permutation_p": float(both_sides(totals, sum(second, Fraction()))),
        "delta": sum(pairs) / len(pairs),
        "d": float(mean(second) - mean(first)) / math.sqrt(pooled),
    }


def ties(values: Numbers) -> int:
    """Sum of t^3 - t over groups of t equal values."""
    return sum(values.count(one) ** 3 - values.count(one) for one in set(values))


def several_paired(rows: list[Numbers]) -> dict[str, float]:
    """As `statistics.several_paired`."""
    n, k = len(rows), len(rows[0])
    ranked = [ranks(row) for row in rows]
    sums = [sum(column, Fraction()) for column in zip(*ranked, strict=True)]
    plain = 12 * sum((one - Fraction(n * (k + 1), 2)) ** 2 for one in sums) / (n * k * (k + 1))
    statistic = plain / (1 - Fraction(sum(map(ties, rows)), n * k * (k * k - 1)))
    return {
        "statistic": float(statistic),
        "p": chi_squared_p(float(statistic), k - 1),
        "effect": float(statistic / (n * (k - 1))),
    }


def several_unpaired(groups: list[Numbers]) -> dict[str, float]:
    """As `statistics.several_unpaired`."""
    together = [one for group in groups for one in group]
    n, ranked, begin, total = len(together), ranks(together), 0, Fraction()
    for group in groups:
        total += sum(ranked[begin : begin + len(group)], Fraction()) ** 2 / len(group)
        begin += len(group)
    plain = Fraction(12, n * (n + 1)) * total - 3 * (n + 1)
    statistic = plain / (1 - Fraction(ties(together), n**3 - n))
    return {
        "statistic": float(statistic),
        "p": chi_squared_p(float(statistic), len(groups) - 1),
        "effect": float(statistic / (n - 1)),
    }


JUDGES = {
    "paired": lambda data: paired(*data),
    "unpaired": lambda data: unpaired(*data),
    "several_paired": several_paired,
    "several_unpaired": several_unpaired,
}


def judged(kind: str, data: list[list[str]]) -> dict[str, float]:
    """Values of a data set whose numbers are texts."""
    return JUDGES[kind]([[Fraction(one) for one in row] for row in data])  # type: ignore[no-untyped-call]


SLEEP = [
    ["0.7", "-1.6", "-0.2", "-1.2", "-0.1", "3.4", "3.7", "0.8", "0.0", "2.0"],
    ["1.9", "0.8", "1.1", "0.1", "-0.1", "4.4", "5.5", "1.6", "4.6", "3.4"],
]
"""Hours of sleep gained by two drugs: Student, Biometrika 6 (1908) 1-25."""
DEPRESSION = [
    ["0.878", "0.647", "0.598", "2.05", "1.06", "1.29", "1.06", "3.14", "1.29"],
    ["1.83", "0.50", "1.62", "2.48", "1.68", "1.88", "1.55", "3.06", "1.30"],
]
"""Hollander and Wolfe, Nonparametric Statistical Methods (1973), table 3.1."""


def data_sets() -> list[tuple[str, list[list[str]]]]:
    """Thirty: two from books, 28 from a generator of whole and decimal numbers with ties."""
    state = 12345

    def draw(most: int) -> int:
        nonlocal state
        state = (1103515245 * state + 12345) % 2**31
        return (state >> 8) % most

    def values(count: int, most: int, shift: int, digits: int) -> list[str]:
        numbers = [draw(most) + shift for _ in range(count)]
        return [str(one) if not digits else f"{one / 10**digits:.{digits}f}" for one in numbers]

    found: list[tuple[str, list[list[str]]]] = [("paired", SLEEP), ("paired", DEPRESSION)]
    for n, most, shift, digits in (
        *((4, 50, 5, 0), (5, 6, 1, 0), (6, 900, 90, 1), (7, 5, 2, 0), (8, 8, 0, 0)),
        *((9, 40, 4, 1), (10, 10, 3, 0), (11, 7000, 800, 2), (12, 12, 2, 0)),
    ):
        found.append(("paired", [values(n, most, 0, digits), values(n, most, shift, digits)]))
    for n, m, most, shift, digits in (
        *((3, 4, 50, 10, 0), (4, 4, 5, 1, 0), (5, 4, 700, 90, 1), (5, 6, 8, 2, 0)),
        *((6, 6, 300, 0, 2), (7, 5, 10, 3, 0), (6, 7, 6, 1, 0), (7, 7, 5000, 900, 2)),
        (3, 9, 9, 4, 0),
    ):
        found.append(("unpaired", [values(n, most, 0, digits), values(m, most, shift, digits)]))
    for n, k, most in ((6, 3, 100), (8, 3, 6), (10, 4, 9), (7, 5, 1000), (12, 6, 8)):
        found.append(("several_paired", [values(k, most, 0, 0) for _ in range(n)]))
    for sizes, most in (
        ((4, 5, 6), 100),
        ((5, 5, 5), 7),
        ((3, 4, 5, 6), 12),
        ((8, 2, 6), 30),
        ((6, 6, 7, 4, 5), 9),
    ):
        found.append(("several_unpaired", [values(one, most, 0, 0) for one in sizes]))
    return found


def main() -> None:
    """Write the file."""
    rows: list[dict[str, Any]] = [
        {"kind": kind, "data": data, "values": judged(kind, data)} for kind, data in data_sets()
    ]
    lines = ",\n".join(json.dumps(row) for row in rows)
    STORED.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
