"""Touch pads and bumpers against a wall that comes nearer (robots reference 2.8)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.excursions import (
    Equipment,
    Track,
    bearer,
    equipment,
    open_floor,
    spawn_far,
)
from usarsim_conformance.registry import UNREAL, check
from usarsim_conformance.walls import Builder, controller, settled

_GAPS = (50, 35, 27, 22, 17, 12, 9, 7, 5, 3, 2, 1, 0, -2)
"""mm between a pad and the wall."""
_SIDES = (25, 15, 10, 8, 6, 4, 2, 0, -4)
"""mm from a pad's middle to the edge of a wall before it."""
_INEXACT = 0.004
"""m by which a robot may stand beside the place of its INIT."""


@dataclass(frozen=True)
class _Approach:
    """What a pad said of a wall.

    Attributes:
        name: of the pad.
        ahead: gaps, m, with whether it was touched then.
        beside: distances of the edge, m, likewise, with a wall close before the pad.
    """

    name: str
    ahead: list[tuple[float, bool]]
    beside: list[tuple[float, bool]]


async def _approach(case: Case, type: str) -> tuple[Equipment, _Approach]:
    class_name = await bearer(case, type, "GroundTruth")
    worn = await equipment(case, class_name)

    async def come(case: Case) -> _Approach:
        client = await controller(case)
        base = open_floor(case)
        robot = await spawn_far(case, class_name, base)
        height = (await robot.pose()).location[2]
        builder = Builder(case, client, base, height)
        fronts = [
            (name, mount)
            for name, mount in worn.on_body(type).items()
            if mount.location[0] > 0.0 and max(map(abs, mount.orientation)) < 0.1
        ]
        if not fronts:
            case.skip(f"no {type} looks ahead")
        name, mount = fronts[0]
        x, y, z = mount.location
        x += float(worn.configured(type)[name].get("ArcRadius") or 0.0)

        async def look(distance: float, aside: float) -> bool:
            await builder.put(0.0, distance, 0.8, aside=aside, high=1.0 + z + 0.06)
            return await _touched(robot, type, name)

        ahead = [(gap / 1000.0, await look(x + gap / 1000.0, y)) for gap in _GAPS]
        await builder.clear()
        beside = []
        if not worn.configured(type)[name].get("ArcRadius"):
            for side in _SIDES:
                # The wall is to the right of its edge.
                aside = y + side / 1000.0 + 0.4
                beside.append((side / 1000.0, await look(x + 0.001, aside)))
        return _Approach(name, ahead, beside)

    return worn, await case.shared(f"{class_name} whose {type} a wall approaches", come)


async def _touched(robot: Robot, type: str, name: str) -> bool:
    begun = await settled(robot)
    found = False
    for _, line in Track(await robot.run(0.5)).between(begun, math.inf).of(type):
        if line.head == "SEN":
            for item in line.items():
                if item.get("Name") == name:
                    found = item.get("Touch") == "True"
    return found


def _judge_reach(case: Case, found: _Approach, least: float, most: float) -> None:
    touched = [gap for gap, touch in found.ahead if touch]
    case.expect(touched, f"Touch of {found.name} is never True before a wall that comes to it")
    first = max(touched)
    case.expect(
        first <= most + _INEXACT,
        f"Touch of {found.name} is True {1000 * first:.0f} mm before a wall: it should reach "
        f"{1000 * most:.0f} mm",
    )
    for gap, touch in found.ahead:
        case.expect(
            touch or gap > least - _INEXACT,
            f"Touch of {found.name} is False {1000 * gap:.0f} mm before a wall: it should reach "
            f"{1000 * least:.0f} mm",
        )


@check(
    "control.values.touch-reach",
    "A touch pad feels what is close",
    source="robots reference 2.8",
    dialects=UNREAL,
)
async def touch_reach(case: Case) -> None:
    """Touch is False while a wall is a centimetre before the pad, and True from a few millimetres
    on."""
    _, found = await _approach(case, "Touch")
    _judge_reach(case, found, 0.0, 0.005)


@check(
    "control.values.touch-diameter",
    "A touch pad is as large as it says",
    source="robots reference 2.8",
    dialects=UNREAL,
)
async def touch_diameter(case: Case) -> None:
    """A wall close before a pad is felt where its edge is nearer to the middle of the pad than half
    of Diameter of CONF, and not beside it."""
    worn, found = await _approach(case, "Touch")
    told = worn.configured("Touch")[found.name].get("Diameter")
    if told is None or not found.beside:
        case.skip("CONF tells no Diameter")
    assert told is not None
    half = float(told) / 2.0
    for edge, touch in found.beside:
        if edge > half + _INEXACT:
            case.expect(
                not touch, f"Touch is True {1000 * edge:.0f} mm beside a wall, Diameter {told} m"
            )
        if edge < half - _INEXACT:
            case.expect(
                touch, f"Touch is False, the edge at {1000 * edge:.0f} mm, Diameter {told} m"
            )


@check(
    "control.values.bumper-reach",
    "A bumper feels what is close",
    source="robots reference 2.8",
    dialects=UNREAL,
)
async def bumper_reach(case: Case) -> None:
    """Touch of a TouchArray is True from 2 cm before its arc on, ArcRadius of CONF from its
    mount."""
    _, found = await _approach(case, "TouchArray")
    _judge_reach(case, found, 0.017, 0.022)
