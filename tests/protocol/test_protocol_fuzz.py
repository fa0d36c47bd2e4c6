"""Invariants of the protocol core under arbitrary input.

1. Any bytes, in any chunking, give the same lines, hence the same commands and requests, as the
   same bytes in one piece; nothing raises; never more than one line is held.
2. Any values whatsoever give lines that a client can cut: one CR LF at the end, no other control
   character, no doubled blank, one blank between segments, balanced braces, no exponent, no nan,
   no inf, no decimal comma.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.protocol import messages as m
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.dialects import DialectMode, DialectSelector
from usarsim_server.protocol.grammar import KNOWN_WORDS, Command, LineFramer, parse_line
from usarsim_server.protocol.numbers import fixed, vector
from usarsim_server.protocol.requests import Drive, GetConf, Init, MultiDrive, Request
from usarsim_server.protocol.values import Dialect, Item

# Bytes that look like the protocol, so that the fuzzer reaches behind the framer.
FRAGMENTS = st.one_of(
    st.sampled_from([b"\r", b"\n", b"\r\n", b"{", b"}", b" ", b"\t", b",", b"\xff", b"\x00"]),
    st.sampled_from(sorted(word.encode() for word in KNOWN_WORDS)),
    st.sampled_from(
        b"Left Right Normalized Name Type Opcode Params Location Rotation Link Value Order "
        b"WheelNumber WheelSpeed ClassName Classname Dialect udk ut2004 USARBot.P2AT".split()
    ),
    st.sampled_from([b"1.5", b"-0,5", b"1e999", b"nan", b"1,2,3", b"0,0000, 0,0000, 0,0000"]),
    st.binary(max_size=6),
)
STREAMS = st.lists(FRAGMENTS, max_size=60).map(b"".join) | st.binary(max_size=300)
CUTS = st.lists(st.integers(min_value=0, max_value=600), max_size=30)


def requests_of(lines: list[bytes]) -> list[tuple[Command, Request]]:
    return [(command, interpret(command)) for line in lines for command in parse_line(line)]


def in_chunks(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    return [data[start:end] for start, end in pairwise(edges)]


@given(STREAMS, CUTS, st.sampled_from([1, 5, 40, 65536]))
def test_chunking_changes_nothing(data: bytes, cuts: list[int], max_line: int) -> None:
    """Protocol 25, 26: the same bytes in other pieces give the same commands and discard the same
    lines."""
    whole, cut = LineFramer(max_line), LineFramer(max_line)
    expected = whole.feed(data)
    lines: list[bytes] = []
    for chunk in in_chunks(data, cuts):
        lines += cut.feed(chunk)
        assert cut.pending <= max_line
    assert lines == expected
    assert (cut.discarded, cut.pending) == (whole.discarded, whole.pending)
    assert requests_of(lines) == requests_of(expected)


@given(STREAMS)
def test_lines_hold_no_line_ends(data: bytes) -> None:
    """Lines are exactly the non-empty pieces between terminators, the unfinished rest excluded."""
    *complete, _rest = re.split(rb"[\r\n]", data)
    assert LineFramer().feed(data) == [line for line in complete if line]


@given(STREAMS)
def test_nothing_raises_and_everything_is_finite(data: bytes) -> None:
    """Protocol 19, 45: any bytes give requests whose numbers are finite."""
    for command, request in requests_of(LineFramer().feed(data + b"\n")):
        assert re.fullmatch("[A-Z0-9_]*", command.word)
        assert all(name and not re.search(r"[{} \t]", name) for name, _ in command.segments)
        assert all(not re.search(r"[{}]|^[ \t]|[ \t]$", value) for _, value in command.segments)
        if isinstance(request, Drive):
            numbers = (request.left, request.right, request.speed, request.value)
            assert all(math.isfinite(number) for number in numbers if number is not None)
        if isinstance(request, MultiDrive):
            assert all(map(math.isfinite, request.joints.values()))
        if isinstance(request, Init) and request.location:
            assert all(map(math.isfinite, request.location))


@given(STREAMS)
def test_garbage_does_not_harm_the_next_line(data: bytes) -> None:
    """Protocol 19: after any bytes and a line end, a valid command works."""
    framer = LineFramer()
    framer.feed(data)
    framer.feed(b"\r\n")
    assert requests_of(framer.feed(b"DRIVE {Left 1} {Right 2}\r\n"))[0][1] == Drive(left=1, right=2)


@given(st.lists(STREAMS, max_size=6), st.sampled_from(list(DialectMode)))
def test_selectors_survive_anything(streams: list[bytes], mode: DialectMode) -> None:
    """Protocol 177: any requests leave a selector in one of the two dialects, a fixed one in its
    own."""
    selector = DialectSelector(mode)
    for data in streams:
        for _, request in requests_of(LineFramer().feed(data + b"\n")):
            selector.observe(request)
            if isinstance(request, Init):
                selector.initialised(Dialect.UT2004, request)
    assert selector.current in Dialect
    if mode is not DialectMode.AUTO:
        assert selector.current.value == mode.value


SEGMENTS = st.lists(
    st.tuples(
        st.from_regex(r"[^{} \t\r\n]{1,8}", fullmatch=True).filter(lambda text: text.isascii()),
        st.from_regex(r"([^{} \t\r\n]+( [^{} \t\r\n]+)*)?", fullmatch=True).filter(str.isascii),
    ),
    max_size=8,
).map(tuple)


@given(st.sampled_from(sorted(KNOWN_WORDS)), SEGMENTS, st.sampled_from(["", " ", "  \t", " x "]))
def test_written_commands_read_back(
    word: str, segments: tuple[tuple[str, str], ...], gap: str
) -> None:
    """Protocol 33 to 35: a command written in any spacing, junk included, reads back as it was
    meant."""
    written = [f"{{{name} {value}}}" for name, value in segments]
    line = (word.lower() + " " + gap.join(written)).encode("latin-1")
    (command,) = parse_line(line)
    assert (command.word, command.segments) == (word, segments)


# Lines to clients

ANY = st.floats()
TEXT = st.text(max_size=12)
TRIPLE = st.tuples(ANY, ANY, ANY)
DIALECT = st.sampled_from(list(Dialect))
VEHICLE = st.builds(
    m.VehicleStatus,
    time=ANY,
    light=st.booleans(),
    light_intensity=st.integers(),
    battery=st.integers(),
    view=st.integers(),
)
NUMBER = st.builds(fixed, ANY, st.integers(min_value=0, max_value=4))
ITEM = st.builds(
    Item,
    TEXT,
    st.lists(
        st.tuples(
            st.sampled_from(["Range", "Pose", "Mem"]),
            NUMBER | TEXT | st.builds(vector, TRIPLE, st.just(2)),
        ),
        max_size=4,
    ).map(tuple),
)
LINK = st.builds(
    m.ActuatorLink,
    joint_type=TEXT,
    max_speed=ANY,
    max_torque=ANY,
    limits=st.none() | st.tuples(ANY, ANY),
    parent=st.none() | st.integers(min_value=1, max_value=9),
    location=TRIPLE,
    rotation=TRIPLE,
)
ACTUATORS = st.lists(
    st.builds(
        m.ActuatorItem,
        name=TEXT,
        location=TRIPLE,
        rotation=TRIPLE,
        mount=TEXT,
        mount_link=st.none() | st.integers(min_value=1, max_value=9),
        links=st.lists(LINK, max_size=2).map(tuple),
        tip=TRIPLE,
    ),
    max_size=2,
)
LINES: dict[str, st.SearchStrategy[str]] = {
    "greeting": st.builds(m.greeting, TEXT, TEXT, st.integers()),
    "start poses": st.builds(m.start_poses, st.lists(st.tuples(TEXT, TRIPLE, TRIPLE), max_size=3)),
    "path nodes": st.builds(m.path_nodes, st.lists(st.tuples(TEXT, TRIPLE, TRIPLE), max_size=3)),
    "closest node": st.builds(m.closest_path_node, TEXT, TRIPLE),
    "status change": st.builds(m.status_change, ANY, TEXT, TEXT, TEXT),
    "tick": st.builds(m.tick, ANY),
    "die": st.builds(m.die, TEXT, TEXT),
    "ground status": st.builds(
        m.ground_status,
        st.builds(
            m.GroundStatus,
            time=ANY,
            front_steer=ANY,
            rear_steer=ANY,
            joints=st.lists(st.tuples(TEXT, ANY), max_size=3).map(tuple),
            light=st.booleans(),
            light_intensity=st.integers(),
            battery=st.integers(),
            view=st.integers(),
            steered=st.booleans(),
        ),
        DIALECT,
        st.booleans(),
    ),
    "aerial status": st.builds(m.aerial_status, VEHICLE, DIALECT, st.booleans()),
    "avatar": st.builds(
        m.avatar_status,
        st.builds(
            m.AvatarStatus,
            time=ANY,
            class_name=TEXT,
            name=TEXT,
            location=TRIPLE,
            orientation=TRIPLE,
            walking=st.booleans(),
        ),
    ),
    "refused": st.builds(m.refused, TEXT),
    "exact names": st.builds(m.exact_names),
    "avatar bones": st.builds(
        m.avatar_bones, ANY, TEXT, st.lists(st.tuples(TEXT, TRIPLE), max_size=4)
    ),
    "objects": st.builds(
        m.object_status,
        st.lists(
            st.builds(
                m.ObjectStatus,
                name=TEXT,
                size=TRIPLE,
                location=TRIPLE,
                rotation=TRIPLE,
                memory=TEXT,
            ),
            max_size=3,
        ),
    ),
    "static status": st.builds(m.static_status, DIALECT, ANY, st.integers()),
    "static geometry": st.builds(m.static_geometry, DIALECT, TEXT, TRIPLE),
    "machine geometry": st.builds(m.machine_geometry, DIALECT, TEXT, TEXT, TRIPLE, TRIPLE),
    "machine configuration": st.builds(
        m.machine_configuration,
        DIALECT,
        TEXT,
        TEXT,
        TEXT,
        ANY,
        st.lists(st.tuples(TEXT, ANY), max_size=3),
    ),
    "legged status": st.builds(
        m.legged_status, VEHICLE, st.lists(st.tuples(TEXT, ANY), max_size=3), DIALECT
    ),
    "nautic status": st.builds(m.nautic_status, VEHICLE, ANY, ANY, DIALECT),
    "static configuration": st.builds(m.static_configuration, DIALECT, TEXT),
    "sensor": st.builds(
        m.sensor_line,
        DIALECT,
        TEXT,
        st.lists(ITEM, max_size=3),
        st.none() | ANY,
        st.sampled_from([2, 4]),
        st.booleans(),
    ),
    "reading": st.builds(m.reading_line, TEXT, ITEM, st.none() | ANY, st.sampled_from([2, 4])),
    "sensor geometry": st.builds(
        m.sensor_geometry,
        DIALECT,
        TEXT,
        st.lists(st.builds(m.SensorMount, TEXT, TRIPLE, TRIPLE, TEXT), max_size=3),
    ),
    "configuration": st.builds(m.configuration, TEXT, st.lists(ITEM, max_size=3)),
    "ground geometry": st.builds(m.ground_geometry, TEXT, TRIPLE, TRIPLE, ANY, ANY, ANY),
    "ground configuration": st.builds(
        m.ground_configuration, DIALECT, TEXT, TEXT, ANY, ANY, ANY, ANY, ANY
    ),
    "actuator status": st.builds(
        m.actuator_status, DIALECT, ANY, TEXT, st.lists(st.tuples(ANY, ANY), max_size=3)
    ),
    "effector status": st.builds(
        m.effector_status, ANY, TEXT, TEXT, st.booleans(), st.none() | st.tuples(TEXT, TEXT)
    ),
    "mission package geometry": st.builds(m.mission_package_geometry, ACTUATORS),
    "mission package configuration": st.builds(m.mission_package_configuration, DIALECT, ACTUATORS),
    "actuator geometry": st.builds(m.actuator_geometry, ACTUATORS),
    "actuator configuration": st.builds(m.actuator_configuration, ACTUATORS),
    "effector geometry": st.builds(
        m.effector_geometry,
        TEXT,
        st.lists(
            st.builds(m.EffectorMount, name=TEXT, location=TRIPLE, mount=TEXT, tip=TRIPLE),
            max_size=2,
        ),
    ),
    "camera configuration": st.builds(
        m.camera_configuration,
        DIALECT,
        TEXT,
        st.lists(
            st.builds(m.CameraItem, name=TEXT, default_fov=ANY, min_fov=ANY, max_fov=ANY, fov=ANY),
            max_size=3,
        ),
    ),
    "result": st.builds(
        m.result,
        ANY,
        st.sampled_from(["RFID", "Camera"]) | TEXT,
        st.none() | TEXT,
        st.booleans(),
        st.lists(st.tuples(st.sampled_from(["ID", "Mem"]), TEXT), max_size=2),
    ),
    "viewports": st.builds(
        m.viewports_result,
        ANY,
        st.lists(st.tuples(TEXT, st.booleans()), max_size=4),
        st.none() | st.tuples(TEXT, st.booleans()),
    ),
}

WELL_FORMED = re.compile(rb"[A-Z]+( \{[^{}]*\})*\r\n")
GLUED = re.compile(rb"[A-Z]+( (\{[^{}]*\})+)*\r\n")
"""Where segments stand without blanks between them: side channels reference 2.10."""
UNTIDY = re.compile(rb"[\x00-\x1f]|  ")
NOT_A_NUMBER = re.compile(rb"\b(nan|inf)\b|\d[eE][+-]?\d")


def check_line(data: bytes, form: re.Pattern[bytes] = WELL_FORMED) -> None:
    """Assert protocol 6 to 9 of one line as it goes to the socket."""
    assert form.fullmatch(data)
    assert not UNTIDY.search(data[:-2])


def test_every_kind_of_line_is_fuzzed() -> None:
    """A new function of `messages` that returns a line cannot be forgotten here."""
    helpers = {"encode", "encode_all", "gripper_item", "tool_changer_item"}
    functions = {name for name in m.__all__ if name.islower()} - helpers
    assert len(LINES) == len(functions)


@pytest.mark.parametrize("kind", LINES)
def test_every_line_is_well_formed(kind: str) -> None:
    """Protocol 6 to 9: whatever numbers, names and texts go in, what comes out can be cut by any
    client."""

    @settings(max_examples=25)
    @given(LINES[kind])
    def check(line: str) -> None:
        if line:
            check_line(m.encode(line), GLUED if kind == "camera configuration" else WELL_FORMED)

    check()


def numbers_only(function: Callable[..., str], *arguments: st.SearchStrategy[object]) -> None:
    @settings(max_examples=40)
    @given(st.tuples(*arguments))
    def check(values: tuple[object, ...]) -> None:
        data = m.encode(function(*values))
        assert not NOT_A_NUMBER.search(data)
        for text in re.findall(rb"\{\w+ ([-\d.,]+)\}", data):
            assert re.fullmatch(rb"-?\d+(\.\d+)?(,-?\d+(\.\d+)?){0,2}", text)

    check()


def test_no_number_breaks_a_line() -> None:
    """Protocol 53, 54: any floats, nan and infinities included, print as plain decimals."""
    name = st.just("X")
    numbers_only(m.ground_geometry, name, TRIPLE, TRIPLE, ANY, ANY, ANY)
    numbers_only(m.ground_configuration, DIALECT, name, name, ANY, ANY, ANY, ANY, ANY)
    numbers_only(m.actuator_status, DIALECT, ANY, name, st.lists(st.tuples(ANY, ANY)))
    numbers_only(m.closest_path_node, name, TRIPLE)


def test_the_fuzzer_reaches_commands() -> None:
    """The invariants above are not vacuous: the fragments do form meaningful requests."""
    line = b"".join([b"GETCONF", b"{", b"Type", b" ", b"1.5", b"}", b"\r"])
    assert requests_of(LineFramer().feed(line))[0][1] == GetConf("1.5")
