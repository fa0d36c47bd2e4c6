"""The mixed team: every robot is told what its kind understands."""

from __future__ import annotations

import random

import numpy as np
import pytest
from bench_fakes import FakeServer, StandIn

from usarsim_bench import team
from usarsim_bench import team as garage
from usarsim_bench.crowd import Crowd
from usarsim_bench.figures import Plan
from usarsim_bench.server import Load
from usarsim_bench.team import MIXED, measure_garage, roam
from usarsim_server.robots.catalog import load_roster
from usarsim_server.testing import Rehearsal

KINDS = {"skid_steer", "differential", "tracked", "ackerman", "omni", "aerial", "legged", "static"}


def test_the_team_is_mixed() -> None:
    """Sixteen shipped classes of all kinds that a land world has room for, some with arms."""
    roster = load_roster()
    robots = [roster.find(name) for name in MIXED]
    assert len(robots) == team.ROBOTS
    assert {robot.kind for robot in robots if robot is not None} == KINDS
    assert sum(any(one.package for one in robot.actuators) for robot in robots if robot) >= 3


@pytest.mark.parametrize("name", MIXED)
def test_commands_move_the_robot(name: str) -> None:
    """What the measurement sends is obeyed: wheels, rotors, legs, flippers or arms move."""
    dice = random.Random(1)
    with Rehearsal(world="empty", max_robots=1) as rehearsal:
        client = rehearsal.connect()
        client.send(f"INIT {{ClassName USARBot.{name}}} {{Location 0,0,-1.0}}")
        rehearsal.run(1.5)
        (vehicle,) = rehearsal.assembly.fleet.vehicles
        before = vehicle.look()
        assert before is not None
        for _ in range(3):
            client.send(MIXED[name](dice))
            rehearsal.run(0.3)
        after = vehicle.look()
        assert after is not None
        moved = np.abs(after.snapshot.qpos - before.snapshot.qpos).max()
    assert moved > 0.02


def test_classes_join_in_turn_and_are_told_their_own_words(monkeypatch: pytest.MonkeyPatch) -> None:
    """More robots than classes begin anew; the words go to the robots of the class."""
    monkeypatch.setattr(team, "SETTLE", 1.5)
    monkeypatch.setattr(team, "WINDOW", 0.3)
    with FakeServer() as server, Crowd(server.port, 0, roam) as crowd:
        classes = ("Lisa", "KUKA_LWR_BOT", "Unknown")
        team.try_team(StandIn(), crowd, 4, 0.6, classes)  # type: ignore[arg-type]
        inits = server.commands("INIT")
        told = server.commands("DRIVE") + server.commands("MISPKG")
    assert [line.split("USARBot.")[1].split("}")[0] for line in inits] == [*classes, "Lisa"]
    assert any("WheelNumber" in line for line in told)
    assert any(line.startswith("MISPKG {Name kuka_lwr}") for line in told)
    assert any("{Left " in line for line in told), "strangers are told what most understand"


def test_it_is_a_measurement_with_aims(monkeypatch: pytest.MonkeyPatch) -> None:
    """`bench garage` asks for real time with the mixed classes, and reports against aims."""
    asked: list[object] = []

    def fake(
        server: object, crowd: Crowd, robots: int, seconds: float, classes: tuple[str, ...]
    ) -> team.TeamTrial:
        asked.append((robots, seconds, classes))
        load = Load(process=0.5, own=0.1, others=0.0)
        return team.TeamTrial(robots, 0.9995, 0.99, load, 10.0, 1e3, 2**20, 0.0, 1.0)

    class Server(StandIn):
        port = 0

        def __init__(self, world: str, robots: int) -> None:
            super().__init__()

        def __enter__(self) -> Server:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    class Nobody:
        def __init__(self, *_: object) -> None:
            pass

        def __enter__(self) -> Nobody:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr(garage, "try_team", fake)
    monkeypatch.setattr(garage, "Server", Server)
    monkeypatch.setattr(garage, "Crowd", Nobody)
    section = measure_garage(Plan(seconds=5.0))
    assert asked == [(16, 5.0, tuple(MIXED))]
    assert section.key == "garage"
    assert section.figures[0].value == 0.9995
    assert section.figures[0].met
