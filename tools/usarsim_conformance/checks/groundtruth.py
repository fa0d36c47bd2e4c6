"""Positions for wireless simulation: connection, framing, GETPOS (side channels reference 3)."""

from __future__ import annotations

import asyncio
import math
import re

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.lines import numbers
from usarsim_conformance.recordings import wheels_of
from usarsim_conformance.registry import Severity, checks_of
from usarsim_conformance.side_lines import LineClient, split_reply, static_station

truth = checks_of("groundtruth")

_QUIET = 0.5
_NUMBER = r"-?\d+\.\d{4}"
_GROUP = rf"\{{Name [^{{}} ]+ Location {_NUMBER},{_NUMBER},{_NUMBER} BatteryEmpty (?:True|False)\}}"
_FORM = re.compile(rf"POSITIONS \{{Robots (\d+)\}}(?: {_GROUP})*")


async def _client(case: Case) -> LineClient:
    return await LineClient.open(case, "groundtruth")


async def positions(case: Case, client: LineClient) -> dict[str, tuple[float, ...]]:
    """Where everybody is, as the wireless program reads it (side channels 3.4)."""
    line = await client.ask("GETPOS")
    kind, groups = split_reply(line)
    case.expect(
        kind == "POSITIONS" and groups,
        f"GETPOS is answered by {line[:120]!r}, not by POSITIONS and groups",
    )
    found = {group["Name"]: numbers(group.get("Location")) for group in groups if "Name" in group}
    case.expect(
        groups[0].get("Robots") == str(len(found)),
        f"Robots of GETPOS is {groups[0].get('Robots')}, not {len(found)}, as many as the "
        f"splitter finds in {line[:200]!r}",
    )
    return found


async def _listed(case: Case, client: LineClient, robot: Robot) -> tuple[float, ...]:
    found = (await positions(case, client)).get(robot.name)
    case.expect(
        found is not None, f"{robot.name} has sent STA, but is missing in the list of GETPOS"
    )
    assert found is not None
    return found


@truth("connect.silent", "Says nothing before it is asked", "11.47, 3.1")
async def silent(case: Case) -> None:
    """Nothing is sent on connect."""
    await (await _client(case)).silent(1.0, "connecting")


@truth("connect.stays-open", "Stays open", "3.5")
async def stays_open(case: Case) -> None:
    """The server never closes a connection by itself; the wireless program would end with it."""
    client = await _client(case)
    await client.silent(4.0, "connecting")
    await positions(case, client)


@truth("connect.several", "Serves many connections", "3.1")
async def several(case: Case) -> None:
    """Any number of connections is served, each with its own replies."""
    clients = [await _client(case) for _ in range(12)]
    for client in clients:
        await client.send("GETPOS")
    for client in clients:
        line = await client.line()
        case.expect(
            line.startswith("POSITIONS {Robots "),
            f"GETPOS is answered by {line[:80]!r}, not by POSITIONS",
        )


@truth("getpos.none", "The list without robots", "11.48, 3.2", exclusive=True)
async def none(case: Case) -> None:
    """Without robots the answer is exactly `POSITIONS {Robots 0}`. Inconclusive while others have
    robots in the world."""
    client = await _client(case)
    lines = [""]

    async def empty() -> bool:
        lines.append(await client.ask("GETPOS"))
        return not re.match(r"POSITIONS \{Robots [1-9]", lines[-1])

    async with case.clock.alone():
        if not await case.soon(empty, 5.0):
            case.give_up(f"there are robots in the world: {lines[-1][:120]!r}")
    case.expect(
        lines[-1] == "POSITIONS {Robots 0}",
        f"GETPOS without robots is answered by {lines[-1]!r}, not by 'POSITIONS {{Robots 0}}'",
    )


@truth("getpos.form", "The form of POSITIONS", "11.49, 3.2, 3.4")
async def form(case: Case) -> None:
    """One group per robot with its three pairs, single blanks, one blank between groups, none at
    the ends: the only reader in the field splits by position."""
    await case.spawn()
    line = await (await _client(case)).ask("GETPOS")
    case.expect(
        _FORM.fullmatch(line),
        "GETPOS has another form, not POSITIONS {Robots n} and {Name n Location x,y,z "
        f"BatteryEmpty b}} for each: {line!r}",
    )


