"""Reading world folders: what is read, and how every mistake is named."""

from __future__ import annotations

import math
import re
import tempfile
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from world_files import HEAD, START, VICTIM, nameless, write_world

from usarsim_server.base.errors import WorldError
from usarsim_server.simulation.frames import rpy_from_quaternion, wire_from_pose
from usarsim_server.worlds.description import GeographicOrigin, WorldDescription
from usarsim_server.worlds.loader import load_world

FULL = """
title = "Back yard"
description = "Two lines\\nof text."
level = "DM-Yard_250"
time_limit = 0
north_degrees = 90

[bounds]
lower = [-10, -11.5, -2]
upper = [10, 11.5, 20]

[origin]
latitude = 51.5
longitude = 0

[[start]]
tag = "RobotStart1"
position = [1, 2, 0.25]
yaw_degrees = 90

[[start]]
tag = "Tilted"
position = [3.0, -2.0, 1.0]
rotation_degrees = [10.0, -20.0, 30.0]

[[victim]]
name = "FemaleVictim_0"
position = [1.0, 2.0, 0.12]
yaw_degrees = 180
posture = "sitting"
status = "Injured"
properties = { figure = "female", co2 = 0.05, rfid = 7, mood = [1, 2] }

[[victim]]
name = "MaleVictim_1"
position = [0.0, 0.0, 0.93]
posture = "standing"

[[zone]]
name = "the yard"
kind = "yellow"
x = [-1, 1]
y = [-2.5, 2]

[[path_node]]
tag = "Gate"
position = [0.0, 1.0, 0.0]
neighbours = ["Corner"]

[[path_node]]
tag = "Corner"
position = [4, 1, 0]

[extra.radio]
loss = 3
"""


@pytest.fixture(scope="module")
def yard(tmp_path_factory: pytest.TempPathFactory) -> WorldDescription:
    """The full example, loaded."""
    return load_world(write_world(tmp_path_factory.mktemp("worlds"), FULL))


def test_texts_and_limits_are_read(yard: WorldDescription) -> None:
    """Names, texts, limits and origin arrive as written."""
    assert (yard.name, yard.level, yard.title) == ("yard", "DM-Yard_250", "Back yard")
    assert yard.description == "Two lines\nof text."
    assert yard.time_limit == 0
    assert (yard.lower, yard.upper) == ((-10.0, -11.5, -2.0), (10.0, 11.5, 20.0))
    assert yard.origin == GeographicOrigin(51.5, 0.0)
    assert yard.scene == yard.folder / "scene.xml"
    assert yard.extra == {"radio": {"loss": 3}}


def test_starts_are_read_in_file_order(yard: WorldDescription) -> None:
    """Order and spelling of tags follow the file (worlds reference 13, item 25)."""
    assert [start.tag for start in yard.starts] == ["RobotStart1", "Tilted"]
    assert yard.start(" robotSTART1 ") is yard.starts[0]


