"""USARTruth, the poses for scoring tools (side channels reference 6, 7)."""

from __future__ import annotations

import asyncio
import math
import re

from usarsim_conformance import side_lines
from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.lines import numbers
from usarsim_conformance.registry import Severity, checks_of
from usarsim_conformance.side_lines import LineClient, split_reply
from usarsim_conformance.stage import facts, need_stage, spot
from usarsim_conformance.visits import people

truth = checks_of("truth")

_QUIET = 0.5
_TWO = r"-?\d+\.\d\d"
_FORM = re.compile(
    r"\{Name ([^{} ]+)\} \{Class ([^{} ]+)\} \{Time (\d+\.\d{4})\} "
    rf"\{{Location ({_TWO},{_TWO},{_TWO})\}} \{{Rotation ({_TWO},{_TWO},{_TWO})\}}"
)
_MOST_LINES = 10_000


async def _client(case: Case) -> LineClient:
    return await LineClient.open(case, "truth")


async def _rest(case: Case, client: LineClient) -> list[str]:
    """Lines up to the end marker, without it."""
    lines: list[str] = []
    while (line := await client.line()) != "{End}":
        lines.append(line)
        case.expect(
            len(lines) < _MOST_LINES, f"a listing has {_MOST_LINES} lines and more, but no {{End}}"
        )
    return lines


async def _ask(case: Case, client: LineClient, query: str = "") -> list[str]:
    await client.send(query)
    return await _rest(case, client)


def _name(line: str) -> str:
    found = _FORM.match(line)
    return found[1] if found else ""


async def _own(case: Case, client: LineClient, robot: Robot) -> re.Match[str]:
    """The line of a robot: that of its class nearest to where it says it is."""
    where = (await robot.pose()).location
    found = [match for line in await _ask(case, client) if (match := _FORM.match(line))]
    mine = [match for match in found if match[2] == robot.class_name]
    case.expect(mine, f"{robot.class_name} is missing among the classes that are listed")
    nearest = min(mine, key=lambda match: math.dist(numbers(match[4]), where))
    off = math.dist(numbers(nearest[4]), where)
    case.expect(
        off < 0.5,
        f"Location of the nearest {robot.class_name} is {off:.2f} m off the robot, not less than "
        "0.5 m",
    )
    return nearest


@truth("connect.silent", "Says nothing before it is asked", "6.1")
async def silent(case: Case) -> None:
    """Nothing is sent on connect."""
    await (await _client(case)).silent(1.0, "connecting")


@truth("query.empty-line", "An empty line lists all pawns", "11.88, 6.1")
async def empty_line(case: Case) -> None:
    """An empty line is the default query: all robots and victims, then the end marker."""
    robot = await case.spawn()
    client = await _client(case)
    await _own(case, client, robot)
    await client.silent(_QUIET, "one listing for one empty line")


@truth("query.actors", "Anything else is the default query", "11.89, 6.1")
async def actors(case: Case) -> None:
    """`{Actors}` and whatever is not understood list the same actors as an empty line."""
    robot = await case.spawn()
    client = await _client(case)
    mine = (await _own(case, client, robot))[1]
    for query in ("{Actors}", "hello", "{Actor}", "{}"):
        found = [_name(line) for line in await _ask(case, client, query)]
        case.expect(mine in found, f"{mine} is missing in the listing of {query!r}")


@truth("query.class", "Queries by class", "11.90, 6.1")
async def by_class(case: Case) -> None:
    """`{class Package.Class}` lists actors of that class only."""
    robot = await case.spawn()
    client = await _client(case)
    mine = (await _own(case, client, robot))[1]
    lines = await _ask(case, client, f"{{class USARBot.{robot.class_name}}}")
    case.expect(
        mine in [_name(line) for line in lines],
        f"{mine} is missing in the listing of its class: {lines}",
    )
    others = [line for line in lines if f"{{Class {robot.class_name}}}" not in line]
    case.expect(not others, f"the listing of a class has others, not only that: {others}")


@truth("query.unknown-class", "An unknown class lists nothing", "11.90, 6.1")
async def unknown_class(case: Case) -> None:
    """A class that does not exist gives only the end marker."""
    await case.spawn()
    lines = await _ask(case, await _client(case), "{class USARBot.NoSuchRobot}")
    case.expect(not lines, f"a class that does not exist lists {lines[:3]}, not nothing")


@truth("query.name", "Queries by name", "11.91, 6.1")
async def by_name(case: Case) -> None:
    """`{name n}` lists the one actor of that name, with class or without."""
    robot = await case.spawn()
    client = await _client(case)
    mine = (await _own(case, client, robot))[1]
    for query in (f"{{name {mine}}}", f"{{class USARBot.{robot.class_name}}} {{name {mine}}}"):
        names = [_name(line) for line in await _ask(case, client, query)]
        case.expect(names == [mine], f"{query} lists {names}, not {mine} alone")


