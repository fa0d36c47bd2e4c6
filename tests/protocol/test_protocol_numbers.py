"""Numbers in and out (protocol reference 2.1 to 2.3, 43 to 51, 53 to 55), and names: one
printable token each, unique whatever the case, with nothing to forge fields with.
"""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol import messages
from usarsim_server.protocol import truth as ground_truth
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.numbers import (
    MAX_MAGNITUDE,
    boolean,
    fixed,
    ranges,
    read_bool,
    read_int,
    read_number,
    read_vector,
    vector,
)
from usarsim_server.protocol.values import LONGEST_NAME, clean_name, free_name, name_key

FINITE = st.floats(min_value=-1e6, max_value=1e6, allow_nan=False)
DIGITS = st.integers(min_value=0, max_value=6)


@pytest.mark.parametrize(
    "text", [".5", "0.5", "+0.5", "5e-1", "0,5", " 0.5", "\t.5", "00.50", "5E-1"]
)
def test_spellings_of_a_half(text: str) -> None:
    """Protocol 43: sign, missing zero, exponent, decimal comma and leading blanks are all read."""
    assert read_number(text) == 0.5


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1.5abc", 1.5),
        ("1.5 2.5", 1.5),
        ("1.5}", 1.5),
        ("abc", 0.0),
        ("", 0.0),
        ("-", 0.0),
        (".", 0.0),
        (",", 0.0),
        ("--1", 0.0),
        ("- 1", 0.0),
        ("e5", 0.0),
        ("1e", 1.0),
        ("1e+", 1.0),
        ("5.", 5.0),
        ("-.25", -0.25),
        ("020", 20.0),
        ("0x10", 0.0),
        ("1_000", 1.0),
        ("1,2,3", 1.0),
        ("1,234.5", 1.0),
        ("-1,25", -1.25),
        ("+0,5rad", 0.5),
        ("1,5e2", 150.0),
        ("\xb2", 0.0),
        ("\u0663", 0.0),
    ],
)
def test_trailing_junk_and_unreadable_text(text: str, value: float) -> None:
    """Protocol 44: what follows a number is ignored, and text without a number is 0."""
    assert read_number(text) == value


@pytest.mark.parametrize(
    "text", ["nan", "NaN", "inf", "-inf", "Infinity", "-nan", "1e999", "-1e999"]
)
def test_reading_is_always_finite(text: str) -> None:
    """Protocol 45: nan and infinities in any spelling become finite numbers."""
    assert math.isfinite(read_number(text))
    assert abs(read_number(text)) <= MAX_MAGNITUDE


def test_huge_numbers_are_clamped() -> None:
    """Magnitudes beyond the limit are clamped with their sign."""
    assert read_number("1e400") == MAX_MAGNITUDE
    assert read_number("-" + "9" * 5000) == -MAX_MAGNITUDE
    assert read_number("1e15") == MAX_MAGNITUDE
    assert read_number("1e14") == 1e14


def test_negative_zero_is_zero() -> None:
    """A client's `-0.0` reads as plain zero, which later prints without sign."""
    assert math.copysign(1.0, read_number("-0.0")) == 1.0


@pytest.mark.parametrize(
    "text", ["9" * 65000, "0." + "9" * 65000, "1e" + "9" * 65000, "1," + "9" * 65000 + "."]
)
def test_hostile_numbers_are_cheap(text: str) -> None:
    """A number of 64 KiB takes next to no processor time."""
    started = time.thread_time()
    assert math.isfinite(read_number(text))
    assert time.thread_time() - started < 1.0


@given(st.text())
def test_any_text_reads_as_finite_numbers(text: str) -> None:
    """Reading never raises and never returns nan or an infinity."""
    assert math.isfinite(read_number(text))
    assert isinstance(read_int(text), int)
    assert isinstance(read_bool(text), bool)
    for count in (2, 3, 6):
        numbers = read_vector(text, count)
        assert len(numbers) == count
        assert all(map(math.isfinite, numbers))


@pytest.mark.parametrize(
    ("text", "value"), [("3", 3), ("3.9", 3), ("-3.9", -3), ("x", 0), ("020", 20)]
)
def test_integers_truncate(text: str, value: int) -> None:
    """Protocol 2.3: integers given as decimals are truncated toward zero, and never octal."""
    assert read_int(text) == value


@pytest.mark.parametrize("text", ["true", "True", "TRUE", "1", "yes", "ON", " true "])
def test_true_spellings(text: str) -> None:
    """Protocol 46 and 2.3: these are true."""
    assert read_bool(text) is True


