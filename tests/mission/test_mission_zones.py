"""Zones and visits: crossings (O-03), compliance per visit (O-04 to O-06)."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import ORANGE, RED, WORLD, YELLOW, Script, corridor

from usarsim_mission.model import Mission, World, Zone
from usarsim_mission.scoring import ZoneRules
from usarsim_mission.zones import ZoneMap, contains, distance


def crossings(script: Script) -> list[tuple[float, str, bool, str]]:
    return [(one["t_sim"], one["zone"], one["enter"], one["mode"]) for one in script.of("zone")]


def test_crossings_are_told_once_each_in_order_with_time_zone_and_mode() -> None:
    """O-03: from the cellar through the hall into the yard and back, by hand and by itself."""
    script = Script().start(R1=(8.0, 5.0))
    script.tell("mode", robot="R1", mode="autonomous", policy="explore", by="A")
    script.go("R1", (8.0, 5.0), (15.0, 5.0))
    script.tell("mode", robot="R1", mode="teleoperated", by="A")
    script.go("R1", (15.0, 5.0), (22.0, 5.0))
    script.go("R1", (22.0, 5.0), (18.0, 5.0))
    script.go("R1", (18.0, 5.0), (18.0, 12.0))
    assert crossings(script) == [
        (0.0, "cellar", True, "stopped"),
        (2.1, "cellar", False, "autonomous"),
        (2.1, "hall", True, "autonomous"),
        (12.1, "hall", False, "teleoperated"),
        (12.1, "yard", True, "teleoperated"),
        (16.1, "yard", False, "teleoperated"),
        (16.1, "hall", True, "teleoperated"),
        (23.1, "hall", False, "teleoperated"),
    ]
    assert {one["robot"] for one in script.of("zone")} == {"R1"}
    assert [one["colour"] for one in script.of("zone")][1:3] == ["yellow", "orange"]


def test_a_robot_that_trembles_on_a_border_crosses_it_once() -> None:
    """O-03."""
    script = Script().start(R1=(9.9, 5.0))
    for step in range(40):
        script.row(0.1 * step, R1=(10.0 + (0.002 if step % 2 else -0.002), 5.0))
    assert len(script.of("zone")) == 1
    script.row(5.0, R1=(10.02, 5.0))
    script.row(5.1, R1=(9.995, 5.0))
    assert [one["zone"] for one in script.of("zone")] == ["cellar", "cellar", "hall"]


@given(st.lists(st.tuples(st.floats(-3.0, 33.0), st.floats(-3.0, 13.0)), max_size=40))
def test_however_a_robot_goes_it_leaves_what_it_entered(path: list[tuple[float, float]]) -> None:
    """O-03: for each robot enters and leaves of a zone take turns, and at most one holds it."""
    script = Script().start(R1=(-2.0, -2.0))
    inside: list[str] = []
    for number, place in enumerate(path, start=1):
        for one in script.row(0.1 * number, R1=place):
            if one["kind"] == "zone" and one["enter"]:
                assert inside == []
                inside.append(one["zone"])
            elif one["kind"] == "zone":
                assert inside == [one["zone"]]
                inside.clear()


def mark_anna(script: Script) -> tuple[bool, bool]:
    """Whether Anna, who lies in the yellow cellar, is found and credited by a mark."""
    script.mark(1, 5.0, 5.0)
    (credit,) = script.of("credit")
    assert credit["victim"] == "Anna"
    return bool(script.of("found")), credit["credited"]


def test_a_yellow_visit_without_driving_is_credited() -> None:
    """O-04: autonomous motion only."""
    script = Script().start(R1=(15.0, 5.0))
    script.tell("mode", robot="R1", mode="autonomous", by="A")
    script.drive("R1", "autonomy")
    script.go("R1", (15.0, 5.0), (6.0, 5.0))
    script.tell("select", robot="R1", page=1)
    script.tell("camera", robot="R1", on=True, page=1)
    script.tell("command", robot="R1", source="operator", text="SET {Type Camera} {Pan 0.3}")
    assert mark_anna(script) == (True, True)
    assert script.values()["VC"] == 1


@pytest.mark.parametrize(
    "command",
    [
        {"source": "operator", "left": 0.1, "right": 0.0},
        {"source": "timed_move", "left": 0.2, "right": -0.2},
        {"source": "operator", "text": "DRIVE {Left 0.4} {Right 0.4}"},
        {"source": "operator", "text": "waypoint 5,5"},
    ],
)
def test_one_manual_command_past_the_band_is_found_but_not_credited(
    command: dict[str, object],
) -> None:
    """O-04: a drive command, a timed move, a line of the protocol or a waypoint."""
    script = Script().start(R1=(15.0, 5.0))
    script.drive("R1", "autonomy")
    script.go("R1", (15.0, 5.0), (8.0, 5.0))
    script.tell("command", robot="R1", **command)
    script.drive("R1", "autonomy")
    script.go("R1", (8.0, 5.0), (6.0, 5.0))
    assert mark_anna(script) == (True, False)
    assert script.of("credit")[0]["why"] == "yellow zone cellar is for autonomous robots only"
    assert (script.values()["VF"], script.values()["VC"]) == (1, 0)


def test_a_stop_past_the_band_breaks_nothing() -> None:
    """O-04: neither zero nor the watchdog nor an emergency stop is driving."""
    script = Script().start(R1=(15.0, 5.0))
    script.go("R1", (15.0, 5.0), (8.0, 5.0))
    script.drive("R1", "operator", 0.0)
    script.drive("R1", "watchdog", 0.0)
    script.tell("command", robot="R1", source="operator", text="DRIVE {Left 0.0} {Right 0}")
    script.tell("estop", on=True, by="A")
    script.go("R1", (8.0, 5.0), (6.0, 5.0))
    assert mark_anna(script) == (True, True)


def test_driving_inside_the_band_keeps_the_visit_clean() -> None:
    """O-05: 1 m on each side of the border; the hand is off before it ends."""
    script = Script().start(R1=(12.0, 5.0))
    script.tell("mode", robot="R1", mode="teleoperated", by="A")
    script.drive("R1")
    script.go("R1", (12.0, 5.0), (9.05, 5.0))
    script.tell("mode", robot="R1", mode="autonomous", by="A")
    script.drive("R1", "autonomy")
    script.go("R1", (9.05, 5.0), (6.0, 5.0))
    assert mark_anna(script) == (True, True)


def test_what_is_begun_in_the_band_and_lasts_beyond_it_counts() -> None:
    """O-05: the last command of the operator still drives the robot out of the band."""
    script = Script().start(R1=(12.0, 5.0))
    script.drive("R1")
    script.go("R1", (12.0, 5.0), (8.9, 5.0))
    script.drive("R1", "operator", 0.0)
    assert mark_anna(script) == (True, False)


def test_a_new_visit_is_a_clean_one() -> None:
    """O-04, O-05: compliance is kept per visit."""
    script = Script().start(R1=(8.0, 5.0))
    script.drive("R1")
    script.go("R1", (8.0, 5.0), (12.0, 5.0))
    script.drive("R1", "autonomy")
    script.go("R1", (12.0, 5.0), (6.0, 5.0))
    assert mark_anna(script) == (True, True)


def test_a_robot_that_looks_in_from_outside_has_to_be_in_an_allowed_mode() -> None:
    for mode, credited in (("teleoperated", False), ("autonomous", True)):
        script = Script().start(R1=(11.5, 5.0))
        script.tell("mode", robot="R1", mode=mode, by="A")
        assert mark_anna(script) == (True, credited)


@pytest.mark.parametrize("source", ["operator", "autonomy"])
def test_orange_and_red_credit_in_both_modes(source: str) -> None:
    """O-06."""
    script = Script().start(R1=(12.0, 5.0))
    script.drive("R1", source)
    script.go("R1", (12.0, 5.0), (14.5, 5.0))
    script.mark(1, 15.0, 5.0)
    script.go("R1", (14.5, 5.0), (24.5, 5.0))
    script.mark(2, 25.0, 5.0)
    assert [(one["victim"], one["credited"]) for one in script.of("credit")] == [
        ("Ben", True),
        ("Carl", True),
    ]


def band(world: World, zone: Zone, width: float = 1.0) -> ZoneMap:
    return ZoneMap(world, ZoneRules(), width)


def test_bands_lie_where_the_rule_changes() -> None:
    """1 m on each side of the border of yellow and orange; none between orange and red."""
    zones = band(WORLD, YELLOW)
    assert zones.in_band(YELLOW, 9.01, 5.0)
    assert not zones.in_band(YELLOW, 8.99, 5.0)
    assert zones.in_band(ORANGE, 10.99, 5.0)
    assert not zones.in_band(ORANGE, 11.01, 5.0)
    assert not zones.in_band(ORANGE, 19.9, 5.0)
    assert not zones.in_band(RED, 20.1, 5.0)
    assert not zones.in_band(YELLOW, 0.1, 5.0)
    half = ZoneMap(WORLD, ZoneRules(), 0.5)
    assert half.in_band(YELLOW, 9.51, 5.0)
    assert not half.in_band(YELLOW, 9.49, 5.0)


def test_a_zone_of_its_own_has_its_band_where_robots_can_come_in() -> None:
    """A corridor whose far half is yellow: the band lies across it, not along its walls."""
    zone = Zone("end", "yellow", ((10.0, 0.0), (20.0, 0.0), (20.0, 2.0), (10.0, 2.0)))
    zones = band(World(zones=(zone,), floor=corridor()), zone)
    assert zones.in_band(zone, 10.9, 1.0)
    assert not zones.in_band(zone, 11.1, 1.0)
    assert not zones.in_band(zone, 15.0, 0.1)
    assert not zones.in_band(zone, 19.9, 1.0)


def test_a_blue_zone_is_a_band_as_it_is_drawn() -> None:
    """O-05, with a band that the mission gives; to enter and leave it is told, too."""
    blue = Zone("door", "blue", ((6.0, 4.0), (8.0, 4.0), (8.0, 6.0), (6.0, 6.0)))
    script = Script(dataclasses.replace(WORLD, zones=(*WORLD.zones, blue))).start(R1=(7.0, 5.0))
    script.drive("R1")
    script.row(1.0, R1=(6.5, 5.0))
    script.drive("R1", "operator", 0.0)
    script.row(2.0, R1=(5.5, 5.0))
    assert mark_anna(script) == (True, True)
    assert [(one["zone"], one["colour"], one["enter"]) for one in script.of("zone")] == [
        ("cellar", "yellow", True),
        ("door", "blue", True),
        ("door", "blue", False),
    ]


def test_the_width_of_the_band_is_that_of_the_mission() -> None:
    script = Script(mission=Mission(band=3.0)).start(R1=(12.0, 5.0))
    script.drive("R1")
    script.go("R1", (12.0, 5.0), (7.1, 5.0))
    script.drive("R1", "operator", 0.0)
    assert mark_anna(script) == (True, True)


SQUARE = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
NEXT = ((2.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0))


@given(st.floats(-1.0, 5.0), st.floats(-1.0, 3.0))
def test_of_neighbours_at_most_one_holds_a_place(x: float, y: float) -> None:
    inside = contains(SQUARE, x, y), contains(NEXT, x, y)
    assert sum(inside) <= 1
    if 0.0 < x < 4.0 and 0.0 < y < 2.0:
        assert sum(inside) == 1


def test_distances_to_segments() -> None:
    assert distance(((0.0, 0.0), (4.0, 0.0)), 2.0, 3.0) == 3.0
    assert distance(((0.0, 0.0), (4.0, 0.0)), 7.0, 4.0) == 5.0
    assert distance(((1.0, 1.0), (1.0, 1.0)), 4.0, 5.0) == 5.0
