"""The expressions of scoring files: what they are worth, and what is refused, and where (O-52)."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_mission.expression import MAX_DEPTH, Expression, ExpressionError

RANGES = {
    "V": (1.0, 1e6),
    "VF": (0.0, 1e6),
    "T": (0.0, 1.0),
    "B": (-1e9, 1e9),
    "N": (1.0, 1e3),
}
VALUES = {"V": 10.0, "VF": 4.0, "T": 0.5, "B": -3.0, "N": 2.0}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("8 - 3 - 2", 3.0),
        ("8 / 4 / 2", 1.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("-2 ^ 2", -4.0),
        ("(-2) ^ 2", 4.0),
        ("2 ^ -1", 0.5),
        ("2 * -3", -6.0),
        ("+-+4", -4.0),
        (".5e1 + 1.", 6.0),
        ("min(3, 1, 2) + max(3, 1, 2)", 4.0),
        ("clamp(1.5) + clamp(-0.5) + clamp(7, 2, 5)", 6.0),
        ("50 * (VF / V + T) / N ^ 2", 11.25),
        ("1 / max(1, V - VF)", 1.0 / 6.0),
        ("\n VF\n - 1\n", 3.0),
    ],
)
def test_values(text: str, value: float) -> None:
    assert Expression(text, RANGES).value(VALUES) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "column", "problem"),
    [
        ("", 1, "is empty"),
        ("1 +", 4, "missing at the end"),
        ("1 2", 3, "operator is missing before '2'"),
        ("(1", 3, ") is missing"),
        ("1)", 2, "one ) too many"),
        ("1 + * 2", 5, "'*' stands where a value should"),
        ("VX + 1", 1, "unknown variable VX (did you mean 'V"),
        ("1 + Vf", 5, "unknown variable Vf (did you mean 'VF'?)"),
        ("1 + total", 5, "total stands in itself"),
        ("sin(1)", 1, "there is no function sin"),
        ("mim(1, 2)", 1, "did you mean 'min'?"),
        ("max", 1, "max has no ( )"),
        ("max(1)", 1, "does not take 1 values"),
        ("clamp(1, 2)", 1, "does not take 2 values"),
        ("1 / 0", 3, "division by zero"),
        ("1 / (2 - 2)", 3, "below / is 0"),
        ("1 / VF", 3, "below / may be 0"),
        ("1 / (V - VF)", 3, "below / may be 0"),
        ("VF ^ -1", 4, "division by zero"),
        ("B ^ 0.5", 3, "power of a negative number"),
        ("V ^ V", 3, "too large"),
        ("10 ^ 16", 4, "too large"),
        ("9 ^ 9 ^ 9 ^ 9", 7, "too large"),
        ("1e16", 1, "too large"),
        ("1e999", 1, "too large"),
        ("__import__('os')", 1, "there is no function __import__"),
        ("V.real", 2, "an operator is missing before '.'"),
        ("V ** 2", 4, "'*' stands where a value should"),
        ("V if T else N", 3, "an operator is missing before 'if'"),
        ("(" * (MAX_DEPTH + 1) + "1" + ")" * (MAX_DEPTH + 1), MAX_DEPTH + 2, "too deeply"),
        ("-" * (MAX_DEPTH + 1) + "1", MAX_DEPTH + 2, "too deeply"),
        ("1 + " * 1000 + "1", 2001, "too long"),
    ],
)
def test_what_cannot_be_is_refused_with_its_column(text: str, column: int, problem: str) -> None:
    """O-52."""
    with pytest.raises(ExpressionError) as refusal:
        Expression(text, RANGES)
    assert problem in str(refusal.value)
    assert refusal.value.column == column


def test_the_line_is_named_where_there_are_several() -> None:
    """O-52."""
    with pytest.raises(ExpressionError, match="line 2, column 5: unknown variable X"):
        Expression("V +\n 1 +X\n+ 2", {"V": (0.0, 1.0)})


def test_better_known_variables_may_show_a_division_by_zero() -> None:
    expression = Expression("VF / V", RANGES)
    with pytest.raises(ExpressionError, match="division by zero"):
        expression.check({**RANGES, "V": (0.0, 0.0)})


def test_the_range_of_a_value_holds_all_its_values() -> None:
    expression = Expression("B ^ 2", {"B": (-2.0, 3.0)})
    assert expression.check({"B": (-2.0, 3.0)}) == (0.0, 9.0)


LEAVES = st.sampled_from([*RANGES, "0", "1", "0.5", "3", "2.5", "100"])


def _larger(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    pair = st.tuples(inner, inner)
    return st.one_of(
        st.tuples(st.sampled_from(["+", "-", "*", "/", "^"]), pair).map(
            lambda one: f"({one[1][0]} {one[0]} {one[1][1]})"
        ),
        st.tuples(st.sampled_from(["min", "max"]), pair).map(
            lambda one: f"{one[0]}({one[1][0]}, {one[1][1]})"
        ),
        inner.map(lambda one: f"clamp({one})"),
        inner.map(lambda one: f"-{one}"),
    )


def _python(text: str, values: dict[str, float]) -> float:
    """The same by Python, whose signs bind alike."""
    names = {"min": min, "max": max, "clamp": lambda a: min(max(a, 0.0), 1.0), **values}
    return float(eval(text.replace("^", "**"), {"__builtins__": {}}, names))


@given(
    st.recursive(LEAVES, _larger, max_leaves=12),
    st.fixed_dictionaries({name: st.floats(0.0, 1.0) for name in RANGES}),
)
def test_what_is_accepted_has_a_value_everywhere(text: str, shares: dict[str, float]) -> None:
    """An expression that was not refused has a finite value: that of Python, in its range."""
    try:
        expression = Expression(text, RANGES)
    except ExpressionError:
        return
    values = {name: low + shares[name] * (high - low) for name, (low, high) in RANGES.items()}
    value = expression.value(values)
    assert math.isfinite(value)
    assert value == _python(text, values)
    low, high = expression.check(RANGES)
    slack = 1e-9 * max(1.0, abs(low), abs(high))
    assert low - slack <= value <= high + slack


@given(st.text("VFTBN0123456789.e+-*/^(), \nminaxclp", max_size=40) | st.text(max_size=20))
def test_any_text_is_read_or_refused(text: str) -> None:
    found: Expression | ExpressionError
    try:
        found = Expression(text, RANGES)
    except ExpressionError as refusal:
        found = refusal
    if isinstance(found, Expression):
        assert math.isfinite(found.value(VALUES))
    else:
        assert 1 <= found.line <= text.count("\n") + 1
        assert 1 <= found.column <= len(text) + 1
