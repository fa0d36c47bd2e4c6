"""The dialogues of the scoring tools and of ground truth: sloppy requests, replies for strict
readers, which match listings by position.
"""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol.numbers import single
from usarsim_server.protocol.truth import (
    MAX_LISTING,
    Actor,
    BetweenPoints,
    BetweenRobots,
    Incomplete,
    Position,
    Positions,
    Query,
    QueryFramer,
    listing,
    obstacles,
    positions,
    read_ground_truth_query,
    read_query,
)

NUMBER = r"-?\d+\.\d\d"
LINE = re.compile(
    r"\{Name ([^{} ]+)\} \{Class ([^{} ]+)\} \{Time (\d+\.\d{4})\} "
    rf"\{{Location ({NUMBER}),({NUMBER}),({NUMBER})\}} "
    rf"\{{Rotation ({NUMBER}),({NUMBER}),({NUMBER})\}}"
)
"""The form of side channels 6.1 from column 0, single blanks."""

ANY = st.floats(allow_nan=True, allow_infinity=True)
TRIPLES = st.tuples(ANY, ANY, ANY)
WORDS = st.text(st.characters(categories=["L", "N"], max_codepoint=255), min_size=1, max_size=9)
ACTORS = st.builds(Actor, WORDS, WORDS, TRIPLES, TRIPLES)


def test_the_listing_of_the_reference_comes_out_letter_by_letter() -> None:
    """Side channels 92, 93: the lines of side channels 6.1."""
    robot = Actor("P3AT_0", "P3AT", (0.667, 2.3, 1.861), (-0.001, 0.4599, 0.0))
    victim = Actor("MaleVictim_0", "MaleVictim", (5.1, -3.25, 1.02), (0.0, -0.0, 1.5708))
    assert listing([robot, victim], 29.97392) == (
        "{Name P3AT_0} {Class P3AT} {Time 29.9739} {Location 0.67,2.30,1.86} "
        "{Rotation -0.00,0.46,0.00}\r\n"
        "{Name MaleVictim_0} {Class MaleVictim} {Time 29.9739} {Location 5.10,-3.25,1.02} "
        "{Rotation 0.00,0.00,1.57}\r\n"
        "{End}\r\n"
    )


def test_an_empty_listing_is_its_end() -> None:
    """Side channels 90: nothing found."""
    assert listing([], 1.0) == "{End}\r\n"


@given(st.lists(ACTORS, max_size=5), st.floats(0.0, 1e6))
def test_every_line_has_the_form(actors: list[Actor], time: float) -> None:
    """Side channels 92, 93: whatever the numbers, lines match from column 0 and the end marker is
    last."""
    *lines, end, rest = listing(actors, time).split("\r\n")
    assert (end, rest) == ("{End}", "")
    assert len(lines) == len(actors)
    for line, actor in zip(lines, actors, strict=True):
        match = LINE.fullmatch(line)
        assert match is not None, line
        assert match[1] == actor.name
        assert math.isfinite(float(match[4]))


@pytest.mark.parametrize(
    ("line", "query"),
    [
        ("", Query()),
        ("{Actors}", Query()),
        ("{Actor}", Query()),
        ("hello", Query()),
        ("{", Query()),
        ("{class}", Query()),
        ("{class USARPhysObj.partc} {name part_c_5}", Query("USARPhysObj.partc", "part_c_5")),
        ("{Name part_c_5}{CLASS partc}", Query("partc", "part_c_5")),
        ("{name P3AT_0}", Query("", "P3AT_0")),
        ("{name p3at_0} {name P3AT_1}", Query("", "p3at_0")),
    ],
)
def test_queries(line: str, query: Query) -> None:
    """Side channels 88 to 91: groups in any order and case of key; everything else is the default
    query."""
    assert read_query(line) == query


def test_packages_and_case_of_a_class_do_not_matter() -> None:
    """Side channels 90: the engine's class names have no case."""
    assert Query("USARBot.P3AT").bare_class == Query("p3at").bare_class == "p3at"


@given(st.text())
def test_reading_never_fails(text: str) -> None:
    """Whatever comes is a query."""
    read_query(text)
    read_query(f"{{class {text}}} {{name {text}}}")


# -- framing -------------------------------------------------------------------------------------


def test_an_empty_line_is_a_query() -> None:
    """Side channels 88: CR LF alone, LF alone, and several of them."""
    assert QueryFramer().feed(b"\r\n") == [b""]
    assert QueryFramer().feed(b"\n\r\n\n") == [b"", b"", b""]


def test_a_split_line_end_is_one() -> None:
    """Side channels 6.1: the LF of a CR LF that arrives in two pieces is no line of its own."""
    framer = QueryFramer()
    assert framer.feed(b"{Actors}\r") == []
    assert framer.feed(b"\n") == [b"{Actors}"]
    assert framer.feed(b"\r") == []
    assert framer.feed(b"\n{x}\r\n") == [b"", b"{x}"]


@given(st.binary(max_size=60), st.lists(st.integers(0, 60), max_size=6))
def test_chunks_do_not_matter(data: bytes, cuts: list[int]) -> None:
    """However the bytes are cut, the lines are those of the whole."""
    places = sorted({0, len(data), *(min(place, len(data)) for place in cuts)})
    framer = QueryFramer()
    pieces = [line for a, b in itertools.pairwise(places) for line in framer.feed(data[a:b])]
    whole = QueryFramer()
    assert (
        pieces == whole.feed(data) == [part.removesuffix(b"\r") for part in data.split(b"\n")[:-1]]
    )
    assert framer.pending == whole.pending


