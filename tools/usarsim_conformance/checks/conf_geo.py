"""Which requests GETCONF and GETGEO answer (protocol reference 6.8)."""

from __future__ import annotations

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.recordings import items_of, standing
from usarsim_conformance.registry import ONCE, UNREAL, check
from usarsim_conformance.verdicts import Severity


@check("control.conf.robot", "GETCONF of the robot", source="protocol reference 6, no. 124")
async def conf_robot(case: Case) -> None:
    """`GETCONF {Type Robot}` gives exactly one line, with or without Name."""
    await _once(case, "GETCONF", "CONF")


@check("control.geo.robot", "GETGEO of the robot", source="protocol reference 6, no. 124")
async def geo_robot(case: Case) -> None:
    """`GETGEO {Type Robot}` gives exactly one line, with or without Name."""
    await _once(case, "GETGEO", "GEO")


async def _once(case: Case, command: str, head: str) -> None:
    robot = await case.spawn()
    for request in (f"{command} {{Type Robot}}", f"{command} {{Type Robot}} {{Name any}}"):
        lines = await robot.client.outcome(request)
        found = [line for line in lines if line.head == head and line.type != "Camera"]
        case.expect(len(found) == 1, f"{request} gave {len(found)} lines")


@check(
    "control.conf.every-item",
    "Every item that is streamed answers",
    source="protocol reference 6, no. 125",
    severity=Severity.MUST,
)
async def every_item(case: Case) -> None:
    """For every item that appears in SEN, MISSTA or ASTA, GETCONF and GETGEO with its Type and
    Name give a line: a missing reply blocks one client for ever."""
    recording = await standing(case)
    items = items_of(recording.streamed)
    if not items:
        case.skip("the robot streams no items")
    for type, name in items:
        for command in ("GETCONF", "GETGEO"):
            line = recording.replies[command, type, name]
            case.expect(line is not None, f"{command} {{Type {type}}} {{Name {name}}}: no reply")


@check(
    "control.conf.named-item", "A request by name gives that item", source="protocol reference 3.8"
)
async def named_item(case: Case) -> None:
    """The reply to a request with Name tells of the item of this name only."""
    recording = await standing(case)
    for (command, type, name), line in recording.replies.items():
        if not name or line is None or type == "Robot":
            continue
        names = [item["Name"] for item in line.items()]
        case.expect(names == [name], f"{command} of {type} {name} told of {names}: {line}")
        case.expect(line.type == type, f"{command} of {type} told of type {line.type}")


@check(
    "control.conf.by-type",
    "A request by type gives all items in a line",
    source="protocol reference 6, no. 127",
)
async def by_type(case: Case) -> None:
    """A request by type without Name gives one line with all items of the type."""
    recording = await standing(case)
    items = items_of(recording.streamed)
    if not items:
        case.skip("the robot streams no items")
    for type in {type for type, _ in items}:
        wanted = {name for one, name in items if one == type}
        for command in ("GETCONF", "GETGEO"):
            line = recording.replies[command, type, ""]
            case.expect(line is not None, f"{command} {{Type {type}}}: no reply")
            assert line is not None
            told = {item["Name"] for item in line.items()}
            case.expect(wanted <= told, f"{command} {{Type {type}}} lacks {wanted - told}: {line}")


@check(
    "control.conf.no-match",
    "Nothing matches, nothing is said",
    source="protocol reference 6, no. 126",
    dialects=UNREAL,
)
async def no_match(case: Case) -> None:
    """A request with unknown Type or Name gives no line."""
    robot = await case.spawn()
    await robot.client.listen(0.3)
    lines = await robot.client.outcome(
        "GETCONF {Type NoSuchType}",
        "GETGEO {Type NoSuchType}",
        "GETCONF {Type RangeScanner} {Name NoSuchName}",
        "GETGEO {Type RangeScanner} {Name NoSuchName}",
        "GETCONF",
        "GETGEO",
    )
    found = [line for line in lines if line.head in ("CONF", "GEO")]
    case.expect(not found, f"it was answered: {found[:1]}")


@check(
    "control.conf.canonical",
    "The type is spelled canonically",
    source="protocol reference 6, no. 128",
    severity=Severity.SHOULD,
)
async def canonical(case: Case) -> None:
    """The Type of a reply has the canonical spelling even if asked in lower case."""
    recording = await standing(case)
    types = sorted(recording.types() - {"Camera"})
    if not types:
        case.skip("the robot streams no items")
    robot = await case.spawn()
    line = await robot.client.ask(f"GETCONF {{Type {types[0].lower()}}}", "CONF {Type")
    case.expect(line.type == types[0], f"{line.type!r} instead of {types[0]!r}")


@check(
    "control.conf.both-names",
    "MisPkg and Actuator both answer",
    source="protocol reference 6, no. 141",
    dialects=UNREAL,
)
async def both_names(case: Case) -> None:
    """GETCONF of MisPkg and of Actuator are both answered for a robot with an arm."""
    robot = await case.spawn("arm")
    for type in ("MisPkg", "Actuator"):
        await robot.client.ask(f"GETCONF {{Type {type}}}", f"CONF {{Type {type}")


@check(
    "control.conf.next-line",
    "The CONF is the next line",
    source="protocol reference 6, no. 142",
    dialects=ONCE,
)
async def next_line(case: Case) -> None:
    """After INIT and `GETCONF {Type Actuator}` in one packet the next line after the greeting is
    the CONF: one client reads exactly one line."""
    arm = await case.class_for("arm")
    place = await case.place()
    client = await case.connect()
    await client.send(case.init(place, case.new_name(), arm), "GETCONF {Type Actuator}")
    line = await client.wait(lambda line: True, PATIENCE, "line")
    case.expect(line.head == "CONF" and line.type == "Actuator", f"the next line is {line}")
