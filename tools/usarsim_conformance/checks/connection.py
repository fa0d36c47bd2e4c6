"""Connecting, the greeting, the shape of every line, hanging up (protocol reference 6.1), and how a
server that speaks several dialects chooses one (protocol 6.11)."""

from __future__ import annotations

import asyncio
import re

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import REPLY, ControlClient
from usarsim_conformance.lines import Line
from usarsim_conformance.places import LEAVES
from usarsim_conformance.recordings import standing
from usarsim_conformance.registry import Severity, control, once, unreal
from usarsim_conformance.survey import dialect_of
from usarsim_conformance.wire import Wire

_SILENCE = 5.0
_CROWD = 40


@once("connection.greeting", "Greets whoever connects, with one line", "6, no. 2")
async def greeting(case: Case) -> None:
    """Soon after accept, before any input, the server sends exactly one line, the game NFO."""
    client = await case.connect(greet=False)
    line = await client.wait(lambda line: True, what="greeting")
    case.expect(line.head == "NFO", f"the first line is {line}, not an NFO")
    case.expect("Gametype" in line.names, f"the first line is {line}, not an NFO with Gametype")
    more = await client.listen(1.0)
    case.expect_silence(more, "the greeting")


@once("connection.greeting-segments", "The greeting has Gametype, Level, TimeLimit", "6, no. 3")
async def greeting_segments(case: Case) -> None:
    """The greeting has exactly the segments Gametype, Level, TimeLimit in this order, and
    TimeLimit is an integer."""
    client = await case.connect(greet=False)
    line = await client.wait("NFO")
    case.expect_names(line, ("Gametype", "Level", "TimeLimit"))
    limit = line.get("TimeLimit") or ""
    case.expect(re.fullmatch(r"\d+", limit), f"TimeLimit is {limit!r}, not an integer")


@once("connection.greeting-level", "The level is a bare name", "6, no. 4", Severity.SHOULD)
async def greeting_level(case: Case) -> None:
    """The Level of the greeting is not empty and has no suffix `.LevelInfo`."""
    client = await case.connect(greet=False)
    level = (await client.wait("NFO")).get("Level") or ""
    case.expect(level, f"Level is {level!r}, not a name")
    case.expect(
        ".levelinfo" not in level.lower(), f"Level is {level!r}, not a name without .LevelInfo"
    )


@once("connection.quiet", "Says nothing to a silent client", "6, no. 5")
async def quiet(case: Case) -> None:
    """After the greeting nothing is sent on a connection that sends no command."""
    client = await case.connect()
    line = await client.line(_SILENCE)
    case.expect(line is None, f"{line} comes after the greeting and no command, not nothing")


@control("connection.crlf", "Lines end with CR LF", "6, no. 6")
async def crlf(case: Case) -> None:
    """Every server line ends with bytes 13 10, and has neither elsewhere."""
    recording = await standing(case)
    for line in recording.lines:
        case.expect(
            line.raw.endswith(b"\r\n"), f"a line ends with {line.raw[-3:]!r}, not with CR LF"
        )
        case.expect(
            b"\r" not in line.raw[:-2],
            f"a CR stands within a line, not only at its end: {line.raw[:200]!r}",
        )


@control("connection.no-empty-lines", "Sends no empty lines", "6, no. 7")
async def no_empty_lines(case: Case) -> None:
    """No empty line is ever sent."""
    recording = await standing(case)
    empty = sum(not line.text.strip() for line in recording.lines)
    case.expect(not empty, f"{empty} of {len(recording.lines)} lines are empty, not 0")


@control("connection.blanks", "Lines have no stray blanks", "6, no. 8")
async def blanks(case: Case) -> None:
    """No server line contains a tab or a doubled blank, or starts or ends with a blank."""
    for line in (await standing(case)).lines:
        case.expect("\t" not in line.text, f"a line has a tab, not only blanks: {line}")
        case.expect("  " not in line.text, f"a line has two blanks in a row, not one: {line}")
        case.expect(
            line.text == line.text.strip(" "),
            f"a line has a blank at an edge, not only within: {line.raw[:200]!r}",
        )


@unreal("connection.separation", "One blank between segments", "6, no. 9")
async def separation(case: Case) -> None:
    """Between a closing brace and the next opening one there is exactly one blank, and one
    between head and first brace. (The camera CONF of the udk dialect is glued by tradition.)"""
    for line in (await standing(case)).lines:
        if line.head == "CONF" and line.type == "Camera":
            continue
        between = re.search(r"\}([^{} ][^{}]*| [^{}]+|)\{", line.text)
        case.expect(between is None, f"segments have no blank, or more than one, between: {line}")
        case.expect(
            re.match(r"[A-Z]+( \{|$)", line.text),
            f"a line does not begin with a head and one blank: {line}",
        )


