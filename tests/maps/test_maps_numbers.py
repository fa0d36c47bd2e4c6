"""The tolerant reader of numbers: what is read in one way only, and that nothing else is."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_maps.numbers import read_number, read_numbers, read_whole

FINITE = st.floats(allow_nan=False, allow_infinity=False)
PLAIN = st.decimals(-1000, 1000, places=3).map(str)


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("-3.14/2", -1.57),
        ("pi/2", math.pi / 2),
        ("-M_PI", -math.pi),
        ("2*(1+0.5)", 3.0),
        ("1-2-3", -4.0),
        ("8/2/2", 2.0),
        ("--1", 1.0),
        ("1e-3*2", 0.002),
        ("1.5f", 1.5),
        ("0,0254", 0.0254),
        ("-,5", -0.5),
        ("\N{MINUS SIGN}2", -2.0),
    ],
)
def test_sums(word: str, value: float) -> None:
    """What people write by hand has the value that they meant."""
    assert read_number(word) == pytest.approx(value)


@pytest.mark.parametrize(
    "word", ["nan", "-nan", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#IND00", "1.#INF", "1/0", "0/0"]
)
def test_values_that_are_none(word: str) -> None:
    """The ways in which C libraries print what is no value."""
    assert not math.isfinite(read_number(word))


@pytest.mark.parametrize(
    "word", ["", "x", "1x", "1 2", "(1", "1)", "()", "1+", "*2", "1..2", "1,2,3", "1.5,2", "two",
             "2pi", "__import__", "(" * 30 + "1" + ")" * 30, "1+" * 300 + "1"]
)  # fmt: skip
def test_what_is_no_number(word: str) -> None:
    """Anything else is an error of one kind."""
    with pytest.raises(ValueError, match="no number"):
        read_number(word)


@pytest.mark.parametrize(
    ("text", "counts", "values"),
    [
        ("1 2 3", (3,), [1, 2, 3]),
        ("1.5, 2.5,3", (3,), [1.5, 2.5, 3]),
        ("1,5 2,25 0 0 0 1,57", (3, 6), [1.5, 2.25, 0, 0, 0, 1.57]),
        ("1,5", (1,), [1.5]),
        ("1,5 2", (), [1, 5, 2]),
        ("0 0 0 0 0 3.14 / 2", (6,), [0, 0, 0, 0, 0, 1.57]),
        ("0 -1 ( 3*2 )", (3,), [0, -1, 6]),
        ("1 -2", (1, 2), [1, -2]),
        ("", (3,), []),
    ],
)
def test_lists(text: str, counts: tuple[int, ...], values: list[float]) -> None:
    """How many numbers there should be tells what commas mean."""
    assert read_numbers(text, *counts) == pytest.approx(values)


def test_what_can_be_read_in_two_ways_is_not_read() -> None:
    """Three pairs can be three numbers, or six."""
    with pytest.raises(ValueError, match="two ways"):
        read_numbers("1,5 2,5 3,5", 3, 6)


@given(FINITE)
def test_plain_numbers_are_what_they_were(value: float) -> None:
    """Tolerance changes no number that was sound."""
    assert read_number(repr(value)) == value


@given(st.recursive(PLAIN.map(lambda n: f"({n})"), lambda inner: st.one_of(
    st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda t: f"({t[0]}{t[1]}{t[2]})"),
    inner.map(lambda text: f"(-{text})"),
), max_leaves=6))  # fmt: skip
def test_sums_are_those_of_python(text: str) -> None:
    """Operations and brackets bind as everywhere."""
    try:
        wanted = float(eval(text))
    except ZeroDivisionError:
        wanted = math.nan
    assert read_number(text) == pytest.approx(wanted, nan_ok=True)


@given(st.lists(PLAIN, min_size=1, max_size=8))
def test_decimal_commas_are_decimal_points(words: list[str]) -> None:
    """A list with commas reads like that with points, where it can be nothing else."""
    text = " ".join(words).replace(".", ",")
    assert read_numbers(text, len(words)) == pytest.approx([float(word) for word in words])


@given(st.text(max_size=60), st.lists(st.integers(1, 7), max_size=3))
def test_any_text(text: str, counts: list[int]) -> None:
    """Whatever stands there: numbers, or the declared error."""
    try:
        values = read_numbers(text, *counts)
    except ValueError:
        return
    assert all(isinstance(value, float) for value in values)


@given(st.text("0123456789.,+-*/()ep inf#", max_size=40))
def test_near_numbers(text: str) -> None:
    """The same for texts of the signs that numbers are made of."""
    test_any_text.hypothesis.inner_test(text, [3, 6])  # type: ignore[attr-defined]


def test_whole_numbers() -> None:
    """Floats where whole numbers should be are read if they are whole."""
    assert [read_whole("3"), read_whole("3.0"), read_whole("-1e1")] == [3, 3, -10]
    for word in ("2.5", "x", "nan", "inf"):
        with pytest.raises(ValueError):  # noqa: PT011
            read_whole(word)
