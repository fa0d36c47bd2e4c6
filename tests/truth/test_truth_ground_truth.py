"""Ground truth: who is told where, and between whom obstacles are counted."""

from __future__ import annotations

import re

import pytest

from usarsim_server.protocol.values import Vector
from usarsim_server.radio.obstacles import SceneryObstacles
from usarsim_server.radio.stations import Station
from usarsim_server.testing import Rehearsal
from usarsim_server.truth.ground_truth import GroundTruth

ROBOT = Station("Robot1", (1.0, -2.0, 0.5))
BASE = Station("base", (4.0, 0.0, 1.0), battery_empty=True)


class Counter:
    """Counts one obstacle per metre of the line's x, and remembers what it was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[Vector, Vector]] = []

    def count(self, start: Vector, end: Vector) -> int:
        """Any number will do."""
        self.asked.append((start, end))
        return round(abs(end[0] - start[0]))


class Town:
    """Stations that can come and go, and how often they were looked at."""

    def __init__(self, *stations: Station) -> None:
        self.stations = list(stations)
        self.looks = 0

    def __call__(self) -> list[Station]:
        self.looks += 1
        return self.stations


def truth(*stations: Station) -> tuple[GroundTruth, Town, Counter]:
    """Ground truth about some stations."""
    town, counter = Town(*stations), Counter()
    return GroundTruth(town, counter), town, counter


def test_positions_are_in_the_wire_frame_and_live() -> None:
    """48, 49, 51, 52, 64: everybody in order, y and z turned round, as they are at that moment."""
    ground_truth, town, _ = truth()
    assert ground_truth.answer("GETPOS") == "POSITIONS {Robots 0}"
    town.stations = [ROBOT, BASE]
    assert ground_truth.answer("getpos") == (
        "POSITIONS {Robots 2} {Name Robot1 Location 1.0000,2.0000,-0.5000 BatteryEmpty False} "
        "{Name base Location 4.0000,0.0000,-1.0000 BatteryEmpty True}"
    )
    town.stations = [BASE]
    assert "Robot1" not in (ground_truth.answer("GETPOS") or "")


def test_robots_are_found_in_any_case_and_echoed_as_sent() -> None:
    """56, 63: the counter gets their places, the client its own spelling back."""
    ground_truth, _, counter = truth(ROBOT, BASE)
    line = ground_truth.answer("GETOBS {From ROBOT1} {To Base}")
    assert line == "NUMOBS {From ROBOT1} {To Base} {ObstCount 3.0000}"
    assert counter.asked == [(ROBOT.position, BASE.position)]


@pytest.mark.parametrize("pair", ["{From Nobody} {To base}", "{From base} {To Nobody}"])
def test_nobody_is_at_an_unknown_distance(pair: str) -> None:
    """58: -1.0000, and nothing is counted."""
    ground_truth, _, counter = truth(ROBOT, BASE)
    assert ground_truth.answer(f"GETOBS {pair}") == f"NUMOBS {pair} {{ObstCount -1.0000}}"
    assert counter.asked == []


def test_points_are_counted_between_without_looking_at_robots() -> None:
    """59: echoed verbatim, turned into the simulation's frame; robots are not needed."""
    ground_truth, town, counter = truth(ROBOT)
    line = ground_truth.answer("GETOBS {Start 0,1,-2} {End 10.0,0,0}")
    assert line == "NUMOBS {Start 0,1,-2} {End 10.0,0,0} {ObstCount 10.0000}"
    assert counter.asked == [((0.0, -1.0, 2.0), (10.0, 0.0, 0.0))]
    assert town.looks == 0


def test_half_a_question_gets_an_empty_line_and_none_gets_nothing() -> None:
    """60, 61: an empty text is a reply, None is no reply."""
    ground_truth, _, _ = truth(ROBOT)
    assert ground_truth.answer("GETOBS {From Robot1}") == ""
    assert ground_truth.answer("GETALL") is None


def test_questions_that_come_together_are_about_one_moment() -> None:
    """54: many requests of one packet cost one look and keep their order."""
    ground_truth, town, _ = truth(ROBOT, BASE)
    lines = ["GETPOS", "WHAT", "GETOBS {From base} {To robot1}", "GETOBS", "GETPOS"]
    replies = ground_truth.answers(lines)
    assert [reply and reply.partition(" ")[0] for reply in replies] == [
        "POSITIONS",
        None,
        "NUMOBS",
        "",
        "POSITIONS",
    ]
    assert town.looks == 1


def test_two_robots_of_one_name_are_told_apart_by_order() -> None:
    """3.3: the lookup takes the first."""
    twin = Station("ROBOT1", (2.0, 0.0, 0.0))
    ground_truth, _, counter = truth(ROBOT, twin, BASE)
    ground_truth.answer("GETOBS {From base} {To robot1}")
    assert counter.asked == [(BASE.position, ROBOT.position)]


# -- the robots of a world -----------------------------------------------------------------------


def positions(stage: Rehearsal) -> str:
    """The answer to GETPOS."""
    simulation = stage.assembly.simulation
    answer = GroundTruth(stage.assembly.fleet.stations, SceneryObstacles(simulation)).answer(
        "GETPOS"
    )
    assert answer is not None
    return answer


def test_robots_of_a_world_are_stations_while_they_are_there() -> None:
    """51, 52: robots in the order of spawning, by the names of INIT; controllers and avatars of the
    world are none; who hangs up is gone."""
    with Rehearsal(world="empty") as stage:
        clients = [stage.connect() for _ in range(4)]
        clients[0].send("INIT {ClassName USARBot.P2DX} {Name beTa} {Location 1,2,-0.3}")
        clients[1].send("INIT {ClassName USARBot.P3AT} {Name Alpha} {Location -1,0,-0.3}")
        clients[2].send("INIT {ClassName USARBot.WorldController} {Name WC} {Location 0,0,0}")
        clients[3].send("INIT {ClassName USARAvatar.NewMale} {Name Adam} {Location 5,5,-1}")
        stage.run(1.0)
        line = positions(stage)
        assert re.fullmatch(
            r"POSITIONS \{Robots 2\} "
            r"\{Name beTa Location (0\.99|1\.00)\d\d,(1\.99|2\.00)\d\d,-0\.\d{4} "
            r"BatteryEmpty False\} "
            r"\{Name Alpha Location -(0\.99|1\.00)\d\d,-?0\.00\d\d,-0\.\d{4} BatteryEmpty False\}",
            line,
        )
        clients[0].close()
        stage.settle()
        assert positions(stage).startswith("POSITIONS {Robots 1} {Name Alpha ")


def test_an_empty_battery_shows_from_its_last_second_on() -> None:
    """64: True as soon as STA would print 0 seconds, robots without a battery never."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.P3AT} {Name Tired} {Location 1,2,-0.3} {Battery 3}")
        stage.run(1.5)
        assert "BatteryEmpty False" in positions(stage)
        stage.run(1.0)
        status = client.take("STA")[-1]
        assert "{Battery 0}" in status
        assert "BatteryEmpty True" in positions(stage)


def test_robots_move_in_ground_truth_as_they_move() -> None:
    """3.2: the place is that of the moment, not of the last report."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send(
            "INIT {ClassName USARBot.P3AT} {Name R} {Location 0,0,-0.3}", "DRIVE {Left 1} {Right 1}"
        )
        stage.run(0.5)
        first = positions(stage)
        stage.run(0.004)
        assert positions(stage) != first
