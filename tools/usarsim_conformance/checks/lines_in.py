"""Line ends and cutting of what clients send (protocol reference 6.2)."""

from __future__ import annotations

import asyncio

from usarsim_conformance.case import Case
from usarsim_conformance.checks.values import lit
from usarsim_conformance.control import REPLY, ControlClient
from usarsim_conformance.lines import Line
from usarsim_conformance.registry import control, once, unreal

_POSES = "NFO {StartPoses"


async def _answers(client: ControlClient, expected: int = 1) -> int:
    """Replies to GETSTARTPOSES: those that must come, and what else comes within a time."""
    count = 0
    while count < expected and await client.maybe(_is_poses) is not None:
        count += 1
    return count + sum(_is_poses(line) for line in await client.listen(0.8))


def _is_reply(line: Line) -> bool:
    return line.head in ("CONF", "GEO")


def _is_poses(line: Line) -> bool:
    return line.head == "NFO" and "StartPoses" in line.names


async def _ended_by(case: Case, end: bytes) -> None:
    client = await case.connect()
    await client.send_bytes(b"GETSTARTPOSES" + end)
    count = await _answers(client)
    case.expect(count == 1, f"GETSTARTPOSES ended by {end!r} is answered {count} times, not once")


@once("input.crlf", "CR LF ends a command", "6, no. 21")
async def ends_crlf(case: Case) -> None:
    """A command followed by CR LF is answered, once."""
    await _ended_by(case, b"\r\n")


@unreal("input.lf", "LF alone ends a command", "6, no. 22")
async def ends_lf(case: Case) -> None:
    """A command followed by LF alone is answered without further input."""
    await _ended_by(case, b"\n")


@unreal("input.cr", "CR alone ends a command", "6, no. 23")
async def ends_cr(case: Case) -> None:
    """A command followed by CR alone is answered without further input."""
    await _ended_by(case, b"\r")


@unreal("input.lfcr", "LF CR ends one command", "6, no. 24")
async def ends_lfcr(case: Case) -> None:
    """A command followed by LF CR is answered exactly once."""
    await _ended_by(case, b"\n\r")


@once("input.crlf-lf", "CR LF LF ends one command", "protocol reference, addendum")
async def ends_crlf_lf(case: Case) -> None:
    """A command followed by CR LF and a further LF, as student controllers send it, is answered
    exactly once."""
    await _ended_by(case, b"\r\n\n")


@once("input.packet", "Two commands in one packet", "6, no. 25")
async def one_packet(case: Case) -> None:
    """Two commands in one packet are both executed, in order."""
    robot = await case.spawn()
    await robot.client.send_bytes(b"GETCONF {Type Robot}\r\nGETGEO {Type Robot}\r\n")
    first = await robot.wait(_is_reply, what="reply")
    case.expect(
        first.head == "CONF", f"the first reply to CONF and GEO in one packet is {first}, not CONF"
    )
    await robot.wait("GEO {")


@once("input.bytes", "One byte per packet", "6, no. 26")
async def byte_by_byte(case: Case) -> None:
    """A command sent one byte per packet is executed."""
    client = await case.connect()
    for byte in b"GETSTARTPOSES\r\n":
        await client.send_bytes(bytes([byte]))
        await asyncio.sleep(0.01)
    count = await _answers(client)
    case.expect(count == 1, f"a command of one byte per packet is answered {count} times, not once")


@once("input.split", "A command in two packets", "6, no. 26")
async def split(case: Case) -> None:
    """A command cut within a word, the rest coming later, is executed once."""
    client = await case.connect()
    await client.send_bytes(b"GETSTART")
    await case.clock.sleep(0.2)
    await client.send_bytes(b"POSES\r\n")
    count = await _answers(client)
    case.expect(count == 1, f"a command in two packets is answered {count} times, not once")


