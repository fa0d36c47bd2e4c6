"""NFO and DIE lines (protocol reference 1.2, 4.2, 4.12; checklist 2 to 4, 80 to 84)."""

from __future__ import annotations

import pytest

from usarsim_server.protocol.messages import (
    closest_path_node,
    die,
    greeting,
    path_nodes,
    start_poses,
    status_change,
)

YARD = [
    ("RobotStart1", (1.25, -0.5, -0.2), (0.0, 0.0, 1.57079)),
    ("RobotStart2", (4.0, 2.0, -0.2), (0.0, 0.0, 0.0)),
]


def test_greeting() -> None:
    """2, 3: three segments in this order, TimeLimit an integer."""
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
    """4: the suffix and what follows it are cut off, in any case."""
    assert greeting("BotDeathMatch", level, 20).split(" {")[2] == "Level Hall}"


def test_a_point_alone_is_part_of_the_level() -> None:
    """4: only LevelInfo is cut, not every extension."""
    assert "{Level Hall.v2}" in greeting("BotDeathMatch", "Hall.v2", 20)


def test_start_poses_are_flat() -> None:
    """81, 82: the count, then one segment of tag, location, rotation, single blanks between."""
    assert start_poses(YARD) == (
        "NFO {StartPoses 2} {RobotStart1 1.2500,-0.5000,-0.2000 0.0000,0.0000,1.5707 "
        "RobotStart2 4.0000,2.0000,-0.2000 0.0000,0.0000,0.0000}"
    )


def test_start_poses_count_equals_the_groups() -> None:
    """81: n is the number of groups of three words in the second segment."""
    for count in range(1, 5):
        text = start_poses([YARD[0]] * count)
        head, _, body = text.partition("} {")
        assert head == f"NFO {{StartPoses {count}"
        assert len(body.rstrip("}").split(" ")) == 3 * count


def test_no_start_poses() -> None:
    """81: with n = 0 there is no second segment."""
    assert start_poses([]) == "NFO {StartPoses 0}"


def test_blanks_in_a_tag_do_not_shift_the_groups() -> None:
    """82: a tag is one word, whatever the world file says."""
    body = start_poses([("Robot Start {1}", (0, 0, 0), (0, 0, 0))]).split("} {")[1]
    assert body == "Robot_Start_(1) 0.0000,0.0000,0.0000 0.0000,0.0000,0.0000}"


def test_path_nodes() -> None:
    """84: path nodes have the form of start poses."""
    assert path_nodes([("PathNode_0", (3, 1, -0.4), (0, 0, 0))]) == (
        "NFO {PathNodes 1} {PathNode_0 3.0000,1.0000,-0.4000 0.0000,0.0000,0.0000}"
    )
    assert path_nodes([]) == "NFO {PathNodes 0}"


def test_closest_path_node() -> None:
    """84: tag and location of the nearest node."""
    assert closest_path_node("PathNode_0", (3, 1, -0.4)) == (
        "NFO {Pathnode PathNode_0} {Location 3.0000,1.0000,-0.4000}"
    )


def test_die() -> None:
    """4.12: killer and class of the damage."""
    assert die("None", "DmgType_Fell") == "DIE {Killer None} {DamageType DmgType_Fell}"


def test_a_status_change_is_one_line_of_known_form() -> None:
    """A change of configuration is told under a head that every client knows (checks 6-9)."""
    assert status_change(12.5, "Battery Empty", "Battery", "b1") == (
        "NFO {Status Battery_Empty} {Time 12.5000} {Type Battery} {Name b1}"
    )
