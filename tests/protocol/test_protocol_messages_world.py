"""What holds for every message (protocol reference 1.3, 6 to 9), and lines about the
world: NFO and DIE (protocol 1.2, 4.2, 4.12, 2 to 4, 80 to 84), STA and BSTA of avatars
(protocol 4.4, 4.13), GetSTA answers of world controllers (protocol 4.11, 53, 54, 168,
171).
"""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from usarsim_server.protocol.messages import (
    AvatarStatus,
    ObjectStatus,
    avatar_bones,
    avatar_status,
    closest_path_node,
    die,
    encode,
    encode_all,
    greeting,
    object_status,
    path_nodes,
    start_poses,
    status_change,
)
from usarsim_server.protocol.messages.text import line, segment, time_segment, token, triple


def test_a_line_ends_with_cr_lf() -> None:
    """Protocol 6: bytes 13 10 at the end and nowhere else."""
    assert encode("STA {Type X}") == b"STA {Type X}\r\n"


@pytest.mark.parametrize("text", ["", " ", "\r\n", "\t \n"])
def test_an_empty_line_is_never_sent(text: str) -> None:
    """Protocol 7: a text without content gives no bytes at all."""
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
    """Protocol 6, 8: line ends, tabs, control characters and doubled blanks shrink to one blank."""
    assert encode(text) == data


@given(st.text())
def test_any_text_encodes_to_at_most_one_tidy_line(text: str) -> None:
    """Protocol 6 to 8: whatever the text, its bytes are nothing or one well formed line."""
    data = encode(text)
    if data:
        body = data.removesuffix(b"\r\n")
        assert len(body) == len(data) - 2
        assert not re.search(rb"[\x00-\x1f]|  ", body)
        assert body == body.strip(b" ") != b""


def test_segments() -> None:
    """Protocol 4.5: key and value, or the key alone for an empty value."""
    assert segment("Name", "F1") == "{Name F1}"
    assert segment("None") == "{None}"
    assert segment("Name", "") == "{Name}"


def test_braces_inside_a_value_become_parentheses() -> None:
    """Protocol 9, 171: no content can open or close a segment."""
    assert segment("Mem", "a}{Status OK") == "{Mem a)(Status OK}"


def test_lines_join_with_single_blanks() -> None:
    """Protocol 9: exactly one blank between any two segments."""
    assert line("SEN", "{A 1}", "{B 2}") == "SEN {A 1} {B 2}"
    assert line("STA") == "STA"


def test_vectors_have_no_blanks() -> None:
    """Protocol 54: components are joined by commas only."""
    assert triple("Location", (1, -0.5, 0), 2) == "{Location 1.00,-0.50,0.00}"


def test_time_is_never_negative() -> None:
    """Protocol 85: Time matches digits, point, digits, also for a clock that starts below 0."""
    assert time_segment(-1e-9, 2) == "{Time 0.00}"
    assert time_segment(-5.0, 4) == "{Time 0.0000}"


@given(st.text())
def test_tokens_are_one_word(text: str) -> None:
    """Protocol 82: tags and joint names are single words, never empty, without braces."""
    word = token(text)
    assert word
    assert not re.search(r"[\x00-\x20{}]", word)


def test_tokens_keep_ordinary_names() -> None:
    """An ordinary tag passes unchanged, a blank becomes an underscore."""
    assert token("RobotStart1") == "RobotStart1"
    assert token(" Robot Start\t1 ") == "Robot_Start_1"
    assert token("") == "_"


YARD = [
    ("RobotStart1", (1.25, -0.5, -0.2), (0.0, 0.0, 1.57079)),
    ("RobotStart2", (4.0, 2.0, -0.2), (0.0, 0.0, 0.0)),
]


def test_greeting() -> None:
    """Protocol 2, 3: three segments in this order, TimeLimit an integer."""
    assert greeting("BotDeathMatch", "RescueHall", 20) == (
        "NFO {Gametype BotDeathMatch} {Level RescueHall} {TimeLimit 20}"
    )
    assert greeting("BotDeathMatch", "DM-Yard_250", 0) == (
        "NFO {Gametype BotDeathMatch} {Level DM-Yard_250} {TimeLimit 0}"
    )