@truth("getpos.splitter", "The strict splitter finds every robot", "11.65, 3.4")
async def splitter(case: Case) -> None:
    """Read as the wireless program does, every robot has a name, three numbers and a flag, and
    there are as many as announced."""
    robots = [await case.spawn() for _ in range(2)]
    client = await _client(case)
    found = await positions(case, client)
    for robot in robots:
        case.expect(robot.name in found, f"{robot.name} is missing among {sorted(found)}")
    for name, place in found.items():
        good = len(place) == 3 and all(map(math.isfinite, place))
        case.expect(good, f"Location of {name} is {place}, not three numbers")


@truth("getpos.digits", "Coordinates have four decimals", "11.50, 3.2", Severity.SHOULD)
async def digits(case: Case) -> None:
    """Every coordinate has exactly four digits behind the point and no exponent."""
    await case.spawn()
    line = await (await _client(case)).ask("GETPOS")
    texts = [text for group in re.findall(r"Location ([^ }]*)", line) for text in group.split(",")]
    case.need(texts, "no Location is listed")
    odd = [text for text in texts if not re.fullmatch(_NUMBER, text)]
    case.expect(
        not odd,
        f"coordinates of Location are {odd}, not numbers with exactly four digits behind the point",
    )


@truth("getpos.truncated", "Coordinates are truncated", "11.50, 3.2", Severity.SHOULD)
async def truncated(case: Case) -> None:
    """Digits behind the fourth are cut off, not rounded. Judged by static stations, which stand
    exactly where they were put."""
    place = await case.place()
    case.need(place.location != (0.0, 0.0, 0.0) or place.tag is None, "no start poses are known")
    x, y, z = (round(value, 2) for value in place.location)
    off = tuple(math.copysign(0.00008, value) for value in (x, y))
    station = await static_station(case, (x + off[0], y + off[1], z))
    found = await _listed(case, await _client(case), station)
    wanted = (x, y)
    case.need(
        all(abs(a - b) < 0.00025 for a, b in zip(found, wanted, strict=False)),
        f"the station stands at {found[:2]}, was put to {wanted} and a little",
    )
    case.expect(
        all(abs(a - b) < 0.00005 for a, b in zip(found, wanted, strict=False)),
        f"x and y of Location are {found[:2]}, not {wanted}, for {off} more than that: they are "
        "rounded, not cut off",
    )


@truth("getpos.place", "Positions are true", "3.2")
async def place(case: Case) -> None:
    """Positions are metres in the frame of the control port, z down: a robot is where its INIT has
    put it."""
    robot = await case.spawn()
    told = await _listed(case, await _client(case), robot)
    where = (await robot.pose()).location
    off = math.dist(told, where)
    case.expect(
        off < 0.5,
        f"Location of GETPOS is {told}, not within 0.5 m of {where}, as the robot's own sensor "
        "tells",
    )


@truth("getpos.follows", "Positions follow robots", "3.2, 3.5")
async def follows(case: Case) -> None:
    """A robot that drives is listed where it is, not where it was."""
    robot = await case.spawn()
    await wheels_of(robot)
    client = await _client(case)
    start = await _listed(case, client, robot)
    before, after = await case.drive(robot, "DRIVE {Left 2.0} {Right 2.0}", 2.0)
    driven = math.dist(before.location, after.location)
    case.need(driven > 0.15, f"the robot moved by {driven:.2f} m, not by more than 0.15")
    told = math.dist(start, await _listed(case, client, robot))
    case.expect(
        told > 0.5 * driven,
        f"Location of GETPOS changes by {told:.2f} m, not by more than half of {driven:.2f} m, as "
        "the robot drives",
    )


