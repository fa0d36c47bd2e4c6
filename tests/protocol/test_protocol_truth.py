"""The dialogue of the scoring tools: everything is a query, listings are matched by position."""

from __future__ import annotations

import itertools
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol.truth import (
    MAX_LISTING,
    Actor,
    Query,
    QueryFramer,
    listing,
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
    """92, 93: the lines of side channels 6.1."""
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
    """90: nothing found."""
    assert listing([], 1.0) == "{End}\r\n"


@given(st.lists(ACTORS, max_size=5), st.floats(0.0, 1e6))
def test_every_line_has_the_form(actors: list[Actor], time: float) -> None:
    """92, 93: whatever the numbers, lines match from column 0 and the end marker is last."""
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
    """88 to 91: groups in any order and case of key; everything else is the default query."""
    assert read_query(line) == query


def test_packages_and_case_of_a_class_do_not_matter() -> None:
    """90: the engine's class names have no case."""
    assert Query("USARBot.P3AT").bare_class == Query("p3at").bare_class == "p3at"


@given(st.text())
def test_reading_never_fails(text: str) -> None:
    """Whatever comes is a query."""
    read_query(text)
    read_query(f"{{class {text}}} {{name {text}}}")


# -- framing -------------------------------------------------------------------------------------


def test_an_empty_line_is_a_query() -> None:
    """88: CR LF alone, LF alone, and several of them."""
    assert QueryFramer().feed(b"\r\n") == [b""]
    assert QueryFramer().feed(b"\n\r\n\n") == [b"", b"", b""]


def test_a_split_line_end_is_one() -> None:
    """6.1: the LF of a CR LF that arrives in two pieces is no line of its own."""
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