@once("input.split-end", "CR and LF in two packets", "6, no. 24")
async def split_end(case: Case) -> None:
    """If a packet ends between CR and LF, the command is executed once, and the next one too."""
    client = await case.connect()
    await client.send_bytes(b"GETSTARTPOSES\r")
    await case.clock.sleep(0.2)
    await client.send_bytes(b"\nGETSTARTPOSES\r\n")
    count = await _answers(client, 2)
    case.expect(count == 2, f"two commands are answered {count} times, not twice")


@once("input.unended", "No end, no execution", "6, no. 27")
async def unended(case: Case) -> None:
    """A command without terminator is not executed until the terminator arrives."""
    client = await case.connect()
    await client.send_bytes(b"GETSTARTPOSES")
    count = await _answers(client, 0)
    case.expect(
        count == 0, f"a command whose line has not ended is answered {count} times, not 0 times"
    )
    await client.send_bytes(b"\r\n")
    count = await _answers(client)
    case.expect(
        count == 1, f"a command is answered {count} times once its line has ended, not once"
    )


@once("input.blank-lines", "Blank lines do nothing", "6, no. 28")
async def blank_lines(case: Case) -> None:
    """Twenty blank lines produce no output and no error."""
    client = await case.connect()
    await client.send_bytes(b"\r\n" * 10 + b"\n" * 5 + b" \t\r\n" * 5)
    lines = await client.listen(0.6)
    case.expect_silence(lines, "blank lines")
    await case.expect_alive(client, "blank lines")


@unreal("input.glued", "Commands glued to a brace", "6, no. 29")
async def glued(case: Case) -> None:
    """A command that follows a closing brace without a line end is executed too:
    `SET {..} {..}DRIVE {..}`."""
    robot = await lit(case)
    await robot.send(
        "SET {Type RFIDReleaser} {Name Gun} {Opcode Release}DRIVE {Light true} {Left 0} {Right 0}"
    )
    case.expect(
        await robot.client.maybe(
            lambda line: line.head == "STA" and line.get("LightToggle") == "True"
        ),
        f"LightToggle of STA is not True within {REPLY:g} s: the DRIVE behind the SET was not "
        "executed",
    )


@unreal("input.glued-requests", "Requests glued together", "6, no. 29")
async def glued_requests(case: Case) -> None:
    """Two requests on one line, the second right behind the brace of the first, are answered."""
    robot = await case.spawn()
    await robot.send("GETCONF {Type Robot}GETGEO {Type Robot}")
    await robot.wait("CONF {")
    await robot.wait("GEO {", what="reply to the second request")


@control("input.init-packet", "INIT and requests in one packet", "6, no. 30 and 1.8")
async def init_packet(case: Case) -> None:
    """INIT, GETCONF and GETGEO in one packet: both replies arrive, in the order of the
    requests."""
    client = await case.connect()
    place = await case.place()
    await client.send(
        case.init(place, case.new_name()), "GETCONF {Type Robot}", "GETGEO {Type Robot}"
    )
    lines = [await client.wait(_is_reply, what="CONF and GEO") for _ in range(2)]
    heads = [line.head for line in lines]
    case.expect(
        heads == ["CONF", "GEO"],
        f"replies to GETCONF and GETGEO behind INIT come as {heads}, not as CONF and GEO",
    )


@once("input.outer-blanks", "Blanks around a command", "6, no. 31")
async def outer_blanks(case: Case) -> None:
    """Leading and trailing blanks and tabs of a line are ignored."""
    client = await case.connect()
    await client.send_bytes(b" \t GETSTARTPOSES \t \r\n")
    count = await _answers(client)
    case.expect(count == 1, f"a command with blanks around it is answered {count} times, not once")


@once(
    "input.before-greeting",
    "Commands may come before the greeting is read",
    "protocol reference, addendum",
)
async def before_greeting(case: Case) -> None:
    """GETSTARTPOSES sent twice right after connecting, before the greeting was read, is answered
    twice."""
    client = await case.connect(greet=False)
    await client.send("GETSTARTPOSES", "GETSTARTPOSES")
    count = await _answers(client, 2)
    case.expect(
        count == 2, f"two commands before the greeting are answered {count} times, not twice"
    )
