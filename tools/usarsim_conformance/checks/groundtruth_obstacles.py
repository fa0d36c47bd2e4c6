"""What stands between robots: GETOBS (side channels reference 3.3)."""

from __future__ import annotations

import re

from usarsim_conformance.case import Case
from usarsim_conformance.lines import number
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Severity, checks_of
from usarsim_conformance.side_lines import LineClient, split_reply

truth = checks_of("groundtruth")

_COUNT = re.compile(r"\{ObstCount ([^{}]*)\}$")


async def _client(case: Case) -> LineClient:
    return await LineClient.open(case, "groundtruth")


def _point(place: Place) -> str:
    return ",".join(f"{value:.4f}" for value in place.location)


async def _count(case: Case, client: LineClient, segments: str) -> float:
    """Obstacles; fails unless the answer echoes the question and tells a number."""
    line = await client.ask(f"GETOBS {segments}")
    case.expect(
        line.startswith(f"NUMOBS {segments} {{ObstCount "),
        f"GETOBS {segments} is answered by {line!r}, not by NUMOBS {segments} {{ObstCount n}}",
    )
    found = _COUNT.search(line)
    count = number(found[1]) if found else float("nan")
    case.expect(count == count, f"ObstCount is not a number: {line!r}")
    return count


async def _known_place(case: Case) -> Place:
    place = await case.place()
    case.need(place.tag is None or any(place.location), "no start poses are known")
    return place


@truth("getobs.form", "The form of NUMOBS", "11.56, 3.3")
async def form(case: Case) -> None:
    """The reply echoes both names and tells the count, in three groups parted by single blanks;
    the strict splitter finds them all."""
    one, other = [await case.spawn() for _ in range(2)]
    line = await (await _client(case)).ask(f"GETOBS {{From {one.name}}} {{To {other.name}}}")
    kind, groups = split_reply(line)
    case.expect(kind == "NUMOBS", f"GETOBS is answered by {line!r}, not by NUMOBS")
    case.expect(
        groups[:2] == [{"From": one.name}, {"To": other.name}] and "ObstCount" in groups[-1],
        f"groups of NUMOBS are {groups}, not From {one.name}, To {other.name} and ObstCount: "
        f"{line!r}",
    )
    count = groups[2]["ObstCount"].partition(".")[0]
    case.expect(
        count.isdecimal(),
        f"ObstCount is {groups[2]['ObstCount']!r}, not a number above or equal to 0",
    )


@truth("getobs.digits", "Counts are floats in text", "11.56, 3.3", Severity.SHOULD)
async def digits(case: Case) -> None:
    """ObstCount is a whole number with four decimals, as the engine prints floats."""
    place = await _known_place(case)
    segments = f"{{Start {_point(place)}}} {{End {_point(place.moved(down=20.0))}}}"
    line = await (await _client(case)).ask(f"GETOBS {segments}")
    found = _COUNT.search(line)
    case.expect(
        found and re.fullmatch(r"-?\d+\.0000", found[1]),
        f"ObstCount is {found and found[1]!r}, not a whole number with four zeros behind the "
        f"point: {line!r}",
    )


@truth("getobs.unknown-robot", "An unknown robot gives minus one", "11.58, 3.3")
async def unknown_robot(case: Case) -> None:
    """If one or both robots do not exist the count is -1.0000."""
    robot = await case.spawn()
    client = await _client(case)
    for segments in (
        f"{{From {robot.name}}} {{To Nobody?}}",
        f"{{From Nobody?}} {{To {robot.name}}}",
        "{From Nobody?} {To Nobody?}",
    ):
        await client.expect(f"GETOBS {segments}", f"NUMOBS {segments} {{ObstCount -1.0000}}")


@truth("getobs.any-case", "Robots are found in any case", "11.63, 3.3")
async def any_case(case: Case) -> None:
    """Names are looked up without regard to case, and echoed as they were sent."""
    one, other = [await case.spawn() for _ in range(2)]
    segments = f"{{From {one.name.upper()}}} {{To {other.name.lower()}}}"
    count = await _count(case, await _client(case), segments)
    case.expect(count >= 0.0, f"ObstCount is {count:g} for names in another case, not 0 at least")


@truth("getobs.keys", "Keys in any case, blanks optional", "3.1", Severity.SHOULD)
async def keys(case: Case) -> None:
    """Argument names may be in any case, and blanks between groups may be left out."""
    one, other = [await case.spawn() for _ in range(2)]
    client = await _client(case)
    wanted = await client.ask(f"GETOBS {{From {one.name}}} {{To {other.name}}}")
    for text in (
        f"getobs {{fROM {one.name}}} {{tO {other.name}}}",
        f"GETOBS{{From {one.name}}}{{To {other.name}}}",
        f"GETOBS {{To {other.name}}} {{From {one.name}}}",
        f"GETOBS {{From {one.name}}} {{From Nobody}} {{To {other.name}}}",
    ):
        await client.expect(text, wanted)


