"""One strict reader for all files: declared fields, getters, and what errors say."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Literal

import pytest
from key_tables import PAGES, rewritten

from usarsim_server.base.errors import WorldError
from usarsim_server.base.fields import field, keys
from usarsim_server.base.tables import Table, Vector, nearest, suggest


class Shape(Enum):
    """A word of files."""

    SPOT = "spot"
    POINT = "point"


@dataclass(frozen=True, slots=True)
class Bulb:
    """A table within a table."""

    power: float = field(default=10.0, unit="W", low=0.0, help="of the bulb")


@dataclass(frozen=True, slots=True)
class Lamp:
    """Every kind of field."""

    name: str = field(help="required")
    number: int = 0
    kind: Literal["ceiling", "floor"] = field(default="floor")
    shape: Shape = field(default=Shape.POINT)
    reach: float = field(default=10.0, unit="m", above=0.0, high=50.0, words={"far": 1e9})
    count: int = field(default=1, low=1, high=4)
    on: bool = field(default=True)
    color: Vector = field(default=(1.0, 1.0, 1.0), low=0.0, high=1.0)
    size: tuple[int, int] = field(default=(1, 2), low=0)
    tags: tuple[str, ...] = field(default=())
    yaw: float = field(default=0.0, key="yaw_degrees", convert=lambda value: value * 2)
    rate: float | None = field(default=None, low=0.0)
    side: str = field(default="L", parse=lambda table, key: table.text(key)[0], expects="a side")
    bulb: Bulb = field(factory=Bulb)
    spares: tuple[Bulb, ...] = field(default=(), key="spare")


def table(**content: Any) -> Table:
    """A table of a file."""
    return Table(content, "lab.toml", WorldError)


def test_declared_fields_are_read() -> None:
    """As their annotations say; absent ones have their defaults."""
    plain = table(name="A").read(Lamp)
    assert plain == Lamp("A")
    lamp = table(
        name="B", kind="ceiling", shape="spot", reach="far", count=2, on=False, color=[0, 0.5, 1],
        size=[3, 4], tags=["x"], yaw_degrees=3, rate=2, side="Right", bulb={"power": 5},
        spare=[{"power": 1}, {}],
    ).read(Lamp, number=7)  # fmt: skip
    assert lamp == Lamp(
        "B", 7, "ceiling", Shape.SPOT, 1e9, 2, False, (0.0, 0.5, 1.0), (3, 4), ("x",), 6.0, 2.0,
        "R", Bulb(5.0), (Bulb(1.0), Bulb()),
    )  # fmt: skip


def test_absent_keys_come_from_the_base() -> None:
    """So does what is not declared."""
    base = Lamp("B", 7, reach=3.0, bulb=Bulb(5.0))
    assert table(count=2, bulb={}).read(Lamp, base) == Lamp(
        "B", 7, reach=3.0, count=2, bulb=Bulb(5.0)
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "lab.toml: name: is missing (add name = text in quotes)"),
        ({"name": " "}, "name: is empty (write some text)"),
        ({"name": 3}, "name: 3 is not text (write text in quotes)"),
        ({"name": "a\nb"}, "name: has control characters"),
        ({"kind": "flor"}, "'flor' is not known (did you mean floor? write one of ceiling, floor)"),
        ({"shape": 1}, "shape: 1 is not text (write one of spot, point)"),
        ({"shape": "x"}, "shape: 'x' is not known (write one of spot, point)"),
        (
            {"reach": 0},
            "reach: 0 is out of range (write a number greater than 0 and of at most 50 m, or "
            '"far", for example reach = 10.0)',
        ),
        ({"reach": "near"}, "reach: 'near' is not a number"),
        ({"reach": True}, "reach: True is not a number"),
        ({"reach": float("nan")}, "reach: nan is not a finite number"),
        ({"reach": 10**400}, "is not a finite number"),
        ({"count": 5}, "(write a whole number from 1 to 4, for example count = 1)"),
        ({"count": 1.0}, "count: 1.0 is not a whole number"),
        ({"on": 1}, "on: 1 is not true or false (write true or false)"),
        ({"color": [0, 1]}, "color: [0, 1] is not 3 numbers such as [1.0, 2.0, 3.0]"),
        ({"color": [0, 1, 2]}, "color: 2 is out of range (write a number from 0 to 1)"),
        ({"size": [0.5, 1]}, "size: 0.5 is not a whole number"),
        ({"tags": "x"}, "tags: 'x' is not a list of texts"),
        ({"rate": -1}, "rate: -1 is out of range (write a number of at least 0)"),
        ({"bulb": 3}, "bulb: 3 is not a table, [bulb]"),
        ({"bulb": {"powr": 3}}, "[bulb]: powr: unknown key (did you mean power? known keys: "),
        ({"spare": [{}, {"power": -1, "name": "S"}]}, "[[spare]] 2 (S): power: -1 is out of range"),
        ({"spare": {}}, "spare: {} is not a list of tables, each beginning with [[spare]]"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_place_and_cure(content: dict[str, Any], message: str) -> None:
    """File, table, key, the value, and what to write instead."""
    with pytest.raises(WorldError) as caught:
        table(**({"name": "A"} if content else {}) | content).read(Lamp)
    assert message in str(caught.value)
    assert str(caught.value).startswith("lab.toml: ")


def test_keys_that_nobody_asked_for_are_refused() -> None:
    """With the nearest known one, all known ones, and what the table is of."""
    content = {"max_range": 3.0, "colour": 1}
    sick = Table(content, "r.toml", WorldError, "[[sensor]] 1", kind="a SICK")
    sick.number("max_range", 1.0)
    with pytest.raises(WorldError, match=r"1: colour: unknown key of a SICK \(remove it; known"):
        sick.finish()
    with pytest.raises(WorldError, match=r"colour: unknown key of a SICK \(paint it\)"):
        sick.finish({"colour": "paint it"})
    assert sick.rest() == {"colour": 1}
    sick.finish()


def test_hyphens_may_stand_for_underscores() -> None:
    """Where the reader says so; both spellings of one key are one too many."""
    one = Table({"a-b": 3}, "lab.toml", WorldError, hyphens=True)
    assert one.number("a_b", 1.0) == 3.0
    one.finish()
    two = Table({"a-b": 3, "a_b": 3}, "lab.toml", WorldError, hyphens=True)
    two.number("a_b")
    with pytest.raises(WorldError, match="a-b: given twice"):
        two.finish()


def test_near_words() -> None:
    """Whatever the case."""
    assert nearest("sick", ["GPS", "SICK"]) == "SICK"
    assert nearest("x", ["GPS"]) is None
    assert suggest("gsp", ["GPS"]) == "did you mean 'GPS'?"
    assert suggest("x", ["GPS", "INS"]) == "known are: GPS, INS"


def test_keys_tell_what_was_declared() -> None:
    """In order, for help and documents."""
    found = {key.key: key for key in keys(Lamp)}
    assert "number" not in found
    assert found["name"].required
    assert found["rate"].default() is None
    assert found["reach"].wanted == 'a number greater than 0 and of at most 50 m, or "far"'
    assert found["bulb"].default() == Bulb()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_of_keys_in_the_docs_are_those_of_the_declarations(page: Path) -> None:
    """If not: python tests/key_tables.py."""
    text = page.read_text(encoding="utf-8")
    assert rewritten(text) == text
