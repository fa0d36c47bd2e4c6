"""Measures of hand-made logs, against values by hand."""

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from small_world import walls

from usarsim_exploration.environment import Environment
from usarsim_exploration.history import NOWHERE, History
from usarsim_exploration.known_map import FREE, SAFE, WALL
from usarsim_exploration.measures import MEASURES, measure
from usarsim_exploration.measures.base import DECLARED, declare, jain, lasting
from usarsim_exploration.measures.contacts import HALF, Contacts
from usarsim_exploration.measures.map_error import MapError, map_error
from usarsim_exploration.measures.reality import Ways
from usarsim_exploration.rules import NEWEST
from usarsim_exploration.worlds import find

ROWS, BODIES = 6, 3


def by_hand(**changed: Any) -> History:
    """A base and two robots, five steps, 100 reachable cells of 125; nobody does anything."""
    rows, bodies = (ROWS,), (ROWS, BODIES)
    numbers = {
        **dict.fromkeys(("free_team", "free_base", "cells_sent", "bytes_sent"), rows),
        **dict.fromkeys(("distance", "found", "first", "area", "believed", "at_base"), bodies),
        **dict.fromkeys(("heading", "own", "latency", "idle"), bodies),
        "cell": (*bodies, 2),
    }
    found: dict[str, Any] = {name: np.zeros(shape, int) for name, shape in numbers.items()}
    found |= {
        "names": ("Base", "R1", "R2"),
        "by_rules": NEWEST,
        "free": np.full(rows, 125),
        "reachable": np.full(rows, 100),
        "role": np.tile(["base", "explorer", "relay"], (ROWS, 1)),
        "state": np.full(bodies, "explore"),
        "moves": np.full(bodies, "", dtype="<U4"),
        "goal": np.full((*bodies, 2), NOWHERE),
        "works": np.ones(bodies, bool),
        "linked_base": np.ones(bodies, bool),
        "links": tuple(np.zeros((0, 2), int) for _ in range(ROWS)),
    }
    found |= {name: np.array(value) for name, value in changed.items()}
    known = {f"known_{who}": found[f"free_{who}"] for who in ("team", "base")}
    return History(**known | found)


def told(**changed: Any) -> dict[str, Any]:
    """The measures of such a history."""
    return measure(by_hand(**changed))


def test_curves() -> None:
    """E-75, EXP-11: times, areas, shares and waits of two curves."""
    found = told(
        free_team=[10, 50, 90, 94, 95, 98],
        free_base=[10, 10, 50, 50, 90, 95],
        area=[[10, 5, 5]] * 2 + [[50, 45, 45]] * 4,
        believed=[[20, 0, 0]] * 5 + [[100, 0, 0]],
    )
    times = {name: value for name, value in found.items() if name[-3:] in ("t50", "t90", "t95")}
    assert list(times.values()) == [1, 2, 4, 2, 4, 5]
    assert found["team_t99"] is None
    assert found["base_t99"] is None
    assert found["team_percent_reachable"] == 98
    assert found["base_percent_all"] == pytest.approx(100 * 95 / 125)
    assert found["team_area"] == pytest.approx((10 + 50 + 90 + 94 + 95 + 98) / 600)
    assert found["base_area"] == pytest.approx((10 + 10 + 50 + 50 + 90 + 95) / 600)
    parts = [1, 10 / 50, 50 / 90, 50 / 94, 90 / 95, 95 / 98]
    assert found["base_share"] == pytest.approx(100 * sum(parts) / 6)
    parts = [5 / 10, 5 / 50, 45 / 90, 45 / 94, 45 / 95, 45 / 98]
    assert found["robot_share"] == pytest.approx(100 * sum(parts) / 6)
    assert found["mean_wait"] == pytest.approx((0 + 40 + 40 + 44 + 5 + 3) / 98)
    assert found["base_map_iou"] == pytest.approx(95 / (125 + 100 - 95))
    assert found["steps"] == 5