@pytest.mark.parametrize(
    "text", ["false", "False", "0", "", "2", "tru", "truee", "off", "no", "-1"]
)
def test_everything_else_is_false(text: str) -> None:
    """Protocol 46: any other text is false."""
    assert read_bool(text) is False


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1,2,3", (1, 2, 3)),
        ("1, 2, 3", (1, 2, 3)),
        ("1 , 2 , 3", (1, 2, 3)),
        ("1.0 2.0 3.0", (1, 2, 3)),
        (" 1,2,3 ", (1, 2, 3)),
        ("1\t2\t3", (1, 2, 3)),
        ("1,,2,,3", (1, 2, 3)),
        (".4, .4, 1.8", (0.4, 0.4, 1.8)),
        ("0, -50, 020", (0, -50, 20)),
        ("0,5 1,0 1,8", (0.5, 1.0, 1.8)),
        ("0,5 1 1,8", (0.5, 1.0, 1.8)),
        ("1,2", (1, 2, 0)),
        ("1", (1, 0, 0)),
        ("", (0, 0, 0)),
        (",", (0, 0, 0)),
        ("1,2,3,4", (1, 2, 3)),
        ("1,x,3", (1, 0, 3)),
        ("1.000000 -2.000000 1.800000", (1, -2, 1.8)),
        ("-2.25,0.80,-0.35", (-2.25, 0.8, -0.35)),
        ("nan,inf,1e999", (0, 0, MAX_MAGNITUDE)),
        ("1e-1,2E0,3", (0.1, 2, 3)),
    ],
)
def test_vectors(text: str, expected: tuple[float, ...]) -> None:
    """Protocol 47 to 51: commas, blanks, both, decimal commas between blanks, and missing
    components."""
    assert read_vector(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0,0000, 0,0000, 0,0000", (0, 0, 0)),
        ("1,5000, -2,2500, 0,3000", (1.5, -2.25, 0.3)),
        ("1,5, 2, 0,5", (1.5, 2, 0.5)),
    ],
)
def test_six_part_decimal_comma_vectors(text: str, expected: tuple[float, ...]) -> None:
    """Addendum: the six-part location of decimal comma clients is three numbers."""
    assert read_vector(text) == expected


def test_other_lengths() -> None:
    """Protocol 3.7 and 3.13: six numbers for POSE and two for MOVE are read by the same rules."""
    assert read_vector("1.0,2.0,0.0,0,0,1.57", 6) == (1, 2, 0, 0, 0, 1.57)
    assert read_vector("0,5, 1,5, 0, 0, 0, 1,57", 6) == (0.5, 1.5, 0, 0, 0, 1.57)
    assert read_vector("1.00, 2.00", 2) == (1, 2)
    assert read_vector("1,2", 2) == (1, 2)
    assert read_vector("7", 1) == (7,)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.098, 4, "0.0980"),
        (1.9999999, 2, "2.00"),
        (1.999, 2, "1.99"),
        (-1.999, 2, "-1.99"),
        (-1.9999999, 2, "-2.00"),
        (63.39999999999, 2, "63.40"),
        (math.pi, 4, "3.1415"),
        (math.pi, 2, "3.14"),
        (0.01745, 4, "0.0174"),
        (0.0, 4, "0.0000"),
        (-0.0, 4, "0.0000"),
        (-0.00001, 4, "0.0000"),
        (-0.00004, 2, "0.00"),
        (5, 0, "5"),
        (-5.7, 0, "-5"),
        (-0.2, 0, "0"),
        (0.05, 1, "0.0"),
        (-12.34567, 3, "-12.345"),
        (1e-12, 4, "0.0000"),
        (123456.789, 4, "123456.7890"),
        (1e12, 2, "1000000000000.00"),
        (math.nan, 4, "0.0000"),
        (math.inf, 2, "0.00"),
        (-math.inf, 2, "0.00"),
        (1e300, 0, "1000000000000000"),
        (-1e300, 1, "-1000000000000000.0"),
        (True, 2, "1.00"),
    ],
)
def test_fixed(value: float, digits: int, text: str) -> None:
    """Protocol 2.1, 53: truncation toward zero with a tiny slack, and nothing but digits and a
    point."""
    assert fixed(value, digits) == text


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int32])
def test_fixed_takes_numpy_scalars(kind: type[np.generic]) -> None:
    """Array elements print like plain numbers."""
    assert fixed(kind(20), 4) == "20.0000"  # type: ignore[arg-type]


