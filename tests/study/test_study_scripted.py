"""Scripted operators: what they decide, in a world without a server."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import fmean

import numpy as np
import pytest

pytest.importorskip("scipy")

import itertools

from usarsim_client.truth import View
from usarsim_mission.grid import FREE, WALL, Grid
from usarsim_mission.model import Start, Victim, World
from usarsim_study.scripted.floor import Floor
from usarsim_study.scripted.kinematics import KinematicWorld
from usarsim_study.scripted.operator import Act, Choose, Drive, Mark, Press, ScriptedOperator
from usarsim_study.scripted.skill import Device, Skill, drawn, planted
from usarsim_study.study_file import find_study, read_study

STEP = 0.1


def two_rooms() -> World:
    """12 by 6 m, a wall in the middle with a door of 1.6 m; somebody lies in each room."""
    cells = np.full((60, 120), FREE, np.uint8)
    cells[:, 59:61] = WALL
    cells[22:38, 59:61] = FREE
    cells[0], cells[-1], cells[:, 0], cells[:, -1] = WALL, WALL, WALL, WALL
    grid = Grid(0.0, 0.0, 0.1, cells)
    victims = Victim("Ada", (4.5, 5.0, 0.1)), Victim("Ben", (10.5, 1.0, 0.1))
    starts = Start("R1", pos=(1.0, 1.0, 0.2)), Start("R2", pos=(1.0, 3.0, 0.2))
    return World("two rooms", victims=victims, starts=starts, floor=grid)


WORLD = two_rooms()
FLOOR = Floor(WORLD.floor) if WORLD.floor else None


def play(operator: ScriptedOperator, seconds: float) -> list[tuple[float, Act]]:
    """What an operator does in so many s."""
    world, found, time = KinematicWorld(WORLD), list[tuple[float, Act]](), 0.0
    while time < seconds:
        for act in operator.see(world.row(time)):
            found.append((time, act))
            if isinstance(act, Drive):
                world.drive(act.robot, act.forward, act.turn)
        world.step(STEP)
        time = round(time + STEP, 3)
    return found


def made(skill: Skill, device: str = "gamepad", seed: int = 1, **more: object) -> ScriptedOperator:
    assert FLOOR is not None
    return ScriptedOperator(skill, device, FLOOR, ["R1", "R2"], seed, **more)  # type: ignore[arg-type]


def test_ways_go_through_the_door() -> None:
    assert FLOOR is not None
    ways = FLOOR.ways(FLOOR.node(1.0, 1.0))
    places = FLOOR.places[ways.to(FLOOR.node(11.0, 1.0))]
    crossing = places[np.abs(places[:, 0] - 6.0) < 0.15]
    assert len(crossing)
    assert np.all(np.abs(crossing[:, 1] - 3.0) < 0.8)


@pytest.mark.parametrize(("fails", "marks"), [(1, 2), (3, 4), (99, 4)])
def test_a_mark_that_the_map_cannot_take_is_tried_again(fails: int, marks: int) -> None:
    """One reaction later each time, and not for ever while the victim stays in sight."""
    assert FLOOR is not None
    operator = ScriptedOperator(
        Skill(miss=0.0, reaction=1.0, dwell=math.inf), "gamepad", FLOOR, ["R1"], 1
    )
    row = KinematicWorld(WORLD).row(0.0)
    ben = next(one for one in WORLD.victims if one.name == "Ben")
    view = View("R1", ben.name, angle=0.1, distance=3.0, clear=True)
    times = []
    for step in range(100):
        for act in operator.see(replace(row, time=step * STEP, views=(view,))):
            if isinstance(act, Mark):
                times.append(round(step * STEP, 3))
                if len(times) <= fails:
                    operator.fails(act.victim)
    assert times == [1.0, 2.0, 3.0, 4.0][:marks]


def test_everybody_is_found_and_marked_where_they_are() -> None:
    """Both rooms are searched; a mark comes after the reaction, off by the error of the skill."""
    did = play(made(Skill(miss=0.0, error=0.0, reaction=1.0)), 150.0)
    marks = {act.victim: act for _, act in did if isinstance(act, Mark)}
    assert {name: act.place for name, act in marks.items()} == {
        one.name: one.pos for one in WORLD.victims
    }
    held = [act for _, act in did if isinstance(act, Drive)]
    assert {one.forward for one in held} <= {0.0, 0.5, -0.5}
    assert {one.turn for one in held} <= {0.0, 0.2, -0.2}


def test_equal_seeds_do_the_same_and_others_do_not() -> None:
    skill = Skill(miss=0.3)
    first, again, other = (play(made(skill, seed=seed), 60.0) for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_robots_are_looked_at_in_turn_and_some_turns_are_skipped() -> None:
    """Dwell is the mean time for which each is looked at; neglected ones are passed over."""
    names = ["R1", "R2", "R3"]
    assert FLOOR is not None
    skill = Skill(dwell=5.0, neglect=0.3)
    operator = ScriptedOperator(skill, "keyboard", FLOOR, names, 3, frozenset(names))
    did = [(time, act.robot) for time, act in play(operator, 1500.0) if isinstance(act, Choose)]
    times = [time for time, _ in did]
    assert fmean(np.diff(times)) == pytest.approx(5.0, rel=0.05)
    steps = [(names.index(b) - names.index(a)) % 3 for (_, a), (_, b) in itertools.pairwise(did)]
    assert steps.count(2) / len(steps) == pytest.approx(0.3, abs=0.08)


def test_robots_that_drive_by_themselves_are_left_alone() -> None:
    did = play(made(Skill(), watched=frozenset(("R1", "R2"))), 40.0)
    assert not [act for _, act in did if isinstance(act, Drive)]


@pytest.mark.parametrize(("watched", "chosen"), [(("R2", "R3"), ["R1", "R3"]), (("R2",), ["R1"])])
def test_who_is_in_the_picture_of_another_robot_catches_the_eye(
    watched: tuple[str, ...], chosen: list[str]
) -> None:
    """A second for each picture of robots that drive by themselves; the mark follows there."""
    assert FLOOR is not None
    skill = Skill(miss=0.0, reaction=1.0, dwell=math.inf)
    names = ["R1", "R2", "R3"]
    operator = ScriptedOperator(skill, "keyboard", FLOOR, names, 1, frozenset(watched))
    row = KinematicWorld(WORLD).row(0.0)
    view = View("R3", "Ben", angle=0.1, distance=3.0, clear=True)
    did: list[tuple[float, Act]] = []
    for step in range(60):
        now = replace(row, time=round(step * STEP, 3), views=(view,))
        did += [(now.time, act) for act in operator.see(now)]
    assert [act.robot for _, act in did if isinstance(act, Choose)] == chosen
    marks = [(time, act.robot) for time, act in did if isinstance(act, Mark)]
    assert marks == ([(2.1, "R3")] if "R3" in chosen else [])  # after R2, and the reaction


def test_buttons_are_tried_when_it_is_time() -> None:
    did = play(made(Skill(), tries=((1.0, "laser off"), (2.0, "laser on"))), 3.0)
    assert [(time, act.what) for time, act in did if isinstance(act, Press)] == [
        (1.0, "laser off"),
        (2.0, "laser on"),
    ]


@pytest.mark.parametrize(("name", "advantage"), [("rsarsim", 0.9), ("scaling", 0.0)])
def test_nothing_is_planted_where_nobody_holds_a_gamepad(name: str, advantage: float) -> None:
    assert planted(read_study(find_study(name)), 0.9) == advantage


def test_the_advantage_of_a_device_is_planted_in_its_speed() -> None:
    """Skills follow from seed and number; without an advantage devices are alike on average."""
    assert drawn(7, 3) == drawn(7, 3)
    assert drawn(7, 3) != drawn(7, 4)
    for advantage, ratio in ((0.0, 1.0), (1.0, 3.0)):
        skills = [drawn(1, number, advantage) for number in range(400)]
        keys, pad = (fmean(one.speed(name) for one in skills) for name in ("keyboard", "gamepad"))
        assert pad / keys == pytest.approx(ratio, rel=0.05)


def test_busy_hands_look_less() -> None:
    """The slower device costs attention by what it lacks; devices that are alike cost none."""
    skill = Skill(reaction=1.0, miss=0.2, keyboard=0.2, gamepad=0.4)
    cases: tuple[tuple[Skill, Device, float, float], ...] = (
        (skill, "gamepad", 1.0, 0.2),
        (skill, "keyboard", 1.5, 0.4),
        (replace(skill, keyboard=0.4), "keyboard", 1.0, 0.2),
    )
    for one, device, reaction, miss in cases:
        held = one.holding(device)
        assert (held.reaction, held.miss) == pytest.approx((reaction, miss))


def test_who_drives_faster_searches_more() -> None:
    """What a study of scripted operators has to find."""
    found = {}
    for device in ("keyboard", "gamepad"):
        times = []
        for seed in range(3):
            did = play(made(Skill(miss=0.0, keyboard=0.2, gamepad=0.6), device, seed), 150.0)
            last = [time for time, act in did if isinstance(act, Mark)]
            times.append(last[1] if len(last) > 1 else math.inf)
        found[device] = min(times)
    assert found["gamepad"] < found["keyboard"]