@truth("getpos.names", "Names keep their case", "11.51, 3.2")
async def names(case: Case) -> None:
    """A robot is listed by the Name of its INIT, in its letter case."""
    free = await case.place()
    name = f"kIt{case.new_name()}X"
    robot = await case.spawn(place=free, init=case.init(free, name))
    robot.name = name
    await _listed(case, await _client(case), robot)


@truth("getpos.order", "Robots are listed in spawn order", "11.52, 3.2", Severity.SHOULD)
async def order(case: Case) -> None:
    """Robots stand in the order in which they were spawned, whatever their names."""
    first_place, second_place = await case.place(), await case.place()
    marks = [f"{mark}{case.new_name()}" for mark in "ZA"]
    for name, free in zip(marks, (first_place, second_place), strict=True):
        await case.spawn(place=free, init=case.init(free, name))
    listed = list(await positions(case, await _client(case)))
    found = [name for name in listed if name in marks]
    case.expect(
        found == marks, f"GETPOS lists {found}, not {marks}, the order in which they were spawned"
    )


@truth("getpos.leaves", "Robots vanish with their connection", "11.52, 3.2")
async def leaves(case: Case) -> None:
    """A robot disappears from the list when its controller disconnects."""
    robot = await case.spawn()
    client = await _client(case)
    await _listed(case, client, robot)
    robot.close()

    async def gone() -> bool:
        return robot.name not in await positions(case, client)

    case.expect(
        await case.soon(gone, 3.0),
        f"{robot.name} is listed 3 s after its connection ended, not gone",
    )


@truth("getpos.battery", "Robots with power are not empty", "11.64, 3.2")
async def battery(case: Case) -> None:
    """A fresh robot has `BatteryEmpty False`; the wireless program kicks all others."""
    robot = await case.spawn()
    line = await (await _client(case)).ask("GETPOS")
    found = [group for group in split_reply(line)[1] if group.get("Name") == robot.name]
    case.expect(found, f"{robot.name} is missing in the list of GETPOS")
    case.expect(
        found[0].get("BatteryEmpty") == "False",
        f"BatteryEmpty of a fresh robot is {found[0].get('BatteryEmpty')}, not False: {found[0]}",
    )


@truth("getpos.in-time", "Answers within a second", "11.62, 3.5", Severity.INFORMATIVE)
async def in_time(case: Case) -> None:
    """The wireless program waits at most a second; later answers are booked on the wrong pair. How
    fast a server answers is a matter of its machine: informative."""
    robots = [await case.spawn() for _ in range(2)]
    client = await _client(case)
    worst = 0.0
    for _ in range(20):
        begun = case.clock.now
        await client.ask("GETPOS")
        await client.ask(f"GETOBS {{From {robots[0].name}}} {{To {robots[1].name}}}")
        worst = max(worst, case.clock.now - begun)
    case.expect(worst < 1.0, f"GETPOS and GETOBS together take {worst:.2f} s, not less than 1 s")


@truth("getpos.station", "A static station is listed", "11.67, 4.4", Severity.SHOULD)
async def station(case: Case) -> None:
    """A motionless communication station can be spawned, for operators without a robot, and is
    listed with power."""
    found = await static_station(case)
    line = await (await _client(case)).ask("GETPOS")
    groups = [group for group in split_reply(line)[1] if group.get("Name") == found.name]
    case.expect(groups, f"{found.name} is missing in the list of GETPOS")
    case.expect(
        groups[0].get("BatteryEmpty") == "False",
        f"BatteryEmpty of a station is {groups[0].get('BatteryEmpty')}, not False: {groups[0]}",
    )


# Framing.


@truth("request.case", "Commands in any case", "11.53, 3.1")
async def command_case(case: Case) -> None:
    """The command word may be in any letter case."""
    client = await _client(case)
    for word in ("getpos", "GetPos", "GETPOS"):
        line = await client.ask(word)
        case.expect(
            line.startswith("POSITIONS {"),
            f"{word!r} is answered by {line[:80]!r}, not by POSITIONS",
        )


