"""The level with physics: routes, wheels, messages, and a run over the ports of a server."""

from __future__ import annotations

import argparse
import inspect
import json
import math
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from small_world import small

from usarsim_client.inbox import Line
from usarsim_exploration.commands import run as run_command
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.history import History
from usarsim_exploration.known_map import FREE, SAFE, WALL
from usarsim_exploration.levels import controller
from usarsim_exploration.levels.controller import Controller, DeadError
from usarsim_exploration.levels.driver import Driver
from usarsim_exploration.levels.route import route
from usarsim_exploration.levels.rover import Reckoning
from usarsim_exploration.levels.server import ServerLevel
from usarsim_exploration.levels.serving import wireless
from usarsim_exploration.levels.wire import decode, encode
from usarsim_exploration.localisation.poses import wrap
from usarsim_exploration.log_files import agents_csv, steps_csv
from usarsim_exploration.measures import measure
from usarsim_exploration.opening import open_level
from usarsim_exploration.post import Message
from usarsim_exploration.radio import Circle, PathLoss, Sight, SubT
from usarsim_exploration.running import Run, run
from usarsim_exploration.scenario import read
from usarsim_exploration.strategies.frontier import FrontierStrategy
from usarsim_exploration.strategy import Teammate
from usarsim_exploration.walking import line

NOTHING = np.empty((0, 2), np.int64)


