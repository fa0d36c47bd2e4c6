"""Words that programs for statistics take for something else when they stand in a table.

pandas and R read a table without options, and so a condition called NA becomes a missing value,
quoted or not, and its rows fall out of every group. Names of a study are refused if any program
could do so; of a study that has begun, and of tables from elsewhere, the words are told.

`MISSING` are the words that pandas reads as missing by default (the documentation of
`pandas.read_csv`, `na_values`), here in any case of letters; R reads NA so.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

MISSING = frozenset(
    (
        *("#n/a", "#n/a n/a", "#na", "-1.#ind", "-1.#qnan", "-nan", "1.#ind", "1.#qnan", "<na>"),
        *("n/a", "na", "nan", "none", "null"),
    )
)
TRUTH = frozenset(("true", "false"))
NUMBERS = frozenset(("inf", "infinity"))

CURE = 'read tables with keep_default_na=False, in R na.strings = ""'


def misread(word: str) -> str:
    """What a word is taken for: a missing value, a truth value, a number; empty: it stays a word.

    Truth values and numbers are taken for such where nothing else stands in the column.
    """
    plain = word.strip().casefold()
    if plain in MISSING:
        return "a missing value"
    if plain in TRUTH:
        return "a truth value"
    return "a number" if plain in NUMBERS else ""


def in_columns(columns: Mapping[str, Iterable[str]]) -> dict[str, tuple[str, ...]]:
    """By the name of a column the words that are taken for missing values, in their order."""
    found = {
        name: tuple(dict.fromkeys(word for word in words if word.strip().casefold() in MISSING))
        for name, words in columns.items()
    }
    return {name: words for name, words in found.items() if words}
