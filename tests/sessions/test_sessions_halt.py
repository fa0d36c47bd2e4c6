"""A robot that is taken over comes to rest where it is, under power: wheels, joints, aircraft."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import pytest

from usarsim_server.testing import Rehearsal, RehearsedClient


@pytest.fixture
def stage() -> Iterator[Rehearsal]:
    """A plain floor."""
    with Rehearsal(world="empty", supervise="on", scene_port=0) as stage:
        yield stage


def join(stage: Rehearsal, kind: str, height: float) -> RehearsedClient:
    client = stage.connect()
    client.send(f"INIT {{ClassName USARBot.{kind}}} {{Name R}} {{Location 0,0,{-height}}}")
    stage.run(1.0)
    return client


def take(stage: Rehearsal) -> None:
    supervision = stage.assembly.supervision
    supervision.take(supervision.find("R", None), "Ada")
    stage.settle()


def test_wheels_stand(stage: Rehearsal) -> None:
    """It was driving, nobody says anything more: it stands within half a second."""
    client = join(stage, "P3AT_real", 0.3)
    client.send("DRIVE {Left 4} {Right 4}")
    stage.run(1.0)
    take(stage)
    stage.run(0.5)
    before = stage.robot_state("R").pose.position
    assert before[0] > 0.2
    stage.run(1.0)
    assert math.dist(before, stage.robot_state("R").pose.position) < 0.01


def flipper(client: RehearsedClient) -> float:
    """rad, by the newest status."""
    line = client.take("STA")[-1]
    found = re.search(r"\{FRFlipper ([-\d.]+)\}", line)
    assert found is not None, line
    return float(found[1])


def test_joints_keep_their_places(stage: Rehearsal) -> None:
    """A flipper halfway to where it was sent stays halfway."""
    client = join(stage, "Kenaf", 0.4)
    begun = flipper(client)
    client.send("MULTIDRIVE {FRFlipper 1.2}")
    stage.run(0.5)
    take(stage)
    stage.run(0.5)
    halfway = flipper(client)
    assert 0.1 < abs(halfway - begun) < 1.0
    stage.run(2.0)
    assert flipper(client) == pytest.approx(halfway, abs=0.05)


@pytest.mark.parametrize("kind", ["AirRobot", "ARDrone"])
def test_aircraft_hover(stage: Rehearsal, kind: str) -> None:
    """It was on its way up and ahead; taken over it stays in the air, and where it is."""
    client = join(stage, kind, 3.0)
    client.send(
        "DRIVE {AltitudeVelocity 1} {LinearVelocity 1} {LateralVelocity 0} "
        "{RotationalVelocity 0} {Normalized False}"
    )
    stage.run(1.0)
    take(stage)
    stage.run(1.5)
    before = stage.robot_state("R").pose.position
    assert before[2] > 3.0
    stage.run(2.0)
    assert math.dist(before, stage.robot_state("R").pose.position) < 0.05