@truth("getobs.echo", "Points are echoed as sent", "11.59, 3.3")
async def echo(case: Case) -> None:
    """The form with Start and End echoes the texts of both points, digit by digit."""
    client = await _client(case)
    for segments in (
        "{Start 0,0,0} {End 10,0,0}",
        "{Start 1.50,-2,+3.000} {End 1e1,0.10000001,-0}",
    ):
        await _count(case, client, segments)


@truth("getobs.missing", "Missing arguments give an empty line", "11.60, 3.3")
async def missing(case: Case) -> None:
    """A GETOBS without a complete pair of robots or points is answered by an empty line."""
    client = await _client(case)
    for segments in ("", " {From A}", " {To A}", " {Start 0,0,0}", " {From A} {End 0,0,0}"):
        await client.expect(f"GETOBS{segments}", "")


@truth("getobs.precedence", "Robots come before points", "3.3", Severity.SHOULD)
async def precedence(case: Case) -> None:
    """With both pairs the robots count; with one robot only, the points are used."""
    client = await _client(case)
    points = "{Start 0,0,0} {End 0,0,0.001}"
    line = await client.ask(f"GETOBS {points} {{From A?}} {{To B?}}")
    case.expect(
        line == "NUMOBS {From A?} {To B?} {ObstCount -1.0000}",
        f"GETOBS with unknown robots and points is answered by {line!r}, not by NUMOBS of the "
        "robots with ObstCount -1.0000",
    )
    line = await client.ask(f"GETOBS {points} {{From A?}}")
    case.expect(
        line.startswith(f"NUMOBS {points} {{ObstCount "),
        f"GETOBS with one robot and two points is answered by {line!r}, not by NUMOBS {points}",
    )


@truth("getobs.free-air", "Nothing stands in free air", "11.56, 3.3")
async def free_air(case: Case) -> None:
    """Over a short way in the air above a start pose there is no obstacle."""
    place = await _known_place(case)
    up, higher = place.moved(down=-0.6), place.moved(down=-0.9)
    count = await _count(
        case, await _client(case), f"{{Start {_point(up)}}} {{End {_point(higher)}}}"
    )
    case.expect(count == 0.0, f"ObstCount is {count:g} obstacles in free air, not 0")


@truth("getobs.ground", "The ground is an obstacle", "3.3", Severity.SHOULD)
async def ground(case: Case) -> None:
    """From above a start pose to far below the ground stands in the way."""
    place = await _known_place(case)
    low = place.moved(down=30.0)
    up = place.moved(down=-0.3)
    count = await _count(case, await _client(case), f"{{Start {_point(up)}}} {{End {_point(low)}}}")
    case.expect(
        count >= 1.0,
        f"ObstCount is {count:g} obstacles on a way through the ground, not 1 at least",
    )


@truth("getobs.bodies", "Robots are no obstacles", "11.57, 3.3")
async def bodies(case: Case) -> None:
    """A robot that stands between two points does not raise the count."""
    place = await _known_place(case)
    client = await _client(case)
    left, right = place.moved(right=-0.7), place.moved(right=0.7)
    robot = await case.spawn(place=place)
    await robot.run(0.5)
    height = (await robot.pose()).location[2] - place.location[2]
    ends = [_point(end.moved(down=height)) for end in (left, right)]
    segments = f"{{Start {ends[0]}}} {{End {ends[1]}}}"
    with_robot = await _count(case, client, segments)
    robot.close()
    await (await case.spawn()).run(1.5)
    without = await _count(case, client, segments)
    case.expect(
        with_robot == without,
        f"ObstCount is {with_robot:g} with a robot between, not {without:g} as without",
    )


@truth("getobs.symmetric", "The way back is as long", "3.3", Severity.INFORMATIVE)
async def symmetric(case: Case) -> None:
    """As many obstacles stand between A and B as between B and A."""
    one, other = [await case.spawn() for _ in range(2)]
    client = await _client(case)
    there = await _count(case, client, f"{{From {one.name}}} {{To {other.name}}}")
    back = await _count(case, client, f"{{From {other.name}}} {{To {one.name}}}")
    case.expect(there == back, f"ObstCount is {there:g} there, {back:g} back, not the same")


@truth("getobs.nonsense", "Survives points that are none", "3.3", Severity.SHOULD)
async def nonsense(case: Case) -> None:
    """Points that are no numbers, not finite or far away get one line each, and do no harm."""
    client = await _client(case)
    for point in ("a,b,c", "1,2", "nan,inf,-inf", "1e300,1e300,1e300", ",,,,"):
        await client.ask(f"GETOBS {{Start {point}}} {{End 0,0,0}}")
    line = await client.ask("GETPOS")
    case.expect(
        line.startswith("POSITIONS {Robots "),
        f"GETPOS after points that are no numbers is answered by {line[:80]!r}, not by POSITIONS",
    )
