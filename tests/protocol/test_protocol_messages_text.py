"""Lines and bytes: what holds for every message (protocol reference 1.3; checklist 6 to 9)."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol.messages import encode
from usarsim_server.protocol.messages.text import line, segment, time_segment, token, triple


def test_a_line_ends_with_cr_lf() -> None:
    """6: bytes 13 10 at the end and nowhere else."""
    assert encode("STA {Type X}") == b"STA {Type X}\r\n"


@pytest.mark.parametrize("text", ["", " ", "\r\n", "\t \n"])
def test_an_empty_line_is_never_sent(text: str) -> None:
    """7: a text without content gives no bytes at all."""
    assert encode(text) == b""


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("SEN {Name a\r\nSTA {Type X}}", b"SEN {Name a STA {Type X}}\r\n"),
        ("SEN {Name a\tb}", b"SEN {Name a b}\r\n"),
        ("SEN  {Name   a}", b"SEN {Name a}\r\n"),
        ("  SEN {Name a}  ", b"SEN {Name a}\r\n"),
        ("SEN {Type Camera} ", b"SEN {Type Camera}\r\n"),
        (" SEN {Type Camera}", b"SEN {Type Camera}\r\n"),
        ("SEN {Name a\x00\x1b\x7fb}", b"SEN {Name a b}\r\n"),
        ("SEN {Name Röver\xa0\x85}", b"SEN {Name R\xf6ver\xa0\x85}\r\n"),
        ("SEN {Name 寿\u2028}", b"SEN {Name ??}\r\n"),
    ],
)
def test_names_cannot_break_a_line(text: str, data: bytes) -> None:
    """6, 8: line ends, tabs, control characters and doubled blanks shrink to one blank."""
    assert encode(text) == data


@given(st.text())
def test_any_text_encodes_to_at_most_one_tidy_line(text: str) -> None:
    """6 to 8: whatever the text, its bytes are nothing or one well formed line."""
    data = encode(text)
    if data:
        body = data.removesuffix(b"\r\n")
        assert len(body) == len(data) - 2
        assert not re.search(rb"[\x00-\x1f]|  ", body)
        assert body == body.strip(b" ") != b""


def test_segments() -> None:
    """4.5: key and value, or the key alone for an empty value."""
    assert segment("Name", "F1") == "{Name F1}"
    assert segment("None") == "{None}"
    assert segment("Name", "") == "{Name}"


def test_braces_inside_a_value_become_parentheses() -> None:
    """9, 171: no content can open or close a segment."""
    assert segment("Mem", "a}{Status OK") == "{Mem a)(Status OK}"


def test_lines_join_with_single_blanks() -> None:
    """9: exactly one blank between any two segments."""
    assert line("SEN", "{A 1}", "{B 2}") == "SEN {A 1} {B 2}"
    assert line("STA") == "STA"


def test_vectors_have_no_blanks() -> None:
    """54: components are joined by commas only."""
    assert triple("Location", (1, -0.5, 0), 2) == "{Location 1.00,-0.50,0.00}"


def test_time_is_never_negative() -> None:
    """85: Time matches digits, point, digits, also for a clock that starts below 0."""
    assert time_segment(-1e-9, 2) == "{Time 0.00}"
    assert time_segment(-5.0, 4) == "{Time 0.0000}"


@given(st.text())
def test_tokens_are_one_word(text: str) -> None:
    """82: tags and joint names are single words, never empty, without braces."""
    word = token(text)
    assert word
    assert not re.search(r"[\x00-\x20{}]", word)


def test_tokens_keep_ordinary_names() -> None:
    """An ordinary tag passes unchanged, a blank becomes an underscore."""
    assert token("RobotStart1") == "RobotStart1"
    assert token(" Robot Start\t1 ") == "Robot_Start_1"
    assert token("") == "_"