def rooms(door: int) -> np.ndarray:
    """A map of two rooms with a door of so many cells."""
    bits = np.full((40, 60), FREE | SAFE, np.uint8)
    bits[:, 30] = WALL | SAFE
    bits[20 - door // 2 : 20 - door // 2 + door, 30] = FREE | SAFE
    return bits


def test_routes_keep_off_walls() -> None:
    """Where a strategy hugs the wall the robot does not, and it goes through the door's middle."""
    path = line((10, 38), (29, 38)) + line((29, 38), (29, 17)) + line((29, 17), (45, 17))
    way, ends = route(rooms(10), (10, 38), path[:60], 3.5, NOTHING)
    assert ends
    assert abs(way[-1][0] - path[:60][-1][0]) <= 1
    (middle,) = [row for column, row in way if column == 30]
    assert 18 <= middle <= 21


def test_no_route_through_a_narrow_door() -> None:
    """A robot of 0.58 m does not try one of 0.5 m; it goes as far as it can."""
    way, ends = route(rooms(5), (10, 20), line((10, 20), (45, 20)), 3.5, NOTHING)
    assert not ends
    assert max(column for column, _ in way) < 30


def test_a_route_ends_where_a_robot_can_turn() -> None:
    """Half its diagonal is 4.2 cells; who is there already gets as near as it can."""
    way, ends = route(rooms(10), (10, 10), line((10, 10), (26, 10)), 3.5, NOTHING)
    assert ends
    assert way[-1] == (25, 10)
    nearer, ends = route(rooms(10), (25, 10), line((25, 10), (26, 10)), 3.5, NOTHING)
    assert (nearer, ends) == ([(26, 10)], True)


def test_routes_lead_around_others() -> None:
    """What the laser sees, and no map shows."""
    crate = np.array([(column, row) for column in range(18, 23) for row in range(17, 24)])
    way, ends = route(rooms(10), (8, 20), line((8, 20), (28, 20)), 3.5, crate)
    assert ends
    away = np.hypot(*(np.array(way)[:, None] - crate[None]).transpose(2, 0, 1)).min()
    assert away >= 3.5


def drive(driver: Driver, *, held: bool = False) -> tuple[float, float, float]:
    """20 s of a robot without slip, or of one that is held."""
    x = y = heading = 0.0
    for _ in range(100):
        speed, turn = driver.steer((x, y, heading), np.empty((0, 2)), False)
        if not held:
            heading += 0.2 * turn
            x, y = x + 0.2 * speed * math.cos(heading), y + 0.2 * speed * math.sin(heading)
    return x, y, heading


def test_a_driver_follows_its_route() -> None:
    """Around a corner, and then it looks where it shall."""
    driver = Driver(1, 0.5, 0.2)
    route_ = [(0.1 * n, 0.0) for n in range(20)] + [(2.0, 0.1 * n) for n in range(20)]
    driver.follow(route_, -math.pi / 2, ends=True)
    x, y, heading = drive(driver)
    assert math.dist((x, y), (2.0, 1.9)) < 0.2
    assert abs(wrap(heading + math.pi / 2)) < 0.4
    assert driver.arrived
    assert (driver.blocked, driver.recoveries, driver.stuck) == (False, 0, 0.0)


def test_a_driver_that_is_held_gives_up() -> None:
    """It backs off some times, then says that it is blocked."""
    driver = Driver(1, 0.5, 0.2)
    driver.follow([(0.1 * n, 0.0) for n in range(20)], 0.0, ends=True)
    drive(driver, held=True)
    assert driver.blocked
    assert driver.recoveries > 2
    assert 5.0 < driver.stuck < 20.0


def test_a_driver_turns_where_it_cannot_turn_on_the_spot() -> None:
    """Backwards and ahead in turn, always towards where it shall, between two walls."""
    driver = Driver(1, 0.5, 0.2)
    driver.follow([(0.0, 0.1 * n) for n in range(20)], 0.0, ends=True)
    x, headings, ways = 0.0, [0.0], [0.0]
    for _ in range(200):
        if headings[-1] > math.pi / 2 - 0.7:
            break
        speed, turn = driver.steer((x, 0.0, headings[-1]), np.array([[0.5 - x, 0.0]]), False)
        if speed and abs(x + 0.2 * speed) < 0.1:
            x += 0.2 * speed
            headings.append(headings[-1] + 0.2 * turn)
            ways.append(speed)
    assert min(ways) < -0.1
    assert max(ways) > 0.1
    assert (np.diff(headings) >= 0.0).all()
    assert headings[-1] > math.pi / 2 - 0.7


def test_a_driver_that_sees_few_walls_turns_slowly() -> None:
    """Scans have to overlap; what it drives meanwhile is less as well, so the curve is the same."""
    one, other = Driver(1, 0.5, 0.2), Driver(1, 0.5, 0.2)
    for driver in (one, other):
        driver.follow([(1.0, 0.5)], 0.0, ends=True)
    speed, turn = one.steer((0.0, 0.0, 0.0), np.empty((0, 2)), False)
    slow, slight = other.steer((0.0, 0.0, 0.0), np.empty((0, 2)), False, vague=True)
    assert slight < turn - 0.2
    assert slow / slight == pytest.approx(speed / turn)


def test_a_driver_stops_before_what_it_sees() -> None:
    """Something 0.4 m ahead of its middle leaves hardly any speed."""
    driver = Driver(1, 0.5, 0.2)
    driver.follow([(0.1 * n, 0.0) for n in range(20)], 0.0, ends=True)
    assert driver.steer((0.0, 0.0, 0.0), np.array([[3.0, 0.0]]), False)[0] == pytest.approx(0.5)
    assert driver.steer((0.0, 0.0, 0.0), np.array([[0.35, 0.1]]), False)[0] < 0.1


def test_an_ins_counts_more_than_wheels() -> None:
    """Held by a wall, wheels go on turning; between two readings of the INS they have to do.

    Its place keeps to the axes of the world, though its heading drifts: the robot's own counts.
    """
    told = Reckoning()
    assert told.update((1.0, 1.0, 0.0), 1.5) == (0.0, 0.0, 0.0)
    told.update((1.0, 1.0, 0.3), 1.5, (5.0, 5.0, math.pi / 2))  # skids: 0.2 rad
    held = told.update((2.0, 1.0, 3.0), 1.5, (5.0, 5.0, math.pi / 2), math.pi / 2)
    assert held == pytest.approx((0.0, 0.0, 0.2))
    turned = told.update((2.0, 1.0, 3.15), 1.5)
    assert turned == pytest.approx((0.0, 0.0, 0.3))
    driven = told.update((2.0, 1.0, 3.15), 1.5, (5.0, 7.0, math.pi / 2), math.pi / 2)
    assert driven == pytest.approx((2 * math.cos(0.2), 2 * math.sin(0.2), 0.2))
    drifted = told.update((2.0, 1.0, 3.15), 1.5, (6.0, 7.0, math.pi / 2), 0.0)
    assert drifted == pytest.approx((3 * math.cos(0.2), 3 * math.sin(0.2), 0.2))


def test_who_pitches_sees_the_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its scan is left out; angles of the wire are from 0 to 2 pi, and an INS tells no time."""
    lines: list[bytes] = []
    link = SimpleNamespace(line=lambda: Line(lines.pop(0)))
    monkeypatch.setattr(controller, "BlockingConnection", lambda *_: link)
    one = Controller("", 0, "R1", "P3AT", 1.5)
    for pitch, fresh in (("6.28", True), ("0.04", False)):
        lines += [
            b"SEN {Time 1.0000} {Type Odometry} {Name Odometer} {Pose 0.0,0.0,0.0}\r\n",
            b"SEN {Type INS} {Name InsTest} {Location 1.00,2.00,0.00} "
            b"{Orientation 0.00," + pitch.encode() + b",3.00}\r\n",
            b"SEN {Time 1.0000} {Type RangeScanner} {Name lms200} {Resolution 1.5} {FOV 3.0} "
            b"{Range 1.00,2.00,3.00}\r\n",
            b"NFO {Status Tick} {Time 1.1000}\r\n",
        ]
        one.collect()
        assert one.fresh is fresh
        assert one.inertial() == (1.0, 2.0, 3.0)
        assert one.ranges.tolist() == [1.0, 2.0, 3.0]  # nobody drives into what it sees


def test_messages_are_the_same_at_the_other_end() -> None:
    """Tuples, arrays and keys that are no text as well; runs of any length."""
    random = np.random.Generator(np.random.PCG64(3))
    cells = np.sort(random.choice(400_000, 200_000, replace=False))
    cells = np.unique(np.concatenate([cells, np.arange(100_000, 200_000)]))
    bits = np.where(cells < 200_000, 3, 1 + cells % 63).astype(np.uint8)
    letter = {"bids": [(1, 2, 0.5)], "seen": np.arange(5), "next": None, "of": {3: (1, 2)}}
    one = Teammate(2, "R2", "relay", 10.0, (3, 4), "explore", None, 7, letter)
    message = Message(9, 1, 2, 8, [one, one], cells, bits)
    data = encode(message)
    assert data == encode(message)
    got = decode(data)
    assert (got.due, got.taker, got.giver, got.base_step) == (9, 1, 2, 8)
    assert np.array_equal(got.cells, cells)
    assert np.array_equal(got.bits, bits)
    told = dict(got.entries[0].letter)
    assert np.array_equal(told.pop("seen"), letter.pop("seen"))
    assert told == letter
    assert (got.entries[1].cell, got.entries[1].goal, got.entries[1].heard) == ((3, 4), None, 7)
    empty = decode(encode(Message(1, 0, 1, 0, [], cells[:0], bits[:0])))
    assert (len(empty.cells), empty.entries) == (0, [])


def test_radios_of_the_wireless_server() -> None:
    """The same law; what it has not is an error."""
    assert wireless(PathLoss(), 20.0)["reference_distance"] == 20.0
    assert wireless(Circle(), 15.0)["model"] == "distance"
    assert wireless(Sight(), 15.0)["range"] == 15.0
    with pytest.raises(ExplorationError, match="has no such model"):
        wireless(SubT(), 20.0)


LAB: dict[str, Any] = {
    "backend": "server",
    "environment": {"name": "lab"},
    "team": {"robots": 2},
    "strategy": {"name": "frontier"},
    "end": {"steps": 12},
    "physics": {"seconds": 1.6},
    "event": [
        {"step": 4, "kind": "outage", "robot": "R1", "steps": 3},
        {"step": 9, "kind": "loss", "robot": "R2"},
    ],
}


def agree(history: History, other: History) -> float:
    """Most by which the parts known differ at the same way driven, percent."""

    def curve(one: History) -> tuple[np.ndarray, np.ndarray]:
        return one.distance[:, 1:].sum(axis=1), 100 * one.free_team / one.reachable

    (ways, known), (others, theirs) = curve(history), curve(other)
    reached = ways <= others[-1]
    return float(np.abs(known - np.interp(ways, others, theirs))[reached].max())


def played() -> tuple[list[str], Run]:
    """The logs and measures of a run with physics."""
    with Run(read(LAB)) as one:
        while one.step():
            pass
        history = one.result().history
        return [steps_csv(history), agents_csv(history), json.dumps(measure(history))], one


@pytest.mark.slow
def test_a_run_over_the_ports_of_a_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """E-81, E-82, EXP-03, EXP-07, EXP-08, EXP-16: robots of a server, twice the same.

    By two ports only, and with a map without an error of half a cell though odometry drifts.

    Every connection goes to the robots' port, the wireless one, or a road that the wireless server
    gave; a radio that is out is not linked; the others go on without a robot that fails.
    """
    ports: list[int] = []
    connect = socket.create_connection

    def noted(address: tuple[str, int], *more: Any, **others: Any) -> socket.socket:
        ports.append(address[1])
        return connect(address, *more, **others)

    monkeypatch.setattr(socket, "create_connection", noted)
    texts, one = played()
    level = one.cycle.level
    assert isinstance(level, ServerLevel)
    control = level.place.control
    assert ports[:3] == [control] * 3
    assert ports[3:6] == [level.place.wireless] * 3
    assert set(ports[6:]) <= level.roads
    assert one.events == [(4, "outage R1"), (7, "end of outage R1"), (9, "loss R2")]
    history = one.result().history
    assert not history.linked_base[4:7, 1].any()
    assert history.linked_base[7:, 1].all()
    found: dict[str, Any] = measure(history)
    assert found["lost"] == ["R2"]
    assert 0.0 <= found["map_error"] < one.cycle.environment.cell / 2
    assert found["position_error"] < 0.1 < found["odometry_drift"]
    assert history.distance[-1, 1] > history.distance[8, 1] > 15.0
    assert history.distance[-1, 2] == history.distance[8, 2]
    assert history.free_team[-1] > 1.5 * history.free_team[0]
    assert agree(history, run(read({**LAB, "backend": "grid"})).history) < 10.0
    assert type(one.cycle.bodies[1].strategy) is FrontierStrategy
    assert inspect.getmodule(one.cycle.bodies[1].strategy) is inspect.getmodule(FrontierStrategy)
    assert played()[0] == texts


@pytest.mark.slow
def test_an_office_is_explored() -> None:
    """E-80: the same strategy code, four P3AT robots, 90 % of 20 m x 15 m within 200 s."""
    tables: dict[str, Any] = {
        "backend": "server",
        "environment": {"name": "lab"},
        "team": {"robots": 4},
        "strategy": {"name": "frontier"},
        "end": {"steps": 100, "base": "off"},
    }
    with Run(read(tables)) as one:
        while 100 * one.recorder.free_team < 90 * one.recorder.reachable:
            assert one.step(), one.ended
        level = one.cycle.level
        assert isinstance(level, ServerLevel)
        assert level.time < 200.0
        assert (level.reality(one.cycle)["position_error"] or 1.0) < 0.1
    assert type(one.cycle.bodies[1].strategy) is FrontierStrategy


@pytest.mark.slow
def test_a_server_that_goes_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line that says so; the folder holds what was, and why it failed."""
    move = ServerLevel.move

    def cut(level: ServerLevel, cycle: Any) -> None:
        if cycle.step == 3:
            assert level.place.own is not None
            level.place.own.close()
        move(level, cycle)

    monkeypatch.setattr(ServerLevel, "move", cut)
    parser = argparse.ArgumentParser()
    run_command.add_parser(parser.add_subparsers())
    words = ["--world", "lab", "--robots", "1", "--backend", "server", "--out", str(tmp_path)]
    arguments = parser.parse_args(["run", *words])
    with pytest.raises(ExplorationError, match=r"the server .* is gone after"):
        arguments.run(arguments)
    facts = json.loads((tmp_path / "run.json").read_text())
    assert facts["ended"] == {"reason": "failed", "step": 2}
    assert "is gone after" in facts["error"]
    assert len((tmp_path / "steps.csv").read_text().splitlines()) == 4


@pytest.mark.parametrize(
    ("connect", "told"),
    [("127.0.0.1:1", "no server at 127.0.0.1:1"), ("host:port", "is no address")],
)
def test_addresses(connect: str, told: str) -> None:
    """One line with the cure."""
    with pytest.raises(ExplorationError, match=told):
        open_level(read(LAB), connect)


def test_walls_of_servers_stay() -> None:
    """Doors close on the grid only; that is told before anything is started."""
    event = {"step": 3, "kind": "close", "cells": [3, 3, 4, 4]}
    with pytest.raises(ExplorationError, match="walls of servers stay"):
        open_level(read({**LAB, "event": [event]}))


def test_late_robots_and_outages_on_the_grid(tmp_path: Path) -> None:
    """E-82: nobody hears a robot before it is switched on, nor while its radio is out."""
    events = [
        {"step": 5, "kind": "join", "robot": "R2"},
        {"step": 8, "kind": "outage", "steps": 4},
    ]
    tables: dict[str, object] = {"event": events, "radio": {"model": "circle"}}
    tables["team"] = {"robots": 2, "base": [3, 3], "speed": 2.0, "reach": 8, "radio": 60.0}
    with Run(
        small(tmp_path, "end.steps=14", "end.base=off", "end.home=false", tables=tables)
    ) as one:
        while one.step():
            pass
        history = one.result().history
    assert not history.works[:5, 2].any()
    assert history.works[5:].all()
    assert history.area[4, 2] == 0
    assert history.linked_base[:, 1].tolist() == [True] * 8 + [False] * 4 + [True] * 3
    assert history.linked_base[:, 2].tolist() == [False] * 5 + [True] * 3 + [False] * 4 + [True] * 3


def test_a_robot_that_dies_is_lost_and_the_others_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """E-82: its name is among the lost ones, and the end says so."""
    error = DeadError("BatteryEmpty")
    level = object.__new__(ServerLevel)
    with socket.create_server(("127.0.0.1", 0)) as there:
        level._address = there.getsockname()
        level.lost = []
        rover: Any = argparse.Namespace(
            body=argparse.Namespace(works=True),
            controller=argparse.Namespace(name="R1", close=lambda: None),
        )
        level._bury(rover, error)
    assert (rover.body.works, level.lost) == (False, ["R1"])
    level.time = 3.0
    with pytest.raises(ExplorationError, match=r"is gone after 3\.0 s: BatteryEmpty"):
        level._bury(rover, error)