def test_work() -> None:
    """EXP-11: path, overlap, deviation, Jain's index, steps by what robots did, collisions."""
    found = told(
        free_team=[10, 20, 20, 20, 40, 40],
        distance=[[0, 0, 0]] * 5 + [[0, 30.0, 10.0]],
        found=[[0, 8, 8], [0, 0, 10], [0, 4, 0], [0, 0, 0], [0, 20, 0], [0, 0, 0]],
        first=[[0, 8, 2], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 20, 0], [0, 0, 0]],
        state=[["base", "explore", "return home"]] * 2 + [["base", "wait", "explore"]] * 4,
        cell=[[[0, 0], [x, 0], [9, 9]] for x in (0, 1, 1, 1, 2, 2)],
        moves=[["", "", ""]] * 4 + [["", "00x0", "x2"], ["", "x1", ""]],
        role=[["base", "explorer", "relay"]] * 3 + [["base", "relay", "explorer"]] * 3,
        works=[[True, True, True]] * 4 + [[True, True, False]] * 2,
    )
    assert (found["distance"], found["longest_distance"]) == (40, 30)
    assert found["efficiency"] == 1
    assert found["overlap"] == pytest.approx(100 * 20 / 50)
    assert found["coverage_deviation"] == pytest.approx(100 * (28 / 30 - 0.5))
    assert found["jain_found"] == pytest.approx(30**2 / (2 * (28**2 + 2**2)))
    assert found["jain_distance"] == pytest.approx(40**2 / (2 * 1000))
    assert (found["sensing"], found["double_sensing"]) == (3, 3)
    assert found["not_sensing"] == 1 + 1 + 2 + 1  # rows 1, 2, 3, 5, the lost one left out
    assert found["returning"] == 2 + 4
    assert found["longest_stand"] == 3  # R2 until it failed
    assert found["longest_without_news"] == 1  # row 3: in row 2 R1 waits and R2 relays
    assert found["collisions"] == 3
    assert found["role_swaps"] == 1
    assert found["lost"] == ["R2"]


def test_talk() -> None:
    """EXP-11: latency, disconnected share, silence, links and bytes."""
    links = [[[0, 1], [1, 2]], [[0, 1]], [], [], [], [[0, 1]]]
    history = by_hand(
        linked_base=[[1, 1, 1], [1, 1, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]],
        works=[[True] * 3] * 5 + [[True, True, False]],
        latency=[[0, 0, 0], [0, 0, 1], [0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 0, 5]],
        cells_sent=[0, 3, 3, 3, 3, 7],
        bytes_sent=[9, 40, 40, 40, 40, 90],
    )
    vars(history)["linked_base"] = history.linked_base != 0
    vars(history)["links"] = tuple(np.array(one, int).reshape(-1, 2) for one in links)
    found: dict[str, Any] = measure(history)
    assert found["disconnected"] == pytest.approx(100 * (3 + 4) / 11)
    assert found["mean_silence"] == pytest.approx((1 + 2 + 3 + 1 + 2 + 3 + 4) / 11)
    assert found["longest_silence"] == 4
    assert found["mean_links"] == pytest.approx(4 / 6)
    assert (found["cells_sent"], found["bytes_sent"]) == (7, 90)
    # R1 heard of steps 2 to 5 at step 5, after 3, 2, 1 and 0; R2 of step 0 alone
    assert found["max_latency"] == 3
    assert found["mean_latency"] == pytest.approx((6 / 6 + 0) / 2)


def rooms(cell: float = 0.1) -> tuple[Environment, np.ndarray]:
    """Two rooms, and a map of all of it as it is."""
    world = Environment("rooms", walls(), cell)
    bits = np.where(world.walls, np.uint8(WALL | SAFE), np.uint8(FREE | SAFE)).astype(np.uint8)
    return world, bits


def test_the_error_of_a_map() -> None:
    """EXP-16: none of a true map; a wall drawn two cells off counts with its cells and distance."""
    world, bits = rooms()
    whole = map_error(bits, world, (3, 3))
    assert whole == MapError(0.0, 1.0, 1.0)
    bits[5, 20:24] = WALL | SAFE  # five rows from either wall
    drawn = np.count_nonzero(world.walls) + 4
    found = map_error(bits, world, (3, 3))
    assert found.error == pytest.approx(0.1 * 4 * 3.5 / drawn, rel=0.3)
    assert found.mapped == 1.0
    assert found.overlap == pytest.approx(1 - 4 / np.count_nonzero(world.walls == 0))
    bits[:, 15:] = 0
    half = map_error(bits, world, (3, 3))
    assert half.error == 0.0
    assert 0.4 < half.mapped < 0.7
    nothing = map_error(np.zeros_like(bits), world, (3, 3))
    assert nothing == MapError(None, 0.0, 0.0)


@pytest.mark.parametrize(
    ("shift", "turn"), [((3.0, -2.0), 0.0), ((1.0, 2.0), 0.06), ((0.0, 0.0), 0.1)]
)
def test_a_map_that_lies_askew(shift: tuple[float, float], turn: float) -> None:
    """EXP-16: a map that is right in itself has an error below half a cell, and says how it lay."""
    world = find("lab").environment
    bits = np.where(world.walls, np.uint8(WALL | SAFE), np.uint8(FREE | SAFE)).astype(np.uint8)
    rows, columns = bits.shape
    matrix = cv2.getRotationMatrix2D((columns / 2, rows / 2), math.degrees(-turn), 1.0)
    matrix[:, 2] += shift
    askew = cv2.warpAffine(bits, matrix, (columns, rows), flags=cv2.INTER_NEAREST)
    found = map_error(askew, world, find("lab").base)
    assert found.error is not None
    assert found.error < 0.05
    assert found.mapped > 0.85  # shifts push outer walls off the map
    assert found.overlap > 0.9
    assert found.turn == pytest.approx(-turn, abs=0.005)
    assert found.shift == pytest.approx(0.1 * math.hypot(*shift), abs=0.1)


