"""Start poses and path nodes (protocol reference 6.5)."""

from __future__ import annotations

import math
import re

from usarsim_conformance.case import Case
from usarsim_conformance.places import Place
from usarsim_conformance.registry import ONCE, UDK, UNREAL, check
from usarsim_conformance.verdicts import Severity


@check(
    "control.init.start", "Spawns at a start position", source="protocol reference 6, no. 76 and 83"
)
async def start(case: Case) -> None:
    """INIT with Start of a listed tag spawns at the pose listed for it, whatever the case of the
    tag and whether or not a Location is given, too."""
    place = await case.place()
    case.need(place.tag is not None and any(place.location), "the server lists no start poses")
    tag = (place.tag or "").swapcase()
    init = case.init(Place(tag), case.new_name(), extra=" {Location 0.5,0.5,-3}")
    robot = await case.spawn(place=place, init=init)
    pose = await robot.pose()
    away = math.dist(pose.location[:2], place.location[:2])
    case.expect(away < 0.1, f"Start {tag} led to {pose.location} instead of {place.location}")


@check(
    "control.init.unknown-start",
    "An unknown Start spawns anyway",
    source="protocol reference 6, no. 77",
    dialects=ONCE,
    exclusive=True,
)
async def unknown_start(case: Case) -> None:
    """INIT with an unknown Start still spawns the robot."""
    await case.appears(case.init(Place("NoSuchStart"), case.new_name()))


@check(
    "control.init.start-poses",
    "GETSTARTPOSES before and after INIT",
    source="protocol reference 6, no. 80",
    dialects=ONCE,
)
async def start_poses(case: Case) -> None:
    """GETSTARTPOSES is answered before INIT and after it."""
    client = await case.connect()
    case.expect(await client.is_alive(), "no answer before INIT")
    robot = await case.spawn(client=client)
    case.expect(await robot.client.is_alive(), "no answer after INIT")


@check(
    "control.init.start-poses-count",
    "StartPoses counts what follows",
    source="protocol reference 6, no. 81",
    dialects=ONCE,
)
async def start_poses_count(case: Case) -> None:
    """The reply to GETSTARTPOSES begins `NFO {StartPoses n}` and n groups follow; with n = 0 no
    second segment exists."""
    line = await (await case.connect()).ask("GETSTARTPOSES", "NFO {StartPoses")
    count = line.get("StartPoses") or ""
    case.expect(re.fullmatch(r"\d+", count), f"StartPoses is {count!r}")
    words = " ".join(f"{name} {value}" for name, value in line.segments[1:]).split()
    case.expect(len(words) == 3 * int(count), f"{count} poses are announced: {line}")


@check(
    "control.init.start-poses-form",
    "Start poses in the flat form",
    source="protocol reference 6, no. 82",
    dialects=UNREAL,
)
async def start_poses_form(case: Case) -> None:
    """The second segment holds groups `tag x,y,z r,p,y`, all separated by single blanks."""
    line = await (await case.connect()).ask("GETSTARTPOSES", "NFO {StartPoses")
    number = r"-?\d+(\.\d+)?"
    vector = rf"{number},{number},{number}"
    group = rf"[^ {{}}]+ {vector} {vector}"
    pattern = rf"NFO \{{StartPoses \d+\}}( \{{{group}( {group})*\}})?"
    case.expect(re.fullmatch(pattern, line.text), f"another form: {line}")


@check(
    "control.init.path-nodes",
    "GETPATHNODES lists path nodes",
    source="protocol reference 6, no. 84",
    dialects=UDK,
    severity=Severity.SHOULD,
)
async def path_nodes(case: Case) -> None:
    """GETPATHNODES is answered by `NFO {PathNodes n}` with n groups in a second segment."""
    line = await (await case.connect()).ask("GETPATHNODES", "NFO {PathNodes")
    count = line.get("PathNodes") or ""
    case.expect(re.fullmatch(r"\d+", count), f"PathNodes is {count!r}")
    words = " ".join(f"{name} {value}" for name, value in line.segments[1:]).split()
    case.expect(len(words) == 3 * int(count), f"{count} nodes are announced: {line}")


@check(
    "control.init.closest-node",
    "GETCLOSESTPATHNODE needs a Location",
    source="protocol reference 6, no. 84",
    dialects=UDK,
    severity=Severity.SHOULD,
)
async def closest_node(case: Case) -> None:
    """GETCLOSESTPATHNODE without Location is not answered."""
    client = await case.connect()
    lines = await client.outcome("GETCLOSESTPATHNODE")
    case.expect(not lines, f"it was answered: {lines[:1]}")
