"""Commands explained: what the readers say of what they read."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.explanation import MOST_FAULTS, faults, heard, reading
from usarsim_server.protocol.grammar import KNOWN_WORDS, parse_line
from usarsim_server.protocol.numbers import is_number, read_number
from usarsim_server.protocol.requests import Control, Drive, Set
from usarsim_server.protocol.values import near

KEYS = ["Left", "Right", "Name", "Value", "Location", "Light", "Link", "Type", "Opcode", "Nonsense"]
TEXTS = st.one_of(
    st.text(max_size=12), st.sampled_from(["1", "abc", "1,2,3", "1e99", "", "true", "1.5", "nan"])
)
LINES = st.one_of(
    st.text(max_size=200),
    st.builds(
        lambda word, segments: word + "".join(f" {{{key} {text}}}" for key, text in segments),
        st.sampled_from(sorted(KNOWN_WORDS)),
        st.lists(st.tuples(st.sampled_from(KEYS), TEXTS), max_size=12),
    ),
)


def explained(line: str) -> tuple[str, list[str]]:
    """Reading and faults of a line of one command."""
    (command,) = parse_line(line.encode("latin-1"))
    listening, request = heard(command)
    return reading(request), faults(listening, request)


@given(LINES)
def test_explaining_changes_nothing_and_never_fails(line: str) -> None:
    """Any line: the request is the one that `interpret` makes; readings and faults are short,
    printable, few, and fit into JSON."""
    for command in parse_line(line.encode("latin-1", "replace")):
        listening, request = heard(command)
        plain = interpret(command)
        if isinstance(request, Set | Control):
            assert isinstance(plain, Set | Control)
            assert request.segments == plain.segments
            assert request.type == plain.type
        else:
            assert request == plain
        told = [reading(request), *faults(listening, request)]
        json.dumps(told, allow_nan=False)
        assert len(told) <= MOST_FAULTS + 2
        assert all(len(one) <= 500 and one.isprintable() for one in told)


@given(st.text(max_size=30))
def test_a_number_is_told_as_unread_exactly_if_it_was_made_up(text: str) -> None:
    """A fault says so, or the value is the one of the text."""
    command = parse_line(b"DRIVE {Left 1}")[0]
    line = "DRIVE {Left " + text.replace("{", "").replace("}", "") + "}"
    for command in parse_line(line.encode("latin-1", "replace"))[:1]:
        value = command.get("Left")
        if value is None:
            continue
        listening, request = heard(command)
        assert isinstance(request, Drive)
        assert request.left == read_number(value)
        unread = any("number" in fault for fault in faults(listening, request))
        assert unread == (not is_number(value))


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("DRIVE {Left abc}", "Left: `abc` is not a number, read as 0"),
        ("DRIVE {Left}", "Left: it has no number, read as 0"),
        ("DRIVE {Left 1} {Left 2}", "Left: sent twice, the first one counts"),
        ("DRIVE {Left 1e30}", "Left: `1e30` is out of range, read as 1e+15"),
        ("DRIVE {Left=0.5}", "`Left=0.5`: write a blank between `Left` and its value"),
        ("DRIVE {Rihgt 1}", "DRIVE has no segment `Rihgt`; did you mean `right`?"),
        ("DRIVE {Light maybe}", "Light: `maybe` is neither true nor false, read as false"),
        ("DRVIE {Left 1}", "there is no command `DRVIE`; did you mean `DRIVE`?"),
        ("{Left 1}", "there is no command word at the beginning of the line"),
        ("INIT {ClassName P3AT} {Location 1,x,2}", "Location: `x` is not a number, read as 0"),
        ("INIT {Location 1,2}", "Location: 2 of 3 numbers, the others are read as 0"),
        ("SYNC {Ticks 1.5}", "Ticks: `1.5` is not a whole number, read as 1"),
        ("MISPKG {Name A} {Link 1} {Value x}", "Value: `x` is not a number, read as 0"),
        ("MULTIDRIVE {Arm x}", "Arm: `x` is not a number, read as 0"),
        ("PAUSE", "PAUSE is accepted, and does nothing here"),
    ],
)
def test_faults(line: str, fault: str) -> None:
    """Each in one sentence, and no others."""
    assert explained(line)[1] == [fault]


@pytest.mark.parametrize(
    "line",
    [
        "DRIVE {Left 1} {Right -.5} {Normalized false} {Light True}",
        "DRIVE {WheelNumber 0} {WheelSpeed 1} {WheelNumber 1} {WheelSpeed 2}",
        "INIT {ClassName USARBot.P3AT} {Name R} {Location 1,2,3} {Rotation 0,0,1}",
        "MISPKG {Name Arm} {Link 1} {Value 1} {Link 2} {Value 2}",
        "SET {Type Camera} {Name Cam} {Opcode FOV} {Params 0.5}",
        "SET {Type RFID} {Name R} {Opcode Read} {Now}",
        "GETCONF {Type Robot}",
        "GETSTARTPOSES",
    ],
)
def test_what_is_right_has_no_faults(line: str) -> None:
    """Lines of real controllers."""
    assert explained(line)[1] == []


def test_readings_and_hints() -> None:
    """In plain words, with what was sent only; no hint where nothing is near."""
    assert explained("DRIVE {Left 1} {Right abc}")[0] == "Drive(left=1.0, right=0.0)"
    assert near("P3TA", ["P2AT", "P3AT", "Nao"]) == "; did you mean `P3AT`?"
    assert near("zzz", ["P3AT"]) == ""