@truth("query.keys", "Keys in any case, names in one", "11.91, 6.1")
async def keys(case: Case) -> None:
    """Keys may be in any letter case; the value of a name must be exact."""
    robot = await case.spawn()
    client = await _client(case)
    mine = (await _own(case, client, robot))[1]
    names = [_name(line) for line in await _ask(case, client, f"{{NAME {mine}}}")]
    case.expect(names == [mine], f"the key NAME lists {names}, not {mine} alone")
    lines = await _ask(case, client, f"{{name {mine.swapcase()}}}")
    case.expect(
        not lines,
        f"the name {mine.swapcase()}, which is in another case, lists {lines}, not nothing",
    )


@truth("query.line-ends", "LF alone ends a query", "6.1", Severity.SHOULD)
async def line_ends(case: Case) -> None:
    """LF ends a query and CR before it is dropped; the LF of a split CR LF is no further query."""
    client = await _client(case)
    await client.send("{Actors}", "\n")
    await _rest(case, client)
    await client.wire.send(b"{Actors}\r")
    await case.clock.sleep(0.0)
    await client.wire.send(b"\n")
    await _rest(case, client)
    await client.silent(_QUIET, "two listings for two queries")


@truth("query.split", "Queries may come in pieces", "6.1", Severity.SHOULD)
async def split(case: Case) -> None:
    """A query is what stands on a line, however it is cut on its way."""
    client = await _client(case)
    for part in (b"{class USARBot.", b"NoSuchRobot", b"}\r\n"):
        await client.wire.send(part)
        await asyncio.sleep(0.15)
    lines = await _rest(case, client)
    case.expect(not lines, f"the unknown class of a query in pieces lists {lines[:2]}, not nothing")
    await client.silent(_QUIET, "one listing for one query")


@truth("query.pipelined", "Every line is a query", "6.1", Severity.SHOULD)
async def pipelined(case: Case) -> None:
    """Three lines in one write get three listings."""
    client = await _client(case)
    await client.wire.send(b"\r\n{Actors}\r\n{class No.Such}\r\n")
    for _ in range(3):
        await _rest(case, client)
    await client.silent(_QUIET, "three listings for three lines")


@truth("query.garbage", "Survives garbage", "6.1")
async def garbage(case: Case) -> None:
    """Bytes that are no text get a listing like everything else, and do no harm."""
    client = await _client(case)
    await client.wire.send(b"\xff\x00{{{{class}}}\x80\r\n")
    await _rest(case, client)
    await _ask(case, client)


@truth("query.long-line", "Survives a line without end", "6.1", Severity.SHOULD)
async def long_line(case: Case) -> None:
    """A megabyte without a line end does not keep the server from answering others."""
    endless, other = await _client(case), await _client(case)
    await endless.wire.send(b"A" * 1_000_000)
    await _ask(case, other)


@truth("listing.form", "The form of a line", "11.92, 6.1")
async def form(case: Case) -> None:
    """Name, Class, Time, Location, Rotation from column 0, with single blanks between: tools match
    by position."""
    await case.spawn()
    lines = await _ask(case, await _client(case))
    case.expect(lines, f"{len(lines)} lines are listed with a robot in the world, not at least 1")
    odd = [line for line in lines if not _FORM.fullmatch(line)]
    case.expect(
        not odd,
        "lines have another form, not {Name n} {Class c} {Time t} {Location v} "
        f"{{Rotation v}}: {odd[:3]}",
    )


@truth("listing.digits", "Two and four decimals", "11.93, 6.1", Severity.SHOULD)
async def digits(case: Case) -> None:
    """Locations and rotations have two decimals, the time has four."""
    await case.spawn()
    for line in await _ask(case, await _client(case)):
        groups = {
            key: value for group in split_reply(f"X {line}")[1] for key, value in group.items()
        }
        time = groups.get("Time", "")
        case.expect(
            re.fullmatch(r"\d+\.\d{4}", time), f"Time is {time!r}, not a number with four digits"
        )
        for key in ("Location", "Rotation"):
            parts = groups.get(key, "").split(",")
            good = len(parts) == 3 and all(re.fullmatch(_TWO, part) for part in parts)
            case.expect(
                good, f"{key} is {groups.get(key)!r}, not three numbers with two digits each"
            )


@truth("listing.names", "Names are unique and stable", "11.94, 6.1")
async def names(case: Case) -> None:
    """Names are those of objects, class and index, unique and the same in every listing; not those
    of INIT."""
    robot = await case.spawn()
    client = await _client(case)
    mine = (await _own(case, client, robot))[1]
    lines = await _ask(case, client)
    found = [_name(line) for line in lines]
    case.expect(len(set(found)) == len(found), f"names are {sorted(found)}, not each another")
    case.expect(mine in found, f"{mine} is missing in the next listing: {found}")
    case.expect(
        re.fullmatch(rf"{robot.class_name}_\d+", mine),
        f"Name is {mine}, not {robot.class_name}_ and a number",
    )


@truth("listing.class", "Classes have no package", "6.1, 7")
async def bare_class(case: Case) -> None:
    """Class is the bare class name, as tools compare it: no package before it."""
    robot = await case.spawn()
    await _own(case, await _client(case), robot)
    lines = await _ask(case, await _client(case))
    odd = [line for line in lines if (match := _FORM.match(line)) and "." in match[2]]
    case.expect(not odd, f"Class has a package, not the bare name: {odd[:2]}")