def test_long_lines_are_thrown_away_whole() -> None:
    """A line beyond the limit costs no memory and is no query; the next one is heard."""
    framer = QueryFramer(max_line=10)
    assert framer.feed(b"x" * 11) == []
    assert framer.pending == 0
    assert framer.feed(b"y" * 100 + b"\r\n") == []
    assert framer.discarded == 1
    assert framer.feed(b"{a}\n") == [b"{a}"]
    assert framer.feed(b"z" * 10 + b"\n") == [b"z" * 10]


def test_a_listing_has_a_longest_length() -> None:
    """Actors for whom there is no room are left out whole; the end is always there."""
    actor = Actor("x" * 60, "P3AT", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    text = listing([actor] * 10_000, 1.0)
    assert MAX_LISTING - 500 < len(text) <= MAX_LISTING
    assert text.endswith("}\r\n{End}\r\n")


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
    """Side channels 50: four digits, truncated, as recorded from the original
    (side channels 3.2)."""
    assert single(value, 4) == text


@given(NUMBERS)
def test_numbers_never_round_away_from_zero(value: float) -> None:
    """Side channels 50: what is printed lies between the single precision value and zero, within
    1e-4."""
    text = single(value, 4)
    exact = float(np.float32(value))
    assert len(text.partition(".")[2]) == 4
    assert abs(float(text)) <= abs(exact)
    assert abs(exact) - abs(float(text)) < 1.0001e-4


# -- requests ------------------------------------------------------------------------------------


@pytest.mark.parametrize("line", ["GETPOS", "getpos", "GetPos ", "  GETPOS", "GETPOS {Robot x}"])
def test_positions_are_asked_for_in_any_case(line: str) -> None:
    """Side channels 53: the command word counts without case; groups behind it do no harm."""
    assert read_ground_truth_query(line) == Positions()


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
    """Side channels 3.1, 3.3: keys in any case, the first one counts, values trimmed, robots before
    points."""
    assert read_ground_truth_query(line) == BetweenRobots("r1", "R2")


def test_points_are_kept_as_sent_and_understood() -> None:
    """Side channels 59: the text of a point goes back verbatim; its numbers are wire
    coordinates."""
    query = read_ground_truth_query("GETOBS {Start 0,0.50,-1} {End 10,0,0}")
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
    """Side channels 60: neither two robots nor two points."""
    assert read_ground_truth_query(line) == Incomplete()


def test_robots_that_are_incomplete_give_way_to_points() -> None:
    """Side channels 3.3: if From or To is missing, Start and End are used."""
    assert isinstance(
        read_ground_truth_query("GETOBS {From a} {Start 0,0,0} {End 1,0,0}"), BetweenPoints
    )


@pytest.mark.parametrize("line", ["", " ", "GETPOSE", "INIT {Robot a} {Port 1}", "{GETPOS}", "POS"])
def test_everything_else_is_no_request(line: str) -> None:
    """Side channels 61: unknown words are not understood, those of the wireless server neither."""
    assert read_ground_truth_query(line) is None


@given(st.text())
def test_reading_never_fails_truth(text: str) -> None:
    """Whatever a client sends, it is read or refused, never an exception."""
    for line in (text, f"GETOBS {text}", f"GETOBS {{Start {text}}} {{End {text}}}"):
        read_ground_truth_query(line)


# -- replies -------------------------------------------------------------------------------------


def test_nobody_is_told_exactly() -> None:
    """Side channels 48: the reply without robots."""
    assert positions([]) == "POSITIONS {Robots 0}"


def test_the_reply_of_the_reference_comes_out_letter_by_letter() -> None:
    """Side channels 49 to 52, 64: the robots of side channels 3.2, one of them with an empty
    battery."""
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
    """Side channels 56, 58, 59: the texts of side channels 3.3."""
    robots, points = (
        BetweenRobots("ComStation", "Robot1"),
        read_ground_truth_query("GETOBS {Start 0,0,0} {End 1,2,3}"),
    )
    assert obstacles(robots, 2) == "NUMOBS {From ComStation} {To Robot1} {ObstCount 2.0000}"
    assert obstacles(robots, -1) == "NUMOBS {From ComStation} {To Robot1} {ObstCount -1.0000}"
    assert isinstance(points, BetweenPoints)
    assert obstacles(points, 0) == "NUMOBS {Start 0,0,0} {End 1,2,3} {ObstCount 0.0000}"


@given(st.lists(ROBOTS, max_size=16))
def test_the_strict_reader_finds_every_robot(robots: list[Position]) -> None:
    """Side channels 65: cut as strictly as side channels 3.4 demands, a reply yields every robot
    whole."""
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
    """Side channels 65, 3.4: three groups of two words; the number before the point is the
    count."""
    head, groups = cut(obstacles(BetweenRobots(start, end), count))
    assert head == "NUMOBS"
    assert groups[:2] == [["From", start], ["To", end]]
    assert int(groups[2][1].partition(".")[0]) == count