@control("connection.braces", "Braces are balanced and never nested", "1.5")
async def braces(case: Case) -> None:
    """Every opening brace of a server line is closed before the next one opens."""
    for line in (await standing(case)).lines:
        signs = re.sub(r"[^{}]", "", line.text)
        case.expect(
            signs == "{}" * (len(signs) // 2),
            f"braces of a line stand as {signs[:60]}, not each closed before the next one: {line}",
        )


@control("connection.heads", "Only known heads are sent", "4.1", Severity.SHOULD)
async def heads(case: Case) -> None:
    """Every line begins with a head that clients know, in capitals."""
    known = {"NFO", "STA", "SEN", "MISSTA", "ASTA", "EFF", "BSTA", "CONF", "GEO", "RES", "DIE"}
    for line in (await standing(case)).lines:
        case.expect(
            line.head in known or not line.text.strip(),
            f"the first word is {line.head!r}, not one of {', '.join(sorted(known))}: {line}",
        )


@control(
    "connection.whole-lines",
    "Lines are not cut over segments",
    "6, no. 10 and 1.1",
    Severity.SHOULD,
)
async def whole_lines(case: Case) -> None:
    """Each line is handed to the socket in one write, so that no read ends within a line."""
    recording = await standing(case)
    share = recording.torn / max(1, len(recording.streamed))
    case.expect(
        share < 0.05,
        f"{recording.torn} reads ended in the middle of a line, not at most 5 for 100 of the "
        f"{len(recording.streamed)} lines",
    )


@once(
    "connection.crowd", f"Serves {_CROWD} connections", "6, no. 12", Severity.SHOULD, exclusive=True
)
async def crowd(case: Case) -> None:
    """Dozens of connections at a time are greeted and answered."""
    clients = [await case.connect(greet=False) for _ in range(_CROWD)]
    for client in clients:
        await client.send("GETSTARTPOSES")
    answers = await asyncio.gather(*(client.maybe("NFO {StartPoses") for client in clients))
    mute = sum(answer is None for answer in answers)
    case.expect(not mute, f"{mute} of {_CROWD} connections were not answered")


@once("connection.come-and-go", "Short connections do no harm", "6, no. 14")
async def come_and_go(case: Case) -> None:
    """Clients that connect and leave at once, politely or with a reset, leave the server well."""
    for number in range(20):
        client = await case.connect(greet=False)
        if number % 2:
            client.wire.reset()
        else:
            client.close()
    await case.expect_alive(await case.connect(), "20 clients that left at once")


@once("connection.half-close", "A half-closed connection is closed", "6, no. 14", Severity.SHOULD)
async def half_close(case: Case) -> None:
    """If the client ends its half of the connection, the server ends the other within seconds."""
    robot = await case.spawn()
    robot.client.wire.half_close()
    case.expect(
        await robot.client.wire.hung_up(REPLY),
        f"the connection is not closed within {REPLY:g} s after the client has ended its half",
    )


@once("connection.again", "The same INIT works again after closing", "6, no. 15")
async def again(case: Case) -> None:
    """After the client has closed, the same INIT can be repeated on a new connection, whether the
    first ended politely or with a reset."""
    place = await case.place()
    init = case.init(place, case.new_name())
    for end in (ControlClient.close, _reset, ControlClient.close):
        client = await case.connect()
        await client.send(init)
        await client.wait(lambda line: line.head == "STA", PATIENCE, "STA")
        end(client)
        await case.clock.sleep(LEAVES)


def _reset(client: ControlClient) -> None:
    client.wire.reset()


@once("connection.leaves", "A robot leaves with its connection", "6, no. 13")
async def leaves(case: Case) -> None:
    """Closing the socket removes the robot from the world within 1 s."""
    robot = await case.spawn()
    watch = await case.open("groundtruth")
    case.need(await _listed(robot.name, watch), "GETPOS does not list the robot")
    robot.close()

    async def gone() -> bool:
        return not await _listed(robot.name, watch)

    # A second more, for what had been asked before the hangup was noticed.
    case.expect(
        await case.soon(gone, LEAVES + 1.0),
        f"{robot.name} is listed by GETPOS {LEAVES + 1.0:g} s after its connection ended, not gone",
    )


async def _listed(name: str, watch: Wire) -> bool:
    await watch.send(b"GETPOS\r\n")
    answer = await watch.read_until(b"\r\n", REPLY)
    return f"{{Name {name} ".encode() in answer


_U4 = ("P2AT", "P2DX", "ATRVJr", "Zerg")
"""Classes of UT2004 alone."""


async def _several(case: Case) -> None:
    if not {"ut2004", "udk"} <= set(case.survey.dialects):
        case.skip("the server does not choose between the Unreal dialects")


async def _u4_class(case: Case) -> str:
    await _several(case)
    if case.robot_class not in _U4 or case.survey.native != "ut2004":
        case.skip(f"needs a robot of UT2004 alone, not {case.robot_class}; try --robot P2AT")
    return case.robot_class


async def _streamed(case: Case, *commands: str) -> Line:
    client = await case.connect()
    await client.send(*commands)
    return await client.wait(lambda line: line.head == "STA", PATIENCE, "STA")


@once("dialect.default", "A UT2004 robot speaks ut2004", "6, no. 174")
async def default(case: Case) -> None:
    """INIT with ClassName of a UT2004 robot and nothing else gives ut2004 shapes."""
    robot = await _u4_class(case)
    place = await case.place()
    line = await _streamed(case, f"INIT {{ClassName USARBot.{robot}}} {place.segments}")
    case.expect(
        dialect_of(line) == "ut2004",
        f"the first streamed line has the shape of {dialect_of(line)!r}, not of ut2004: {line}",
    )


@once("dialect.classname", "Classname switches to udk", "6, no. 173")
async def classname(case: Case) -> None:
    """INIT with `Classname` gives udk shapes from the first streamed line."""
    robot = await _u4_class(case)
    place = await case.place()
    line = await _streamed(case, f"INIT {{Classname USARBot.{robot}}} {place.segments}")
    case.expect(
        dialect_of(line) == "udk",
        f"the first streamed line has the shape of {dialect_of(line)!r}, not of udk: {line}",
    )


@once("dialect.actuator", "GETCONF of Actuator switches to udk", "6, no. 175")
async def actuator(case: Case) -> None:
    """`GETCONF {Type Actuator}` directly after INIT switches to udk."""
    robot = await _u4_class(case)
    place = await case.place()
    line = await _streamed(
        case, f"INIT {{ClassName USARBot.{robot}}} {place.segments}", "GETCONF {Type Actuator}"
    )
    case.expect(
        dialect_of(line) == "udk",
        f"the first streamed line has the shape of {dialect_of(line)!r}, not of udk: {line}",
    )


@unreal("dialect.forced", "Dialect forces a dialect", "6, no. 176")
async def forced(case: Case) -> None:
    """`{Dialect udk}` or `{Dialect ut2004}` in INIT forces the dialect and ends automatic
    change."""
    await _several(case)
    place = await case.place()
    line = await _streamed(
        case,
        f"INIT {{Classname USARBot.{case.robot_class}}} {place.segments} "
        f"{{Dialect {case.dialect}}}",
        "GETCONF {Type Actuator}",
    )
    case.expect(
        dialect_of(line) == case.dialect,
        f"the first streamed line has the shape of {dialect_of(line)!r}, not of {case.dialect}: "
        f"{line}",
    )


@once("dialect.side-by-side", "Two dialects at a time", "6, no. 178")
async def side_by_side(case: Case) -> None:
    """Two connections with different dialects work at the same time, with robots of the same
    class."""
    await _several(case)
    clients = []
    for dialect in ("ut2004", "udk"):
        client, place = await case.connect(), await case.place()
        await client.send(
            f"INIT {{ClassName USARBot.{case.robot_class}}} {place.segments} {{Dialect {dialect}}}"
        )
        clients.append((client, dialect))
    for _ in range(2):
        for client, dialect in clients:
            line = await client.wait(lambda line: line.head == "STA", PATIENCE, "STA")
            case.expect(
                dialect_of(line) == dialect,
                f"the first streamed line has the shape of {dialect_of(line)!r}, not of "
                f"{dialect}: {line}",
            )


@unreal("dialect.steady", "A dialect does not flicker", "5.3", Severity.SHOULD)
async def steady(case: Case) -> None:
    """All STA lines of a connection have one shape."""
    robot = await case.spawn()
    lines = [line for line in await robot.run(1.0) if line.head == "STA"]
    shapes = {(dialect_of(line), line.names) for line in lines}
    case.expect(
        len(shapes) == 1,
        f"STA has {len(shapes)} shapes on one connection, not 1: "
        f"{sorted(' '.join(names) for _, names in shapes)}",
    )