@pytest.mark.parametrize(
    "level", ["Hall", "Hall.LevelInfo", "Hall.levelinfo", "Hall.LEVELINFO0", "Hall.LevelInfo_1.x"]
)
def test_level_has_no_level_info(level: str) -> None:
    """Protocol 4: the suffix and what follows it are cut off, in any case."""
    assert greeting("BotDeathMatch", level, 20).split(" {")[2] == "Level Hall}"


def test_a_point_alone_is_part_of_the_level() -> None:
    """Protocol 4: only LevelInfo is cut, not every extension."""
    assert "{Level Hall.v2}" in greeting("BotDeathMatch", "Hall.v2", 20)


def test_start_poses_are_flat() -> None:
    """Protocol 81, 82: the count, then one segment of tag, location, rotation, single blanks
    between."""
    assert start_poses(YARD) == (
        "NFO {StartPoses 2} {RobotStart1 1.2500,-0.5000,-0.2000 0.0000,0.0000,1.5707 "
        "RobotStart2 4.0000,2.0000,-0.2000 0.0000,0.0000,0.0000}"
    )


def test_start_poses_count_equals_the_groups() -> None:
    """Protocol 81: n is the number of groups of three words in the second segment."""
    for count in range(1, 5):
        text = start_poses([YARD[0]] * count)
        head, _, body = text.partition("} {")
        assert head == f"NFO {{StartPoses {count}"
        assert len(body.rstrip("}").split(" ")) == 3 * count


def test_no_start_poses() -> None:
    """Protocol 81: with n = 0 there is no second segment."""
    assert start_poses([]) == "NFO {StartPoses 0}"


def test_blanks_in_a_tag_do_not_shift_the_groups() -> None:
    """Protocol 82: a tag is one word, whatever the world file says."""
    body = start_poses([("Robot Start {1}", (0, 0, 0), (0, 0, 0))]).split("} {")[1]
    assert body == "Robot_Start_(1) 0.0000,0.0000,0.0000 0.0000,0.0000,0.0000}"


def test_path_nodes() -> None:
    """Protocol 84: path nodes have the form of start poses."""
    assert path_nodes([("PathNode_0", (3, 1, -0.4), (0, 0, 0))]) == (
        "NFO {PathNodes 1} {PathNode_0 3.0000,1.0000,-0.4000 0.0000,0.0000,0.0000}"
    )
    assert path_nodes([]) == "NFO {PathNodes 0}"


def test_closest_path_node() -> None:
    """Protocol 84: tag and location of the nearest node."""
    assert closest_path_node("PathNode_0", (3, 1, -0.4)) == (
        "NFO {Pathnode PathNode_0} {Location 3.0000,1.0000,-0.4000}"
    )


def test_die() -> None:
    """Protocol 4.12: killer and class of the damage."""
    assert die("None", "DmgType_Fell") == "DIE {Killer None} {DamageType DmgType_Fell}"


def test_a_status_change_is_one_line_of_known_form() -> None:
    """A change of configuration is told under a head that every client knows (protocol 6-9)."""
    assert status_change(12.5, "Battery Empty", "Battery", "b1") == (
        "NFO {Status Battery_Empty} {Time 12.5000} {Type Battery} {Name b1}"
    )


WORKER = AvatarStatus(
    time=12.3047,
    class_name="USARAvatarNewMale",
    name="Worker1",
    location=(2.0, 1.5, -0.98),
    orientation=(0.0, 0.0, 1.5708),
    walking=True,
)


def test_status() -> None:
    """The example of protocol 4.4."""
    assert avatar_status(WORKER) == (
        "STA {Time 12.3047} {Type USARAvatarNewMale} {Name Worker1} {Location 2.00,1.50,-0.98} "
        "{Orientation 0.00,0.00,1.57} {Walking True}"
    )


def test_standing() -> None:
    """Protocol 55: booleans are True and False."""
    assert avatar_status(replace(WORKER, walking=False)).endswith("{Walking False}")


def test_a_name_cannot_break_the_line() -> None:
    """Braces in a name do not open segments."""
    text = avatar_status(replace(WORKER, name="a} {Walking False"))
    assert re.fullmatch(r"STA( \{[^{}]*\}){6}", text)
    assert text.endswith("{Walking True}")


