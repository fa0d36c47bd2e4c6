"""The ground truth dialogue: sloppy requests, replies for strict readers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol.numbers import single
from usarsim_server.protocol.truth import (
    BetweenPoints,
    BetweenRobots,
    Incomplete,
    Position,
    Positions,
    obstacles,
    positions,
)
from usarsim_server.protocol.truth import (
    read_ground_truth_query as read_query,
)

NAMES = st.text(st.characters(categories=["L", "N"], max_codepoint=255), min_size=1, max_size=12)
NUMBERS = st.floats(-1e4, 1e4)
ROBOTS = st.builds(Position, NAMES, st.tuples(NUMBERS, NUMBERS, NUMBERS), st.booleans())


def cut(line: str) -> tuple[str, list[list[str]]]:
    """Head and groups of a reply, cut as the strict reader of side channels 3.4 does.

    After the head exactly one blank and a brace; between groups exactly one blank, otherwise the
    rest is lost; inside a group single blanks.
    """
    head, blank, rest = line.partition(" ")
    assert blank
    groups = []
    while rest.startswith("{"):
        end = rest.index("}")
        groups.append(rest[1:end].split(" "))
        rest = rest[end + 1 :]
        if not rest.startswith(" {"):
            break
        rest = rest[1:]
    assert rest == "", f"the reader would stop before {rest!r}"
    return head, groups


# -- numbers -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.3, "1.2999"),
        (27.8247, "27.8246"),
        (-0.00001, "-0.0000"),
        (-5.4734, "-5.4734"),
        (0.0, "0.0000"),
        (-0.0, "0.0000"),
        (1.472, "1.4720"),
        (0.9999, "0.9998"),
        (0.99999, "0.9999"),
        (-1.99999, "-1.9999"),
        (1000.0, "1000.0000"),
        (math.nan, "0.0000"),
        (-math.inf, "0.0000"),
        (1e300, "999999986991104.0000"),
    ],
)
def test_numbers_are_single_precision_and_cut_off(value: float, text: str) -> None:
    """50: four digits, truncated, as recorded from the original (side channels 3.2)."""
    assert single(value, 4) == text


@given(NUMBERS)
def test_numbers_never_round_away_from_zero(value: float) -> None:
    """50: what is printed lies between the single precision value and zero, within 1e-4."""
    text = single(value, 4)
    exact = float(np.float32(value))
    assert len(text.partition(".")[2]) == 4
    assert abs(float(text)) <= abs(exact)
    assert abs(exact) - abs(float(text)) < 1.0001e-4


# -- requests ------------------------------------------------------------------------------------


@pytest.mark.parametrize("line", ["GETPOS", "getpos", "GetPos ", "  GETPOS", "GETPOS {Robot x}"])
def test_positions_are_asked_for_in_any_case(line: str) -> None:
    """53: the command word counts without case; groups behind it do no harm."""
    assert read_query(line) == Positions()


@pytest.mark.parametrize(
    "line",
    [
        "GETOBS {From r1} {To R2}",
        "getobs {from r1} {TO R2}",
        "GETOBS{From r1}{To R2}",
        "GETOBS   {To  R2 }   { From r1}",
        "GETOBS {From r1} {To R2} {From r3} {Start 0,0,0} {End 1,1,1}",
    ],
)
def test_robots_are_named_anyhow(line: str) -> None:
    """3.1, 3.3: keys in any case, the first one counts, values trimmed, robots before points."""
    assert read_query(line) == BetweenRobots("r1", "R2")


def test_points_are_kept_as_sent_and_understood() -> None:
    """59: the text of a point goes back verbatim; its numbers are wire coordinates."""
    query = read_query("GETOBS {Start 0,0.50,-1} {End 10,0,0}")
    assert query == BetweenPoints("0,0.50,-1", "10,0,0", (0.0, 0.5, -1.0), (10.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "line",
    [
        "GETOBS",
        "GETOBS {From r1}",
        "GETOBS {To r1}",
        "GETOBS {From r1} {End 1,1,1}",
        "GETOBS {From } {To r2}",
        "GETOBS {Start 0,0,0}",
        "GETOBS {Start 0,0,0} {To r}",
    ],
)
def test_half_a_pair_is_incomplete(line: str) -> None:
    """60: neither two robots nor two points."""
    assert read_query(line) == Incomplete()


def test_robots_that_are_incomplete_give_way_to_points() -> None:
    """3.3: if From or To is missing, Start and End are used."""
    assert isinstance(read_query("GETOBS {From a} {Start 0,0,0} {End 1,0,0}"), BetweenPoints)


@pytest.mark.parametrize("line", ["", " ", "GETPOSE", "INIT {Robot a} {Port 1}", "{GETPOS}", "POS"])
def test_everything_else_is_no_request(line: str) -> None:
    """61: unknown words are not understood, those of the wireless server neither."""
    assert read_query(line) is None


@given(st.text())
def test_reading_never_fails(text: str) -> None:
    """Whatever a client sends, it is read or refused, never an exception."""
    for line in (text, f"GETOBS {text}", f"GETOBS {{Start {text}}} {{End {text}}}"):
        read_query(line)


# -- replies -------------------------------------------------------------------------------------


def test_nobody_is_told_exactly() -> None:
    """48: the reply without robots."""
    assert positions([]) == "POSITIONS {Robots 0}"


def test_the_reply_of_the_reference_comes_out_letter_by_letter() -> None:
    """49 to 52, 64: the robots of side channels 3.2, one of them with an empty battery."""
    assert positions(
        [
            Position("Robot1", (-5.4734, 27.8247, 1.472)),
            Position("ComStation", (0.0, 0.0, 0.0), battery_empty=True),
        ]
    ) == (
        "POSITIONS {Robots 2} {Name Robot1 Location -5.4734,27.8246,1.4720 BatteryEmpty False} "
        "{Name ComStation Location 0.0000,0.0000,0.0000 BatteryEmpty True}"
    )


def test_counts_are_floats() -> None:
    """56, 58, 59: the texts of side channels 3.3."""
    robots, points = (
        BetweenRobots("ComStation", "Robot1"),
        read_query("GETOBS {Start 0,0,0} {End 1,2,3}"),
    )
    assert obstacles(robots, 2) == "NUMOBS {From ComStation} {To Robot1} {ObstCount 2.0000}"
    assert obstacles(robots, -1) == "NUMOBS {From ComStation} {To Robot1} {ObstCount -1.0000}"
    assert isinstance(points, BetweenPoints)
    assert obstacles(points, 0) == "NUMOBS {Start 0,0,0} {End 1,2,3} {ObstCount 0.0000}"


@given(st.lists(ROBOTS, max_size=16))
def test_the_strict_reader_finds_every_robot(robots: list[Position]) -> None:
    """65: cut as strictly as side channels 3.4 demands, a reply yields every robot whole."""
    head, groups = cut(positions(robots))
    assert (head, groups[0]) == ("POSITIONS", ["Robots", str(len(robots))])
    assert len(groups) == len(robots) + 1
    for robot, words in zip(robots, groups[1:], strict=True):
        assert words[0::2] == ["Name", "Location", "BatteryEmpty"]
        name, location, empty = words[1::2]
        assert name == robot.name
        assert len([float(part) for part in location.split(",")]) == 3
        assert empty == str(robot.battery_empty)


@given(NAMES, NAMES, st.integers(-1, 1000))
def test_the_strict_reader_finds_the_count(start: str, end: str, count: int) -> None:
    """65, 3.4: three groups of two words; the number before the point is the count."""
    head, groups = cut(obstacles(BetweenRobots(start, end), count))
    assert head == "NUMOBS"
    assert groups[:2] == [["From", start], ["To", end]]
    assert int(groups[2][1].partition(".")[0]) == count
