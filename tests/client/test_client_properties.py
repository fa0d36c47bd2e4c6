"""Hostile and random lines, commands that are read back, buffers that stay bounded."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_client import RobotState, decode, frames, readings
from usarsim_client.commands import say
from usarsim_client.decoder import _READERS
from usarsim_client.sensing import TYPES
from usarsim_client.streams import MOST_NAMES, Buffer
from usarsim_server.protocol import messages
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.numbers import ranges, vector
from usarsim_server.protocol.values import Dialect, Item

_WORDS = st.text(st.characters(codec="latin-1", exclude_characters="{}\r\n"), max_size=12)
_JUNK = st.one_of(
    _WORDS,
    st.sampled_from(
        ["1,2,3", "nan", "inf", "-1e400", "1_0", ",,,", "9" * 5000, "39,8.0,N", "a,b,c"]
    ),
    st.floats().map(str),
    st.lists(st.floats(width=32), max_size=5).map(lambda values: ",".join(map(str, values))),
)
_KEYS = st.sampled_from(
    [
        *("Name", "Type", "Time", "Range", "FOV", "Resolution", "Pose", "Location", "Orientation"),
        *("Tick", "Touch", "Link", "Value", "ID", "Mem", "PartName", "Direction", "Volume", "Size"),
        *("Latitude", "Longitude", "Fix", "Object", "HitLoc", "Points", "Frame", "Frames", "Vel"),
        *("StartPoses", "PathNodes", "Pathnode", "Status", "Battery", "Walking", "Bone", "Memory"),
        *("Rotation", "Mount", "MountLink", "Tip", "TextureOffsetX", "CameraFov", "Minutes"),
    ]
)
_SEGMENTS = st.lists(
    st.one_of(
        st.tuples(_KEYS, _JUNK).map(lambda pair: f"{{{pair[0]} {pair[1]}}}"),
        st.sampled_from(["{", "}", "{}", "{Name A Range 1 Range}", "{{Type", "} {", "junk"]),
    ),
    max_size=8,
)
_LINES = st.builds(
    lambda head, kind, segments: f"{head} {{Type {kind}}} {' '.join(segments)}".encode("latin-1"),
    st.sampled_from([*_READERS, "SEN", "sta", "", "MIS", "X" * 40]),
    st.sampled_from([*TYPES, "Camera", "GroundVehicle", "MisPkg", "Actuator", "none", ""]),
    _SEGMENTS,
)


@given(st.lists(st.one_of(_LINES, st.binary(max_size=80)), max_size=8))
def test_hostile_lines_raise_nothing(lines: list[bytes]) -> None:
    """Whatever comes is told, typed or unknown, and time never runs backwards."""
    state, before = RobotState(), -math.inf
    for line in lines:
        for value in state.feed(line):
            repr(value)
            for name in ("points", "rows", "bearings", "degrees"):
                getattr(value, name, None)
        assert not state.time < before
        before = max(before, state.time) if not math.isnan(state.time) else before
    assert state.lines == len(lines)


_NUMBER = st.floats(-1e4, 1e4).map(lambda value: round(value, 3))


@given(st.lists(_NUMBER, min_size=1, max_size=200), st.sampled_from(list(Dialect)))
def test_scans_come_back_as_they_were_written(values: list[float], dialect: Dialect) -> None:
    """What the server writes, the client reads, in both dialects."""
    segments = (("Resolution", "0.0174"), ("FOV", "3.1414"), ("Range", ranges(values, 4)))
    line = messages.sensor_line(dialect, "RangeScanner", [Item("L", segments)], 1.5, 4)
    (scan,) = decode(line.encode())
    assert isinstance(scan, readings.LaserScan)
    assert scan.ranges == pytest.approx(np.array(values), abs=2e-4)


@given(st.lists(_NUMBER, min_size=1, max_size=16), st.sampled_from(list(Dialect)))
def test_batches_come_back_as_they_were_written(values: list[float], dialect: Dialect) -> None:
    """A batch of `ut2004` is as many values as lines of their own."""
    items = [
        Item(f"F{place}", (("Range", vector([value], 4)),)) for place, value in enumerate(values)
    ]
    line = messages.sensor_line(dialect, "Sonar", items, 1.5, 4, multi_pair=True)
    found = decode(line.encode())
    assert [one.name for one in found if isinstance(one, readings.Sonar)] == [
        item.name for item in items
    ]
    assert [one.range for one in found if isinstance(one, readings.Sonar)] == pytest.approx(
        values, abs=2e-4
    )


@given(st.text(max_size=20), st.text(max_size=20))
def test_commands_are_read_back_or_refused(name: str, params: str) -> None:
    """No text becomes another segment or another command."""
    try:
        data = say("SET", Type="RFID", Name=name, Params=params)
    except ValueError:
        return
    (command,) = parse_line(data.removesuffix(b"\r\n"))
    assert [key for key, _ in command.segments] == ["Type", "Name", "Params"]
    assert data.count(b"\n") == data.count(b"\r") == 1


@dataclass(frozen=True)
class _Named:
    name: str
    number: int


@given(st.lists(st.one_of(st.none(), st.sampled_from("abc")), max_size=60))
def test_the_newest_of_each_item_waits(script: list[str | None]) -> None:
    """None takes a value, a letter puts one of that item; against a plain model."""
    buffer, model, dropped = Buffer[_Named](), OrderedDict[str, int](), 0
    for number, name in enumerate(script):
        if name is None:
            taken = buffer.take()
            expected = model.popitem(last=False) if model else None
            assert (taken and (taken.name, taken.number)) == expected
        else:
            dropped += name in model
            model[name] = number
            buffer.put(_Named(name, number))
        assert (len(buffer), buffer.dropped) == (len(model), dropped)


@given(st.integers(1, 8), st.integers(0, 40))
def test_a_queue_keeps_its_length(keep: int, count: int) -> None:
    """The oldest values are dropped, and counted."""
    buffer = Buffer[_Named](keep)
    for number in range(count):
        buffer.put(_Named("a", number))
    assert buffer.dropped == max(count - keep, 0)
    left = [value.number for value in iter(buffer.take, None)]
    assert left == list(range(max(count - keep, 0), count))


def test_invented_names_bloat_nobody() -> None:
    """A server that names a new sensor in every line fills no memory."""
    buffer = Buffer[_Named]()
    for number in range(3 * MOST_NAMES):
        buffer.put(_Named(str(number), number))
    assert len(buffer) == MOST_NAMES
    with pytest.raises(ValueError, match="-1"):
        Buffer[_Named](-1)


_ANGLES = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@given(_ANGLES, _ANGLES)
def test_frames(place: tuple[float, float, float], turn: tuple[float, float, float]) -> None:
    """Conversions undo themselves, and turning in one frame is turning in the other."""
    assert frames.flip(frames.flip(place)) == place
    point = np.array([place])
    here = frames.to_world(point, (1.0, 2.0, 3.0), turn)
    there = frames.to_world(frames.flip(point), frames.flip((1.0, 2.0, 3.0)), frames.flip(turn))
    assert frames.flip(here) == pytest.approx(there)
    w, x, y, z = frames.quaternion(turn)
    assert math.hypot(w, x, y, z) == pytest.approx(1.0)
    assert frames.rotation_matrix(turn)[0, 0] == pytest.approx(1 - 2 * (y * y + z * z))
    assert frames.quaternion(frames.flip(turn)) == pytest.approx((w, x, -y, -z))
