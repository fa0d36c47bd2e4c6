"""Zoom of cameras against the limits that CONF tells (robots reference 2.7)."""

from __future__ import annotations

import math

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.registry import UNREAL, check

_KEYS = ("CameraDefFov", "CameraMinFov", "CameraMaxFov", "CameraFov")


async def _lens(case: Case, robot: Robot) -> tuple[str, list[float]]:
    """Name of the first camera, and default, least, largest and present angle of view, rad."""
    await robot.client.send("GETCONF {Type Camera}", "GETSTARTPOSES")
    line = await robot.client.maybe(
        lambda line: line.head == "CONF" or (line.head == "NFO" and "StartPoses" in line.names)
    )
    if line is None or line.head == "NFO":
        case.skip("the robot has no camera")
    assert line is not None
    unit = math.degrees(1.0) if case.dialect == "udk" else 1.0
    return line.items()[0]["Name"], [line.number(key) / unit for key in _KEYS]


@check(
    "control.values.camera-zoom",
    "Zoom sets the angle of view",
    source="robots reference 2.7; protocol reference 4.8",
    dialects=UNREAL,
)
async def camera_zoom(case: Case) -> None:
    """A Zoom, in rad, becomes CameraFov of CONF, but for CameraMinFov and CameraMaxFov, which it
    stops at; 0 is CameraDefFov again."""
    robot = await case.spawn()
    name, (usual, least, most, now) = await _lens(case, robot)
    case.expect(least <= usual <= most, f"CameraDefFov {usual:g} is not in {least:g} to {most:g}")
    case.expect(abs(now - usual) < 2e-3, f"CameraFov is {now:g} at first, CameraDefFov {usual:g}")
    between = 0.6 * least + 0.4 * most
    for zoom, wanted in ((between, between), (0.5 * least, least), (1.2 * most, most), (0, usual)):
        await robot.send(
            f"SET {{Type Camera}} {{Name {name}}} {{Opcode Zoom}} {{Params {zoom:.4f}}}"
        )
        await robot.run(0.3)
        _, (*_, found) = await _lens(case, robot)
        case.expect(
            abs(found - wanted) < (0.01 if case.dialect == "udk" else 3e-3),
            f"CameraFov is {found:.4f} rad after a Zoom of {zoom:.4f}, not {wanted:.4f}",
        )