@truth("listing.time", "Time goes on", "6.1")
async def time_goes_on(case: Case) -> None:
    """Time is simulated time: that of the control port, and it grows between listings."""
    robot = await case.spawn()
    client = await _client(case)
    first = float((await _own(case, client, robot))[3])
    await robot.run(0.5)
    before = robot.now
    second = float((await _own(case, client, robot))[3])
    await robot.catch_up()
    after = (await robot.wait(lambda line: line.head == "STA", what="STA")).time
    case.expect(
        second > first,
        f"Time is {second} in the second listing, not above {first}, that of the first",
    )
    between = before - 1.0 < second < after + 1.0
    case.expect(
        between, f"Time is {second}, not between {before} and {after}, Time on the control port"
    )


@truth("listing.one-read", "A listing comes in one piece", "11.95, 7", Severity.SHOULD)
async def one_read(case: Case) -> None:
    """A tool that reads once when data is there gets the whole listing: it is one write."""
    await case.spawn()
    client = await _client(case)
    for _ in range(5):
        await client.send("")
        data = await client.wire.read(side_lines.WITHIN)
        case.expect(
            data.endswith(b"{End}\r\n"),
            f"the first piece of a listing ends with {data[-40:]!r}, not with {{End}} and CR LF",
        )


@truth("listing.leaves", "Robots vanish with their connection", "6.1")
async def leaves(case: Case) -> None:
    """A robot whose controller has disconnected is listed no more."""
    robot = await case.spawn()
    client = await _client(case)
    mine = (await _own(case, client, robot))[1]
    robot.close()

    async def gone() -> bool:
        return not await _ask(case, client, f"{{name {mine}}}")

    case.expect(
        await case.soon(gone, 3.0), f"{mine} is listed 3 s after its connection ended, not gone"
    )


@truth("listing.getpos", "Agrees with the ground truth port", "11.98", Severity.SHOULD)
async def getpos(case: Case) -> None:
    """A robot at rest has the same location in GETPOS, to a centimetre."""
    client = await _client(case)
    other = await LineClient.open(case, "groundtruth")
    robot = await case.spawn()
    await robot.run(1.5)
    place = numbers((await _own(case, client, robot))[4])
    groups = split_reply(await other.ask("GETPOS"))[1]
    told = [numbers(group.get("Location")) for group in groups if group.get("Name") == robot.name]
    case.need(told, f"GETPOS does not list {robot.name}")
    off = math.dist(told[0], place)
    case.expect(off < 0.02, f"Location is {place}, not {told[0]}, as by GETPOS")


@truth("clients.ten-per-second", "Two tools at ten queries a second", "11.96, 7")
async def ten_per_second(case: Case) -> None:
    """Two tools that ask every 100 ms without waiting get a listing for every query."""
    clients = [await _client(case) for _ in range(2)]
    for _ in range(15):
        for client in clients:
            await client.send("{Actors}")
        await case.clock.sleep(0.0)
    for client in clients:
        for _ in range(15):
            await _rest(case, client)


@truth("clients.vanishes", "Survives tools that quit", "11.97, 7")
async def vanishes(case: Case) -> None:
    """A tool that asks once more and quits without reading, or resets, disturbs nobody."""
    for reset in (False, True):
        client = await _client(case)
        await client.send("{Actors}")
        client.wire.reset() if reset else client.wire.close()
    await _ask(case, await _client(case))


@truth("clients.slow-reader", "Who does not read stops nobody", "6.1")
async def slow_reader(case: Case) -> None:
    """While one tool asks and never reads, others are answered."""
    stalled, other = await _client(case), await _client(case)
    await stalled.wire.send(b"\r\n" * 3000)
    for _ in range(3):
        await _ask(case, other)


@truth("listing.victims", "Victims are where the world says, and walk", "6.2")
async def victims(case: Case) -> None:
    """Location of the victims is that of the world: who lies or stands stays there, and who walks
    to and fro at 0.5 m/s comes at least 0.3 m far within 5 s. Judged on the kit's own stage."""
    need_stage(case, "victims of known places")
    places = []
    for _ in range(6):
        places.append([place for _, place in (await people(case)).values()])
        await case.clock.sleep(1.0)
    for one in facts()["victim"]:
        wanted = spot("victim", one["name"])
        walks = "motion" in one["properties"]
        found = [min(some, key=lambda place: math.dist(place, wanted)) for some in places if some]
        case.need(found, "nobody of a class of victims is listed")
        off = max(math.dist(place, wanted) for place in found)
        limit = 4.5 if walks else 0.3
        case.expect(
            off < limit,
            f"Location of the victim {one['name']} is {off:.2f} m off {wanted}, its place in the "
            f"file of the world, not {limit} at most",
        )
        way = max(math.dist(found[0], place) for place in found)
        case.expect(
            not walks or way > 0.3,
            f"Location of the victim {one['name']} changes by {way:.2f} m within 5 s, not by 0.3 "
            "and more: by the file of the world it walks at 0.5 m/s",
        )
