"""Names: one printable token each, unique whatever the case, with nothing to forge fields with."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol import messages
from usarsim_server.protocol import truth as ground_truth
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.names import LONGEST_NAME, clean_name, free_name, name_key

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