@given(st.floats(), DIGITS)
def test_fixed_prints_only_plain_decimals(value: float, digits: int) -> None:
    """Protocol 53: whatever the value, no exponent, nan, inf, plus, comma or negative zero is
    printed."""
    text = fixed(value, digits)
    whole, point, fraction = text.removeprefix("-").partition(".")
    assert whole.isdigit()
    assert len(fraction) == digits
    assert bool(point) == bool(digits)
    assert fraction.isdigit() or not digits
    assert not (text.startswith("-") and set(text) <= set("-0."))


@given(FINITE, DIGITS)
def test_fixed_truncates_toward_zero(value: float, digits: int) -> None:
    """The printed magnitude is at most the slack above the value and under one step below it."""
    step = 10.0**-digits
    printed = abs(float(fixed(value, digits)))
    assert printed <= abs(value) + 1.1e-3 * step
    assert printed > abs(value) - step * (1 + 1e-6)


@given(FINITE, DIGITS)
def test_printing_and_reading_agree(value: float, digits: int) -> None:
    """What is printed reads back within one step, and prints the same again."""
    text = fixed(value, digits)
    assert abs(read_number(text) - value) < 10.0**-digits * (1 + 1e-6)
    assert fixed(read_number(text), digits) == text


@given(FINITE, FINITE, DIGITS)
def test_printing_keeps_order(one: float, two: float, digits: int) -> None:
    """Protocol 67: printed numbers, Time above all, never run against their values."""
    low, high = sorted((one, two))
    assert float(fixed(low, digits)) <= float(fixed(high, digits))


@given(st.lists(FINITE, min_size=3, max_size=3), st.integers(min_value=2, max_value=4))
def test_vectors_survive_the_round_trip(values: list[float], digits: int) -> None:
    """Protocol 54: a printed vector has no blanks and reads back as its printed components."""
    text = vector(values, digits)
    assert " " not in text
    assert read_vector(text) == tuple(read_number(fixed(value, digits)) for value in values)


def test_vector_joins_with_commas() -> None:
    """Protocol 2.1: commas, no blanks."""
    assert vector((1.25, -0.5, 0.0), 4) == "1.2500,-0.5000,0.0000"
    assert vector((), 4) == ""


@given(st.lists(FINITE, max_size=20), st.integers(min_value=0, max_value=5))
def test_ranges_equals_vector(values: list[float], digits: int) -> None:
    """The fast list printer and the plain one give the same text, also where it looks it up."""
    assert ranges(np.array(values), digits) == vector(values, digits)
    for limit in (10_001.0, 99.5):
        small = [math.fmod(value, limit) for value in values]
        assert ranges(small, digits) == vector(small, digits)
        positive = [abs(value) for value in small]
        assert ranges(positive, digits) == vector(positive, digits)


def test_ranges_at_the_steps_of_its_tables() -> None:
    """Protocol 2.1: whole numbers, halves of the last digit and what rounding makes of them, either
    sign."""
    steps = np.array([0.0, 9.0, 10.0, 98.0, 99.0, 999.0, 9998.0, 9999.0, 10_000.0])
    for digits in range(6):
        last = 10.0**-digits
        near = np.add.outer(steps, last * np.array([-1.0, -0.5, -1e-4, 0.0, 1e-4, 0.5, 1.0]))
        for values in (near, -near, np.abs(near[:4])):
            assert ranges(values, digits) == vector(values.ravel().tolist(), digits)
            for row in values:  # each by the way that suits it
                assert ranges(row, digits) == vector(row.tolist(), digits)


@given(st.lists(st.floats(width=32), min_size=1, max_size=20))
def test_ranges_of_single_precision(values: list[float]) -> None:
    """Protocol 53: single precision arrays with any content print plain decimals only."""
    text = ranges(np.array(values, dtype=np.float32), 2)
    assert len(text.split(",")) == len(values)
    assert set(text) <= set("0123456789.,-")
    assert "-0.00," not in text + ","


def test_ranges_of_odd_shapes() -> None:
    """Rows follow each other; nothing gives an empty text; nan and infinities print as 0."""
    assert ranges([[1.0, 2.0], [3.0, 4.0]], 1) == "1.0,2.0,3.0,4.0"
    assert ranges([], 2) == ""
    assert ranges([math.nan, math.inf, -math.inf, -0.001], 2) == "0.00,0.00,0.00,0.00"


def test_booleans() -> None:
    """Protocol 55: True and False, nothing else."""
    assert boolean(True) == "True"
    assert boolean(False) == "False"