def test_ways_of_real_robots() -> None:
    """Drift, slip, and who was near whom, by hand."""
    ways = Ways()
    for tick in range(11):  # both drive 10 m to the right; wheels roll 12 m and turn away
        wheels = 5.0, 5.0 + 1.2 * tick, math.pi / 2
        places = {1: 0.0, 2: 4.0 if tick < 5 else 0.9}
        truth = {robot: (float(tick), y, 0.0) for robot, y in places.items()}
        ways.note({n: (one, (tick, one[1] + 0.5, 0.0), wheels) for n, one in truth.items()}, 0.5)
    found = ways.facts()
    assert found["position_error"] == pytest.approx(0.5)
    assert found["near_others"] == pytest.approx(0.5 * 2 * 6)
    way = 10 + 9 + math.hypot(1, 3.1)
    assert found["slip"] == pytest.approx(100 * (1 - way / 24))
    off = math.hypot(2, 3.1) / (9 + math.hypot(1, 3.1))
    assert found["odometry_drift"] == pytest.approx(100 * (0.2 + off) / 2)


def test_collisions_of_real_robots() -> None:
    """EXP-11: each begins once, ends with a gap; robots that only pass each other have none."""
    world = Environment("room", np.pad(np.zeros((80, 80), np.uint8), 10, constant_values=1))
    contacts = Contacts()

    def at(*poses: tuple[float, float, float]) -> tuple[int, int]:
        contacts.note(dict(enumerate(poses, 1)), world)
        return contacts.walls, contacts.robots

    wall = 1.0 + HALF[0]  # where the bumper of a robot that looks to the left touches it
    assert at((wall + 0.05, 5.0, math.pi), (5.0, 5.0, 0.0)) == (0, 0)
    assert at((wall + 0.005, 5.0, math.pi), (5.0, 5.0, 0.0)) == (1, 0)
    assert at((wall + 0.03, 5.0, math.pi), (5.0, 5.0, 0.0)) == (1, 0)
    assert at((wall + 0.06, 5.0, math.pi), (5.0, 5.0, 0.0)) == (1, 0)
    assert at((wall - 0.01, 5.0, math.pi), (5.0, 5.0, 0.0)) == (2, 0)
    beside = 5.0 + 2 * HALF[1]
    assert at((5.0, beside + 0.05, 0.0), (5.0, 5.0, 0.0)) == (2, 0)
    assert at((5.0, beside + 0.05, 0.3), (5.0, 5.0, 0.0)) == (2, 1)
    assert at((5.0, beside + 0.3, 0.3), (5.0, 5.0, 0.0)) == (2, 1)
    assert at((5.0, beside + 0.005, 0.0), (5.0, 5.0, 0.0)) == (2, 2)
    assert contacts.facts() == {"hit_walls": 2.0, "hit_robots": 2.0}


def test_measures_of_reality() -> None:
    """They are there where a history tells of them."""
    history = by_hand()
    real = [name for name, one in MEASURES.items() if one.real]
    assert not set(real) & set(measure(history))
    found = measure(replace(history, reality={"map_error": 0.04}))
    assert {name: found[name] for name in real} == dict.fromkeys(real) | {"map_error": 0.04}
    assert set(Ways().facts()) | set(Contacts().facts()) < set(real)


def test_nothing_to_tell() -> None:
    """Missing is None, never 0."""
    found = told()
    missing = ("efficiency", "overlap", "coverage_deviation", "jain_found", "jain_distance")
    assert {name for name in missing if found[name] is not None} == set()
    assert found["team_t50"] is None
    assert jain(np.array([3, 3, 3, 0])) == pytest.approx(0.75)


def test_how_long_something_has_held() -> None:
    """Counts begin again after each gap."""
    holds = np.array([[1, 0], [1, 1], [0, 1], [1, 1]], bool)
    assert lasting(holds).tolist() == [[1, 0], [2, 1], [0, 2], [1, 3]]


def test_names_are_given_once() -> None:
    """EXP-11: each measure says what it is; two cannot share a name."""
    on_grid = [name for name, one in MEASURES.items() if not one.real]
    assert list(measure(by_hand())) == ["steps", *on_grid, "lost"]
    assert set(MEASURES) == set(DECLARED)
    for one in MEASURES.values():
        assert one.definition.endswith("."), one.name
        assert one.unit
        assert one.source
    with pytest.raises(ValueError, match="two measures are called distance"):
        declare("distance", "", "", "")(lambda history: None)