@truth("request.pipelined", "Two requests in one segment", "11.54, 3.1")
async def pipelined(case: Case) -> None:
    """Requests that come together are all answered, one line each, in their order."""
    client = await _client(case)
    await client.wire.send(b"GETPOS\r\nGETOBS {From A?} {To B?}\r\nGETPOS\r\n")
    heads = [(await client.line()).partition(" ")[0] for _ in range(3)]
    case.expect(
        heads == ["POSITIONS", "NUMOBS", "POSITIONS"],
        f"three requests in one packet are answered by {heads}, not by POSITIONS, NUMOBS, "
        "POSITIONS",
    )
    await client.silent(_QUIET, "three lines for three requests")


@truth("request.split", "A request over two segments", "11.55, 3.1")
async def split(case: Case) -> None:
    """A request that comes in pieces is answered once, when its end is there."""
    client = await _client(case)
    await client.wire.send(b"GET")
    await client.silent(0.3, "half a request")
    await client.wire.send(b"POS\r")
    await asyncio.sleep(0.1)
    await client.wire.send(b"\n")
    await client.line()
    await client.silent(_QUIET, "one line for one request")


@truth("request.line-ends", "CR, LF or both", "3.1", Severity.SHOULD)
async def line_ends(case: Case) -> None:
    """A request ends with any run of CR and LF."""
    client = await _client(case)
    for end in ("\n", "\r", "\r\n", "\n\r", "\r\n\r\n\n"):
        await client.send("GETPOS", end)
        await client.line()
    await client.silent(_QUIET, "a line for each request")


@truth("request.blank-lines", "Blank lines vanish", "3.1")
async def blank_lines(case: Case) -> None:
    """Empty lines get no reply."""
    client = await _client(case)
    await client.wire.send(b"\r\n\r\n\n")
    await client.silent(_QUIET, "empty lines")
    await positions(case, client)


@truth("request.unknown", "Unknown commands get no reply", "11.61, 3.1")
async def unknown(case: Case) -> None:
    """A command that the dialogue does not know gets no reply, and the connection stays usable."""
    client = await _client(case)
    await client.send("INIT {Robot A} {Port 1}")
    await client.send("HELLO")
    await client.silent(_QUIET, "unknown commands")
    await positions(case, client)


@truth("request.garbage", "Survives garbage", "3.1")
async def garbage(case: Case) -> None:
    """Bytes that are no text, and braces that never close, do no harm: a later GETPOS is
    answered."""
    client = await _client(case)
    await client.wire.send(bytes(range(256)) * 2 + b"\r\n{{{{}}GETOBS{\r\n\0\r\n")
    await client.wire.silence(_QUIET)
    await client.send("GETPOS")
    while not (line := await client.line()).startswith("POSITIONS {Robots "):
        case.expect(not line, f"garbage is answered by {line!r}, not by an empty line")


@truth("request.long-line", "Survives a line without end", "3.1", Severity.SHOULD)
async def long_line(case: Case) -> None:
    """A megabyte without a line end neither blocks other connections nor ends the server."""
    endless, other = await _client(case), await _client(case)
    await endless.wire.send(b"A" * 1_000_000)
    await positions(case, other)


@truth("request.half-close", "Answers who has sent end of file", "3.1", Severity.INFORMATIVE)
async def half_close(case: Case) -> None:
    """A client that ends its sending side behind a request still gets the reply."""
    client = await _client(case)
    await client.send("GETPOS")
    client.wire.half_close()
    await client.line()


@truth("clients.slow-reader", "Who does not read stops nobody", "3.1")
async def slow_reader(case: Case) -> None:
    """While one client asks and never reads, others are answered."""
    stalled, other = await _client(case), await _client(case)
    await stalled.wire.send(b"GETPOS\r\n" * 5000)
    for _ in range(3):
        await positions(case, other)


@truth("clients.vanishes", "Survives clients that vanish", "3.1")
async def vanishes(case: Case) -> None:
    """Clients that reset with requests open disturb nobody."""
    for data in (b"GETPOS\r\n" * 50, b"GETP"):
        client = await _client(case)
        await client.wire.send(data)
        client.wire.reset()
    await positions(case, await _client(case))
