"""What the kit makes of how robots moved: legs of a trip by GroundTruth, and classes to try."""

from __future__ import annotations

import asyncio
import math
from types import SimpleNamespace

import pytest

from usarsim_conformance.checks.objects import _along
from usarsim_conformance.lines import Line
from usarsim_conformance.registry import Inconclusive, NotApplicable
from usarsim_conformance.trips import Leg, moments_of, near, of_classes


def _report(time: float, x: float, y: float, yaw: float, roll: float = 0.0) -> Line:
    text = (
        f"SEN {{Time {time:.4f}}} {{Type GroundTruth}} {{Name G}} {{Location {x:.4f},{y:.4f},0}}"
        f" {{Orientation {roll % math.tau:.4f},0.0000,{yaw % math.tau:.4f}}}\r\n"
    )
    return Line(text.encode())


def _leg(lines: list[Line]) -> Leg:
    return Leg("DRIVE {Left 1} {Right 1}", lines, moments_of(lines))


@pytest.mark.parametrize("first", [0.0, 0.05, 0.15])
def test_time_for_a_way(first: float) -> None:
    """From rest at 0.3 m/s2, 0.2 to 1 m take 1.43 s, whenever its reports come; how far it comes in
    the time of 15 reports differs by a tenth."""
    times = [first + step / 5.0 for step in range(15)]
    leg = _leg([_report(time, 0.15 * time**2, 0.0, 0.0) for time in times])
    assert leg.took(0.2, 1.0) == pytest.approx(1.43, rel=0.02)
    with pytest.raises(Inconclusive, match="on a straight way"):
        leg.took(0.2, leg.gone + 0.1)


def test_a_place_along_a_way() -> None:
    """What is passed of a way round a corner, and how far aside a place is."""
    way = [(0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (10.0, -1.0, 0.0)]
    assert _along(way, (4.0, 0.03, 0.0)) == pytest.approx((4.0, 0.03))
    assert _along(way, (10.0, -0.5, 0.0)) == pytest.approx((10.5, 0.0))
    assert _along(way, (10.0, -3.0, 0.0)) == pytest.approx((11.0, 2.0))


def test_speed_along_an_arc() -> None:
    """On a circle to the right of 2 m at 1 m/s yaw grows by 0.5 rad/s, also past a full turn."""
    lines = []
    for step in range(40):
        time = step / 10.0
        angle = 6.0 + 0.5 * time
        lines.append(_report(time, 2.0 * math.sin(angle), -2.0 * math.cos(angle), angle))
    leg = _leg(lines)
    assert leg.speed == pytest.approx(1.0, abs=0.01)
    assert leg.turning == pytest.approx(0.5, abs=0.001)
    ahead, right, down = leg.velocity
    assert ahead > 0.9
    assert abs(right) < 0.05
    assert down == 0.0


def test_directions_are_those_of_the_robot() -> None:
    """A robot that faces +y and moves to -x goes to its right; backwards speed is negative."""
    half = math.pi / 2.0
    leg = _leg([_report(step / 10.0, -0.1 * step, 0.0, half, roll=-0.2) for step in range(10)])
    assert leg.velocity == pytest.approx((0.0, 1.0, 0.0), abs=1e-3)
    assert leg.gone == pytest.approx(0.9, abs=1e-3)
    assert leg.roll == pytest.approx(-0.2, abs=1e-3)
    back = _leg([_report(step / 10.0, 0.0, -0.1 * step, half) for step in range(10)])
    assert back.speed == pytest.approx(-1.0, abs=1e-3)


def test_a_ramp_is_left_out() -> None:
    """Speeds are those of the later part, after a robot has sped up."""
    places = [0.5 * (step / 10.0) ** 2 if step < 10 else step / 10.0 - 0.5 for step in range(40)]
    leg = _leg([_report(step / 10.0, x, 0.0, 0.0) for step, x in enumerate(places)])
    assert leg.velocity[0] == pytest.approx(1.0, abs=0.01)
    assert leg.velocity_at_last(0.2)[0] == pytest.approx(1.0, abs=0.01)


def test_nothing_is_said_without_ground_truth() -> None:
    """A robot that does not tell where it is cannot be judged."""
    with pytest.raises(Inconclusive, match="no GroundTruth"):
        _ = _leg([]).velocity


def test_near_takes_the_larger_tolerance() -> None:
    """A share of the wanted number, or a least difference."""
    assert near(1.04, 1.0, 0.05)
    assert not near(1.06, 1.0, 0.05)
    assert near(0.009, 0.0, 0.05, 0.01)


def test_classes_that_are_missing_are_left_out() -> None:
    """Only if all are missing there is nothing to judge, and the reasons are told."""

    async def make(case: object, class_name: str) -> str:
        if class_name.startswith("No"):
            raise NotApplicable(f"no {class_name}")
        return class_name

    case = SimpleNamespace()
    assert asyncio.run(of_classes(case, ("NoCar", "Sedan"), make)) == ["Sedan"]  # type: ignore[arg-type]
    with pytest.raises(NotApplicable, match="no NoCar; no NoBus"):
        asyncio.run(of_classes(case, ("NoCar", "NoBus"), make))  # type: ignore[arg-type]


@pytest.mark.parametrize("first", [0.0, 0.013, 0.029, 0.044])
def test_rounded_places_do_not_change_a_speed(first: float) -> None:
    """Places to the centimetre five times a second, as the udk dialect has them: 0.211 m/s over
    the last second is right within 2 percent, whenever the first report comes."""
    places = [round(0.211 * (first + step / 5.0), 2) for step in range(13)]
    leg = _leg([_report(first + step / 5.0, x, 0.0, 0.0) for step, x in enumerate(places)])
    assert leg.velocity_at_last(0.45)[0] == pytest.approx(0.211, rel=0.02)
