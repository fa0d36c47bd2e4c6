"""What GEO tells (protocol reference 6.8)."""

from __future__ import annotations

import re

from usarsim_conformance.case import Case
from usarsim_conformance.places import Place
from usarsim_conformance.recordings import ground_told, standing, told
from usarsim_conformance.registry import Severity, udk, unreal, ut2004

_N4 = r"-?\d+\.\d{4}"


_V4 = rf"{_N4},{_N4},{_N4}"


@unreal("geo.ground", "GEO of ground vehicles", "6, no. 129")
async def geo_ground(case: Case) -> None:
    """A ground vehicle's GEO has Type, Name, Dimensions, COG, WheelRadius, WheelSeparation,
    WheelBase in this order."""
    line = await ground_told(case, "GETGEO")
    names = ("Type", "Name", "Dimensions", "COG", "WheelRadius", "WheelSeparation", "WheelBase")
    case.expect_names(line, names)


@unreal("geo.numbers", "Numbers of GEO", "2.2", Severity.SHOULD)
async def geo_numbers(case: Case) -> None:
    """Numbers and vectors of the robot's GEO have four digits, and wheels a size."""
    line = await ground_told(case, "GETGEO")
    for name in ("Dimensions", "COG"):
        case.expect(
            re.fullmatch(_V4, line.get(name) or ""),
            f"{name} is {line.get(name)!r}, not three numbers with four digits: {line}",
        )
    for name in ("WheelRadius", "WheelSeparation", "WheelBase"):
        case.expect(
            re.fullmatch(_N4, line.get(name) or ""),
            f"{name} is {line.get(name)!r}, not a number with four digits: {line}",
        )
        case.expect(line.number(name) > 0.0, f"{name} is {line.get(name)}, not above 0: {line}")


@ut2004("geo.sensors-ut2004", "GEO of sensors in pairs", "6, no. 134")
async def geo_pairs(case: Case) -> None:
    """In ut2004 the GEO of sensors has one segment per item: `{Name n Location v Orientation v
    Mount m}`; one client crashes on any other form."""
    recording = await standing(case)
    sensors = recording.types() | {"Camera"}
    form = re.compile(
        rf"GEO \{{Type \w+\}}"
        rf"( \{{Name [^ {{}}]+ Location {_V4} Orientation {_V4} Mount [^{{}}]+\}})+"
    )
    asked = 0
    for (command, type, _), line in recording.replies.items():
        if command != "GETGEO" or line is None or type not in sensors:
            continue
        asked += 1
        case.expect(
            form.fullmatch(line.text),
            "GEO has another form, not {Name n Location v Orientation v Mount m} for each "
            f"item: {line}",
        )
    if not asked:
        case.skip("no sensor answered GETGEO")


@udk("geo.sensors-udk", "GEO of sensors in segments", "6, no. 134")
async def geo_segments(case: Case) -> None:
    """In udk the GEO of sensors has separate segments in the order Name, Location, Orientation,
    Mount."""
    recording = await standing(case)
    sensors = recording.types() | {"Camera"}
    asked = 0
    for (command, type, _), line in recording.replies.items():
        if command != "GETGEO" or line is None or type not in sensors:
            continue
        asked += 1
        names = tuple(name for name in line.names[1:] if name != "MountLink")
        groups = len(names) // 4
        case.expect_names(line, ("Name", "Location", "Orientation", "Mount") * groups, names)
        case.expect(
            all(" " not in v for n, v in line.segments if n == "Name"),
            f"Name holds pairs, not a name alone: {line}",
        )
    if not asked:
        case.skip("no sensor answered GETGEO")


@unreal("geo.body-frame", "Mounts are told in the body frame", "6, no. 135")
async def body_frame(case: Case) -> None:
    """Mount poses are in the body frame whatever the yaw of the robot."""
    recording = await standing(case)
    types = sorted(recording.types() - {"Camera"})
    if not types:
        case.skip("the robot streams no items")
    type = "RangeScanner" if "RangeScanner" in types else types[0]
    place = await case.place()
    case.need(place.tag is None or any(place.location), "the server lists no start poses")
    turned = Place(None, place.location, (0.0, 0.0, place.rotation[2] + 1.5708))
    robot = await case.spawn(place=turned)
    line = await robot.client.ask(f"GETGEO {{Type {type}}}", "GEO {Type")
    before = await told(case, "GETGEO", type)
    case.expect(
        line.text == before.text,
        f"GEO of a robot that is turned by 90 degrees is {line}, not {before}, as of one that is "
        "not",
    )


@unreal("geo.actuator", "GEO of Actuator and MisPkg", "6, no. 140")
async def geo_actuator(case: Case) -> None:
    """In udk GEO of an Actuator has Parent 0 for the base; in ut2004 GEO of a MisPkg has
    ParentLink -1."""
    robot = await case.spawn("arm")
    type, name, base = (
        ("Actuator", "Parent", "0") if case.dialect == "udk" else ("MisPkg", "ParentLink", "-1")
    )
    line = await robot.client.ask(f"GETGEO {{Type {type}}}", f"GEO {{Type {type}")
    case.expect(
        line.get(name) == base, f"{name} of the first link is {line.get(name)}, not {base}: {line}"
    )