def test_bones() -> None:
    """Protocol 4.13: a pair of Bone and Rotation for each, in the order given."""
    bones = [("LeftArm", (0.0, 0.25, 0.0)), ("RightArm", (0.0, -0.251, 0.0))]
    assert avatar_bones(3.05, "Worker1", bones) == (
        "BSTA {Time 3.0500} {Name Worker1} {Bone LeftArm} {Rotation 0.00,0.25,0.00} "
        "{Bone RightArm} {Rotation 0.00,-0.25,0.00}"
    )


BOX = ObjectStatus(
    name="Box3",
    size=(0.3, 0.3, 0.3),
    location=(3.1, 0.2, -0.15),
    rotation=(0.0, 0.0, 0.7854),
    memory="red",
)
NUMBERS = st.floats(-1e4, 1e4)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)


def iridium(text: str) -> list[tuple[str, str]]:
    """Keys and values as a client reads them that splits at any brace (protocol 5.1.2)."""
    parts = [part for part in re.split(r"[{}]", text)[1:] if part.strip()]
    return [(key, value) for key, blank, value in (part.partition(" ") for part in parts) if blank]


def test_one_object() -> None:
    """The example of protocol 4.11 with a positive height."""
    assert object_status([BOX]) == (
        "STA {Name Box3} {Size 0.3000,0.3000,0.3000} {Location 3.1000,0.2000,-0.1500} "
        "{Memory red} {Rotation 0.0000,0.0000,0.7854}"
    )


def test_no_object() -> None:
    """Protocol 168: the bare head."""
    assert object_status([]) == "STA"


def test_several_objects_stand_in_one_line() -> None:
    """Protocol 4.11: one line for all, each from its Name to its Rotation."""
    other = ObjectStatus(name="B", size=(1, 1, 1), location=(0, 0, 0), rotation=(0, 0, 0))
    text = object_status([BOX, other])
    keys = re.findall(r"\{(\w+)", text)
    assert keys == ["Name", "Size", "Location", "Memory", "Rotation"] * 2
    assert text.startswith(object_status([BOX]))


def test_sizes_are_never_negative() -> None:
    """Protocol 4.11 REQ: what the original negated is positive."""
    upside_down = ObjectStatus(name="n", size=(1, 2, -3), location=(0, 0, 0), rotation=(0, 0, 0))
    assert "{Size 1.0000,2.0000,3.0000}" in object_status([upside_down])


def test_an_empty_memory_is_a_key_with_an_empty_value() -> None:
    """A client that splits key and value at the blank finds Memory in any case."""
    blank = ObjectStatus(name="n", size=(1, 1, 1), location=(0, 0, 0), rotation=(0, 0, 0))
    assert ("Memory", "") in iridium(object_status([blank]))
    assert b"{Memory }" in encode(object_status([blank]))


@given(st.text(max_size=20), st.text(max_size=20), VECTORS, VECTORS, VECTORS)
def test_braces_are_balanced_whatever_the_names(
    name: str, memory: str, size: tuple[float, ...], place: tuple[float, ...], turn: tuple[float]
) -> None:
    """Protocol 171: five segments, each opened and closed, none inside another; vectors without
    blanks."""
    status = ObjectStatus(
        name=name,
        memory=memory,
        size=size,  # type: ignore[arg-type]
        location=place,  # type: ignore[arg-type]
        rotation=turn,  # type: ignore[arg-type]
    )
    text = encode(object_status([status])).decode("latin-1")
    assert re.fullmatch(r"STA( \{[^{}]*\}){5}\r\n", text)
    vector = r"(-?\d+\.\d{4}(,|(?=\}))){3}"
    for key in ("Size", "Location", "Rotation"):
        assert re.search(rf"\{{{key} {vector}\}}", text)


@given(st.lists(st.text(alphabet=" \r\n\t{}ab12.,-\x7f\xe9\u017e", max_size=8), max_size=5))
@example(["SEN {Name a}", "SEN {Range 1 2}"])
@example(["a\r\nb", "c"])
@example(["a  b"])
@example(["a ", "b"])
@example(["a", " b"])
@example([" a"])
@example(["a\tb"])
@example(["a", "", "b"])
@example(["12", "3 4"])
@example([])
def test_many_lines_encode_as_one_by_one(texts: list[str]) -> None:
    """Protocol reference 1.3: whatever names and values contain."""
    once = encode_all(texts)
    assert once == [encode(text) for text in texts]
    assert encode_all(texts) == once, "from memory"