def test_yaw_is_anticlockwise_in_the_file_and_clockwise_on_the_wire(
    yard: WorldDescription,
) -> None:
    """A start at yaw 90 looks along +y (left); the wire calls that -90 degrees at y = -2."""
    start = yard.starts[0]
    assert start.pose.rotate((1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    location, rotation = wire_from_pose(start.pose)
    assert location == (1.0, -2.0, -0.25)
    assert rotation == pytest.approx((0.0, 0.0, -math.pi / 2))


def test_rotation_is_roll_pitch_yaw_in_degrees(yard: WorldDescription) -> None:
    """`rotation_degrees` gives the angles of Rz(yaw) Ry(pitch) Rx(roll)."""
    angles = [math.degrees(a) for a in rpy_from_quaternion(yard.starts[1].pose.quaternion)]
    assert angles == pytest.approx([10.0, -20.0, 30.0])


def test_victims_keep_their_free_properties(yard: WorldDescription) -> None:
    """Properties are handed on untouched; a status not given is Alive."""
    injured, alive = yard.victims
    assert (injured.posture, injured.status) == ("sitting", "Injured")
    assert injured.properties == {"figure": "female", "co2": 0.05, "rfid": 7, "mood": [1, 2]}
    assert injured.pose.rotate((1.0, 0.0, 0.0)) == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)
    assert (alive.status, dict(alive.properties)) == ("Alive", {})


def test_zones_and_path_nodes_are_read(yard: WorldDescription) -> None:
    """Rectangles and the walking graph arrive as written."""
    zone = yard.zones[0]
    assert (zone.name, zone.kind, zone.x, zone.y) == ("the yard", "yellow", (-1, 1), (-2.5, 2))
    gate, corner = yard.path_nodes
    assert (gate.tag, gate.position, gate.neighbours) == ("Gate", (0.0, 1.0, 0.0), ("Corner",))
    assert corner.neighbours == ()


@pytest.mark.parametrize(
    ("degrees", "wire"), [(0, 0.0), (90, -math.pi / 2), (-30, math.pi / 6), (180, math.pi)]
)
def test_north_is_turned_into_the_wire_frame(tmp_path: Path, degrees: int, wire: float) -> None:
    """North to the left of +x has a negative wire yaw."""
    world = load_world(write_world(tmp_path, f"{HEAD}north_degrees = {degrees}\n{START}"))
    assert math.cos(world.north) == pytest.approx(math.cos(wire))
    assert math.sin(world.north) == pytest.approx(math.sin(wire), abs=1e-12)


def test_what_is_not_written_has_the_documented_default(tmp_path: Path) -> None:
    """Every default equals that of `WorldDescription`; the level is the folder's name."""
    world = load_world(write_world(tmp_path, name="my yard"))
    given_keys = {"name", "level", "title", "description", "folder", "scene", "starts"}
    for field in fields(WorldDescription):
        if field.name not in given_keys | {"extra"}:
            assert getattr(world, field.name) == field.default, field.name
    assert (world.name, world.level, world.description) == ("my yard", "my_yard", "")
    assert world.extra == {}


MISTAKES = {
    # what stands before it: sheet, where, problem, cure
    "": [
        (START, "title", "is missing", "add title"),
        ('title = " "\n' + START, "title", "is empty", "text"),
        ("title = 5\n" + START, "title", "5 is not text", "text in quotes"),
        (HEAD, "start", "no start pose", "[[start]]"),
        ("title = \n", "line 1, column 9", "Invalid value", "mend the line"),
    ],
    HEAD: [
        ("[start]\ntag = 'A'\n", "start", "is not a list of tables", "[[start]]"),
        ("start = [1]\n", "start", "is not a list of tables", "[[start]]"),
        ("colour = 1\n" + START, "colour", "unknown key", "known keys: belt, bounds"),
        ("levle = 'x'\n" + START, "levle", "unknown key", "did you mean level?"),
        ("[[start]]\nposition=[0,0,0]", "[[start]] 1: tag", "is missing", "add tag"),
        ("[[start]]\ntag='A'", "[[start]] 1: position", "is missing", "add position"),
        ("[[start]]\ntag='A B'", "[[start]] 1: tag", "'A B' cannot travel", "no blanks"),
        ("[[start]]\ntag='A{'", "[[start]] 1: tag", "'A{' cannot travel", "braces"),
        ("[[start]]\ntag='A,B'", "[[start]] 1: tag", "'A,B' cannot travel", "commas"),
        ("[[start]]\ntag='\u00e9'", "[[start]] 1: tag", "cannot travel", "letters"),
        ("[[start]]\ntag=''", "[[start]] 1: tag", "is empty", "text"),
        (
            "[[start]]\ntag='A'\nposition=[1,2]",
            "[[start]] 1: position",
            "[1, 2] is not 3 numbers",
            "[1.0, 2.0, 3.0]",
        ),
        (
            "[[start]]\ntag='A'\nposition='123'",
            "[[start]] 1: position",
            "'123' is not 3 numbers",
            "3 numbers",
        ),
        (
            "[[start]]\ntag='A'\nposition=[1,true,3]",
            "[[start]] 1: position",
            "True is not a number",
            "a number",
        ),
        (
            "[[start]]\ntag='A'\nposition=[1,nan,3]",
            "[[start]] 1: position",
            "nan is not a finite number",
            "write a number",
        ),
        (
            "[bounds]\nlower=[-1,-1,1]\nupper=[1,1,5]\n" + START,
            "[[start]] 1",
            "outside the bounds",
            "widen [bounds]",
        ),
        (
            "[bounds]\nlower=[-1,1,0]\nupper=[1,1,5]\n" + START,
            "[bounds]: upper",
            "is not above lower",
            "swap",
        ),
        ("[bounds]\nleft=1\n" + START, "[bounds]: left", "unknown key", "lower, upper"),
        ("bounds=3\n" + START, "bounds", "3 is not a table", "[bounds]"),
        ("[origin]\nlatitude=91\n" + START, "[origin]: latitude", "out of range", "90"),
        ("[origin]\nlongitude='E'\n" + START, "[origin]: longitude", "not a number", "number"),
        ("time_limit=1.5\n" + START, "time_limit", "1.5 is not a whole number", "whole"),
        ("time_limit=true\n" + START, "time_limit", "True is not a whole number", "whole"),
        ("time_limit=-1\n" + START, "time_limit", "-1 is out of range", "from 0"),
        ("extra=1\n" + START, "extra", "1 is not a table", "a table"),
        (HEAD, "line 2", "Cannot overwrite a value", "mend the line"),
    ],
    HEAD + START: [
        ("yaw = 3\n", "[[start]] 1: yaw", "unknown key", "did you mean yaw_degrees?"),
        (
            "yaw_degrees=1\nrotation_degrees=[0,0,0]",
            "[[start]] 1: rotation_degrees",
            "beside yaw_degrees",
            "one of the two",
        ),
        ("yaw_degrees=inf", "[[start]] 1: yaw_degrees", "inf is not a finite", "number"),
        (
            "[[start]]\ntag='a'\nposition=[0,0,0]",
            "[[start]] 2: tag",
            "'a' is already the tag of number 1",
            "its own tag",
        ),
        (
            VICTIM.replace("lying", "swimming"),
            "[[victim]] 1: posture",
            "'swimming' is not known",
            "standing, sitting, lying",
        ),
        (
            VICTIM + VICTIM,
            "[[victim]] 2: name",
            "'V' is already the name of number 1",
            "its own name",
        ),
        (VICTIM.replace('"V"', '"V:1"'), "[[victim]] 1: name", "'V:1' cannot travel", "colons"),
        (VICTIM + "status = 'half dead'", "[[victim]] 1: status", "cannot travel", "no blanks"),
        (VICTIM + "properties = 1", "[[victim]] 1: properties", "1 is not a table", "a table"),
        (VICTIM + "sound = true", "[[victim]] 1: sound", "unknown key", "properties"),
        (
            "[[zone]]\nname='z'\nkind='k'\nx=[1,1]\ny=[0,1]",
            "[[zone]] 1: x",
            "[1.0, 1.0] is empty",
            "smaller number first",
        ),
        (
            "[[path_node]]\ntag='P'\nposition=[0,0,0]\nneighbours=['Q']",
            "[[path_node]] 1: neighbours",
            "'Q' is no path node",
            "another [[path_node]]",
        ),
        (
            "[[path_node]]\ntag='P'\nposition=[0,0,0]\nneighbours='P'",
            "[[path_node]] 1: neighbours",
            "'P' is not a list",
            '["A", "B"]',
        ),
        (
            "[[path_node]]\ntag='P'\nposition=[0,0,0]\nneighbours=[1]",
            "[[path_node]] 1: neighbours",
            "1 is not text",
            "text in quotes",
        ),
    ],
}


@pytest.mark.parametrize(
    ("sheet", "where", "problem", "cure"),
    [(begin + row[0], *row[1:]) for begin, rows in MISTAKES.items() for row in rows],
)
def test_every_mistake_is_named(
    tmp_path: Path, sheet: str, where: str, problem: str, cure: str
) -> None:
    """An error names the file, the key, the problem and the cure in one line."""
    folder = write_world(tmp_path, sheet)
    with pytest.raises(WorldError) as caught:
        load_world(folder)
    text = nameless(caught.value)
    assert text.startswith(f"{folder.resolve() / 'world.toml'}: {where}"), text
    assert text.endswith(")")
    assert cure in text[text.index(problem) + len(problem) :]
    assert "\n" not in text


@pytest.mark.parametrize("missing", ["world.toml", "scene.xml"])
def test_a_missing_file_is_named(tmp_path: Path, missing: str) -> None:
    """A folder without one of the two files is refused with that file's path."""
    folder = write_world(tmp_path)
    (folder / missing).unlink()
    with pytest.raises(WorldError, match=rf"{re.escape(missing)}: file is missing"):
        load_world(folder)


def test_a_file_that_is_no_utf8_is_refused(tmp_path: Path) -> None:
    """A Latin-1 file is refused with the line of the first bad byte."""
    folder = write_world(tmp_path)
    (folder / "world.toml").write_bytes(HEAD.encode() + b'description = "\xe9"\n')
    with pytest.raises(
        WorldError, match=rf"line {HEAD.count(chr(10)) + 1}: byte 0xE9 is not UTF-8 \(save"
    ):
        load_world(folder)


@pytest.mark.parametrize("text", ["a = " + "[" * 100_000, "a = " + "1" * 10_000])
def test_what_chokes_the_parser_is_refused(tmp_path: Path, text: str) -> None:
    """Too deep nests and too long numbers are one error like any other slip."""
    with pytest.raises(WorldError, match="is not valid TOML"):
        load_world(write_world(tmp_path, HEAD + text + "\n" + START))


_values = st.recursive(
    st.sampled_from(
        ["1", "-3.5", "nan", "true", '"text"', '"A"', "1979-05-27", "[]", "{}", "[0.0, 0.0, 0.0]"]
    ),
    lambda inner: st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]"),
    max_leaves=4,
)
_keys = st.sampled_from(
    ("title", "level", "tag", "name", "position", "yaw_degrees", "posture", "status", "x", "y")
)
_more_keys = st.sampled_from(
    ("rotation_degrees", "properties", "kind", "neighbours", "lower", "upper", "latitude", "odd")
)
_headers = st.sampled_from(
    ("[[start]]", "[[victim]]", "[[zone]]", "[[path_node]]", "[bounds]", "[origin]", "[extra]")
)


@settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(
    parts=st.lists(
        st.tuples(_headers, st.dictionaries(_keys | _more_keys, _values, max_size=5)),
        min_size=1,
        max_size=4,
    )
)
def test_any_tables_give_a_world_or_a_world_error(
    parts: list[tuple[str, dict[str, str]]],
) -> None:
    """Whatever well-formed keys stand where they do not belong, no other error escapes."""
    sheet = HEAD + START
    for header, pairs in parts:
        sheet += f"{header}\n" + "".join(f"{key} = {value}\n" for key, value in pairs.items())
    _load_or_refuse(sheet.encode())


@settings(max_examples=150, deadline=None)
@given(
    place=st.integers(0, len(FULL) - 1),
    length=st.integers(0, 12),
    noise=st.binary(max_size=6),
)
def test_any_damage_gives_a_world_or_a_world_error(place: int, length: int, noise: bytes) -> None:
    """A good file with a piece cut out and noise put in never ends in another error."""
    text = FULL.encode()
    _load_or_refuse(text[:place] + noise + text[place + length :])


def _load_or_refuse(sheet: bytes) -> None:
    with tempfile.TemporaryDirectory() as directory:
        folder = write_world(Path(directory))
        (folder / "world.toml").write_bytes(sheet)
        try:
            world = load_world(folder)
        except WorldError as error:
            said = str(error)
        else:
            said = "world.toml"
            assert world.starts
            assert all(math.isfinite(v) for start in world.starts for v in start.pose.position)
    assert "world.toml" in said
    assert "\n" not in said


def test_objects_keep_the_names_of_their_map(tmp_path: Path) -> None:
    """A look-up by the name or tag of the map finds all things (worlds reference 13, 69)."""
    things = (
        '[[object]]\nname = "desk"\n'
        '[[object]]\nname = "desk-2"\noriginal = "desk"\ntag = "Loose"\nmovable = true\n'
    )
    world = load_world(write_world(tmp_path, HEAD + START + things))
    assert [thing.name for thing in world.objects_called("Desk")] == ["desk", "desk-2"]
    assert [thing.movable for thing in world.objects_called("loose")] == [True]
    assert world.objects_called("chair") == ()
