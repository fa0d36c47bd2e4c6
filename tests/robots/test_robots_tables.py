"""The strict TOML reader."""

from __future__ import annotations

from pathlib import Path

import pytest

from usarsim_server.errors import RobotDescriptionError
from usarsim_server.robots.tables import TableReader, nearest, read_toml

FILE = Path("some/Robot.toml")


def reader(**table: object) -> TableReader:
    return TableReader(table, FILE, "[[wheel]] number 2 (W1)")


def test_getters_return_what_the_table_says() -> None:
    """Every getter returns the value of its key in the asked type."""
    table = reader(n=1, v=[1, 2.5, 3], w=[1.0, 0.5], t="text", b=True, names=["a", "b"], c="red")
    assert table.number("n") == 1.0
    assert isinstance(table.number("n"), float)
    assert table.vector("v") == (1.0, 2.5, 3.0)
    assert table.numbers("w", (2, 3)) == (1.0, 0.5)
    assert table.text("t") == "text"
    assert table.boolean("b", False) is True
    assert table.texts("names") == ("a", "b")
    assert table.choice("c", ("red", "green")) == "red"
    table.finish()


def test_missing_keys_take_their_defaults() -> None:
    """A key that is not there yields its default."""
    table = reader()
    assert table.number("n", 4.0) == 4.0
    assert table.vector("v", (1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
    assert table.text("t", "") == ""
    assert table.boolean("b", True) is True
    assert table.texts("names") == ()
    assert table.tables("sensor") == []
    table.table("drive").finish()
    table.finish()


@pytest.mark.parametrize(
    ("getter", "problem"),
    [
        (lambda table: table.number("x"), "x: is missing"),
        (lambda table: table.vector("x"), "x: is missing"),
        (lambda table: table.text("x"), "x: is missing"),
        (lambda table: table.choice("x", ("a",)), "x: is missing"),
        (lambda table: table.number("flag"), "flag: is true or false"),
        (lambda table: table.number("word"), "word: is a text"),
        (lambda table: table.number("nan"), "nan: is not a finite number"),
        (lambda table: table.number("inf"), "inf: is not a finite number"),
        (lambda table: table.number("huge"), "huge: is not a finite number"),
        (lambda table: table.number("minus", low=0.0), "minus: is -1"),
        (lambda table: table.number("minus", low=-9.0, high=-2.0), "between -9 and -2"),
        (lambda table: table.number("minus", high=-2.0), "of at most -2"),
        (lambda table: table.vector("word"), "word: is a text"),
        (lambda table: table.vector("pair"), "pair: has 2 numbers"),
        (lambda table: table.vector("mixed"), "mixed: is a text"),
        (lambda table: table.text("minus"), "minus: is a whole number"),
        (lambda table: table.text("bell"), "bell: has control characters"),
        (lambda table: table.choice("word", ("a", "b")), "write one of: a, b"),
        (lambda table: table.boolean("minus", False), "minus: is a whole number"),
        (lambda table: table.texts("word"), "word: is a text"),
        (lambda table: table.texts("pair"), "pair: is a whole number"),
        (lambda table: table.table("word"), "word: is a text"),
        (lambda table: table.tables("word"), "word: is not a list of tables"),
        (lambda table: table.tables("pair"), "pair: is not a list of tables"),
    ],
)
def test_wrong_values_name_file_place_key_and_problem(getter, problem: str) -> None:
    """A wrong value is one error that says file, table, key and what is wrong."""
    table = reader(
        flag=True,
        word="hello",
        nan=float("nan"),
        inf=float("inf"),
        huge=10**400,
        minus=-1,
        pair=[1, 2],
        mixed=[1, "a", 2],
        bell="a\ab",
    )
    with pytest.raises(RobotDescriptionError) as caught:
        getter(table)
    message = str(caught.value)
    assert message.startswith(f"{FILE}: [[wheel]] number 2 (W1) ")
    assert problem in message
    assert "\n" not in message


def test_unknown_keys_are_refused_with_the_nearest_known_one() -> None:
    """A misspelt key is refused, and the key that was probably meant is named."""
    table = reader(radus=0.1)
    table.number("radius", 0.2)
    table.number("width", 0.2)
    with pytest.raises(RobotDescriptionError, match=r"unknown key 'radus' \(did you mean 'radius'"):
        table.finish()


def test_unknown_keys_take_a_hint_where_there_is_one() -> None:
    """A key that users are likely to try has a cure of its own."""
    with pytest.raises(RobotDescriptionError, match="follows from the wheels"):
        reader(mass=3).finish({"mass": "it follows from the wheels"})


def test_nearest_lists_everything_when_nothing_is_near() -> None:
    """Without a similar word all known words are listed."""
    assert nearest("zzz", ["alpha", "beta"]) == "known are: alpha, beta"
    assert nearest("ALPHA1", ["alpha", "beta"]) == "did you mean 'alpha'?"
    assert nearest("x", []) == "nothing is known here"


def test_rest_hands_on_unread_keys_and_those_asked_for() -> None:
    """`rest` returns what nobody read, plus the named keys, and leaves nothing to refuse."""
    table = reader(name="F1", interval=0.2, cones=3, deep={"a": [1.0, True]})
    table.text("name")
    table.number("interval")
    assert table.rest("interval") == {"interval": 0.2, "cones": 3, "deep": {"a": [1.0, True]}}
    table.finish()


@pytest.mark.parametrize("bad", [float("nan"), [1.0, float("inf")], {"a": float("nan")}])
def test_rest_refuses_numbers_that_are_not_finite(bad: object) -> None:
    """Not-a-number and infinity do not get through in free parameters either."""
    with pytest.raises(RobotDescriptionError, match="not a finite number"):
        reader(noise=bad).rest()


def test_rest_refuses_control_characters() -> None:
    """Texts of free parameters are printable, since they may end up on the wire."""
    with pytest.raises(RobotDescriptionError, match="control characters"):
        reader(label="a\r\nSEN").rest()


def test_tables_know_their_number_and_name() -> None:
    """The tables of a list say in their place which they are."""
    tables = TableReader({"sensor": [{}, {"name": "F1"}, {"name": 3}]}, FILE).tables("sensor")
    assert [table.place for table in tables] == [
        f"{FILE}: [[sensor]] number 1",
        f"{FILE}: [[sensor]] number 2 (F1)",
        f"{FILE}: [[sensor]] number 3",
    ]
    assert TableReader({}, FILE).place == str(FILE)


def test_is_false_is_true_only_for_false() -> None:
    """A table is switched off by `false` and by nothing else."""
    assert reader(battery=False).is_false("battery")
    assert not reader(battery=0).is_false("battery")
    assert not reader().is_false("battery")


def test_file_that_cannot_be_read_is_one_error(tmp_path: Path) -> None:
    """A missing file, a folder, bad TOML and bad UTF-8 are all robot description errors."""
    with pytest.raises(RobotDescriptionError, match="cannot be read"):
        read_toml(tmp_path / "absent.toml")
    with pytest.raises(RobotDescriptionError, match="cannot be read"):
        read_toml(tmp_path)
    path = tmp_path / "bad.toml"
    path.write_text("name = ")
    with pytest.raises(RobotDescriptionError, match="not valid TOML"):
        read_toml(path)
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(RobotDescriptionError, match="not UTF-8"):
        read_toml(path)


@pytest.mark.parametrize(
    "text", ["a = " + "[" * 100_000, "a = " + "1" * 10_000, "a = 2024-13-45", "a = 1\na = 2"]
)
def test_hostile_toml_is_one_error(tmp_path: Path, text: str) -> None:
    """Endless nesting, endless numbers, impossible dates and double keys are ordinary errors."""
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(RobotDescriptionError, match="not valid TOML"):
        read_toml(path)