_PRINT_UNDER_LOCALE = """
import locale, sys
locale.setlocale(locale.LC_ALL, sys.argv[1])
assert locale.str(1.5) == "1,5", "the locale has a decimal point"
from usarsim_server.protocol.numbers import fixed, ranges, read_number, vector
print(fixed(1234.5, 2), ranges([1.5, 2.5], 2), vector((0.5,), 1))
print(read_number("1.5"), read_number("1,5"))
"""


def test_locale_does_not_matter(tmp_path: Path) -> None:
    """Protocol 53: in a process with a decimal comma locale numbers have a point and read the
    same."""
    locale = tmp_path / "de_DE.ISO-8859-1"
    localedef = shutil.which("localedef")
    if localedef is None or not Path("/usr/share/i18n/locales/de_DE").exists():
        pytest.skip("no sources to build a decimal comma locale from")
    subprocess.run([localedef, "-i", "de_DE", "-f", "ISO-8859-1", locale], check=False)
    answer = subprocess.run(
        [sys.executable, "-c", _PRINT_UNDER_LOCALE, locale.name],
        env={**os.environ, "LOCPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.stderr == ""
    assert answer.stdout.split() == ["1234.50", "1.50,2.50", "0.5", "1.5", "1.5"]


LATIN = st.text(st.characters(max_codepoint=255), max_size=40)
"""What a client can send: bytes are taken as Latin-1."""


def test_names_of_real_clients_stay_as_they_are() -> None:
    """Letters, digits and signs of known controllers pass unchanged, letters of Latin-1 too."""
    for name in ("Rover7", "robot_0", "R1", "P3AT-2.b", "Jörg", "comstation:1", "a/b;c"):
        assert clean_name(name) == name


def test_blanks_controls_and_braces_become_underscores() -> None:
    """A run of blanks and braces one, every control character one; outer blanks vanish."""
    assert clean_name("  Evil Location 9,9,0 ") == "Evil_Location_9,9,0"
    assert clean_name("a \t {b}\x00c\x7f\xa0d") == "a_b__c__d"
    assert clean_name(" \t ") == ""


@given(LATIN)
def test_a_clean_name_is_one_printable_token(text: str) -> None:
    """Whatever is sent; cleaning twice changes nothing, and the key knows no case."""
    name = clean_name(text)
    assert name.isprintable()
    assert len(name.split()) == (1 if name else 0)
    assert not set(name) & set("{} ")
    assert clean_name(name) == name
    assert name_key(text) == name_key(name) == name_key(name.lower())


@given(st.lists(LATIN.filter(lambda text: bool(clean_name(text))), max_size=20))
def test_all_names_differ_whatever_the_case(wishes: list[str]) -> None:
    """Everybody gets a name; it begins like the wish, and nobody's key is anybody else's."""
    taken: set[str] = set()
    for wish in [*wishes, *map(str.lower, wishes)]:
        if not clean_name(wish) or len(clean_name(wish)) > LONGEST_NAME:
            continue
        name = free_name(wish, taken)
        assert name.lower() not in taken
        assert len(name) <= LONGEST_NAME
        taken.add(name_key(name))


def test_who_comes_second_gets_a_number() -> None:
    """Case makes no difference; the number fits into the longest name."""
    assert free_name("R1", set()) == "R1"
    assert free_name("r1", {"r1"}) == "r1_2"
    assert free_name("R1", {"r1", "r1_2"}) == "R1_3"
    longest = "x" * LONGEST_NAME
    assert free_name(longest, {longest}) == "x" * (LONGEST_NAME - 2) + "_2"


@pytest.mark.parametrize("text", ["", "  ", "x" * (LONGEST_NAME + 1), "x" * 65_000])
def test_no_name_and_a_name_too_long_are_refused(text: str) -> None:
    """Not cut: two robots of one client would else bear names that it does not know."""
    with pytest.raises(ValueError, match="name"):
        free_name(text, set())


@given(LATIN.filter(lambda text: bool(clean_name(text))))
def test_a_name_forges_no_field(text: str) -> None:
    """In truth lists and in lines with segments the name is one value, and all else is ours."""
    name = clean_name(text)
    (group,) = parse_line(
        ground_truth.positions([ground_truth.Position(name, (1.0, 2.0, 3.0))]).encode("latin-1")
    )
    assert group.segments[1:] == (
        ("Name", f"{name} Location 1.0000,2.0000,3.0000 BatteryEmpty False"),
    )
    line = messages.encode(messages.status_change(0.0, "Told", "Robot", name))
    assert parse_line(line.rstrip(b"\r\n"))[0].segments[2:] == (("Type", "Robot"), ("Name", name))
