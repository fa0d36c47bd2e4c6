"""Image clients: requests and how they are cut, several clients, slow ones, and those that vanish
(side channels reference 2.1, 2.2, 2.6)."""

from __future__ import annotations

import asyncio

from usarsim_client.pictures import FULL_FRAME, rectangle
from usarsim_conformance.case import Case
from usarsim_conformance.registry import Severity, checks_of
from usarsim_conformance.side_images import (
    FRAME_LEAST_WALL,
    FRAME_WITHIN,
    Facts,
    ImageClient,
    camera_robot,
    facts_of,
    read_frame,
)
from usarsim_conformance.wire import Hangup

images = checks_of("images")

_QUIET = 0.5
"""s of silence after which nothing more is expected."""


async def _one_frame(case: Case, request: bytes, shown: str) -> ImageClient:
    client = await ImageClient.open(case)
    frame = await client.ask(request)
    case.expect(
        frame.payload,
        f"{shown} is answered by {len(frame.payload)} bytes of payload, not by a picture",
    )
    await client.ends(f"the one frame that {shown} asks for")
    return client


async def _nothing_then_one(case: Case, request: bytes, shown: str) -> None:
    client = await ImageClient.open(case)
    await client.send(request)
    await client.silent(_QUIET, shown)
    await client.ask(FULL_FRAME)
    await client.ends(f"{shown} and one OK")


@images("connect.without-robot", "Serves before there are robots", "11.1, 2.1")
async def without_robot(case: Case) -> None:
    """The image port accepts and answers clients that have no robot; the socket is independent
    of robots."""
    client = await ImageClient.open(case)
    frame = await client.ask()
    case.expect(frame.size > (0, 0), f"the full frame is {frame.size} pixels, not above (0, 0)")


@images("connect.silent", "Says nothing before it is asked", "11.2, 2.1")
async def silent(case: Case) -> None:
    """Unless legacy mode is on, a silent client gets nothing for 1 s: no banner, no picture."""
    wire = await case.open("images")
    data = await wire.silence(1.0)
    if data and len(data) == 5 + int.from_bytes(data[1:5]):
        case.skip("it pushes a picture to new clients, as legacy mode does")
    case.expect(not data, f"{len(data)} bytes came without a request, not 0")


@images("connect.idle", "Has no idle timeout", "2.1")
async def idle(case: Case) -> None:
    """A client may stay silent as long as it likes and is answered afterwards."""
    client = await ImageClient.open(case)
    await client.ask()
    await client.silent(4.0, "a frame, though nothing was asked for")
    await client.ask()


@images("request.ok", "OK gets one frame", "11.3")
async def ok(case: Case) -> None:
    """The two bytes `OK` without a line end are answered by exactly one frame."""
    await _one_frame(case, FULL_FRAME, "OK")


@images("request.ok-crlf", "OK with CR LF gets one frame", "11.4")
async def ok_crlf(case: Case) -> None:
    """CR and LF after OK are skipped as unknown bytes; they bring no second frame."""
    await _one_frame(case, b"OK\r\n", "OK with CR LF")


@images("request.crlf-ok", "CR LF before OK is skipped", "11.5")
async def crlf_ok(case: Case) -> None:
    """CR and LF before OK are skipped as unknown bytes."""
    await _one_frame(case, b"\r\nOK", "CR LF and OK")


@images("request.lower-case", "ok in lower case is no request", "11.6")
async def lower_case(case: Case) -> None:
    """Requests are case-sensitive: `ok` gets no answer, and a following `OK` one frame."""
    await _nothing_then_one(case, b"ok", "ok in lower case")


@images("request.ook", "The byte after O is always consumed", "11.7", Severity.SHOULD)
async def ook(case: Case) -> None:
    """`OOK` is no request, for the second O is used up by the first; `OK` behind it is one."""
    await _nothing_then_one(case, b"OOK", "OOK")


@images("request.ok-in-halves", "OK may come in halves", "11.8")
async def ok_in_halves(case: Case) -> None:
    """`O` and `K` sent half a second apart are one request."""
    client = await ImageClient.open(case)
    await client.send(b"O")
    await client.silent(0.5, "O alone")
    await client.send(b"K")
    await client.frame()
    await client.ends("O and K")


@images("request.pipelined", "Five requests get five frames", "11.9, 2.2")
async def pipelined(case: Case) -> None:
    """Requests are neither coalesced nor dropped: five OK in one write give five frames."""
    client = await ImageClient.open(case)
    await client.send(FULL_FRAME * 5)
    for _ in range(5):
        frame = await client.frame()
        case.expect(frame.size[0], f"the size of one of five frames is {frame.size}, not above 0")
    await client.ends("five frames for five requests")


@images("request.rapid", "Answers requests every 10 ms", "11.33, 2.6")
async def rapid(case: Case) -> None:
    """Requests every 10 ms are all answered, with repeated pictures if need be."""
    client = await ImageClient.open(case)
    for _ in range(25):
        await client.send(FULL_FRAME)
        await asyncio.sleep(0.01)
    for number in range(25):
        frame = await client.frame()
        case.expect(
            frame.size[0], f"the size of frame {number + 1} of 25 is {frame.size}, not above 0"
        )


@images("request.junk", "Skips bytes that are no request", "2.2")
async def junk(case: Case) -> None:
    """All bytes but O and U are skipped without an answer, whatever they are."""
    others = bytes(byte for byte in range(256) if byte not in b"OU")
    await _nothing_then_one(case, others * 4, "1016 bytes of junk")


@images("request.much-junk", "Skips a megabyte of junk", "2.2", Severity.SHOULD)
async def much_junk(case: Case) -> None:
    """The server neither stores unknown bytes nor loses the request behind a megabyte of them."""
    client = await ImageClient.open(case)
    await client.send(b"x" * 1_000_000)
    await client.ask()
    await client.ends("one OK behind a megabyte of junk")


@images("request.telnet", "Survives a text protocol", "2.7", Severity.SHOULD)
async def telnet(case: Case) -> None:
    """A client that took the wrong port and speaks the control protocol gets no reply (its text
    has no `OK` and no `U`) and does no harm."""
    await _nothing_then_one(case, b"GETSTARTPOSES\r\nDRIVE {Left 1}\r\n", "commands of robots")


# Rectangles.


@images("rectangle.whole", "The whole frame as a rectangle", "11.20")
async def whole(case: Case) -> None:
    """`U` with the rectangle of the whole frame gives a picture of the same size as OK."""
    client = await ImageClient.open(case)
    width, height = (await client.ask()).size
    size = (await client.ask(rectangle(0, 0, width, height))).size
    case.expect(
        size == (width, height),
        f"U of the whole frame gives a picture of {size}, not {(width, height)}, as OK",
    )


@images("rectangle.size", "A rectangle has the size asked for", "11.21, 2.2")
async def size(case: Case) -> None:
    """`U` with a rectangle inside the frame gives a picture of exactly that size."""
    client = await ImageClient.open(case)
    facts = client.facts
    for x, y, width, height in ((0, 0, 16, 8), (5, 3, facts.width // 2, facts.height // 3)):
        frame = await client.ask(rectangle(x, y, width, height))
        case.expect(
            frame.size == (width, height),
            f"OK gives a picture of {frame.size}, not {(width, height)}",
        )


@images("rectangle.big-endian", "Rectangles are big-endian", "2.2")
async def big_endian(case: Case) -> None:
    """The four integers of `U` are unsigned, 32 bits wide and big-endian: a server that reads them
    the other way round finds every rectangle out of its frame."""
    client = await ImageClient.open(case)
    frame = await client.ask(rectangle(1, 2, 40, 30))
    case.expect(
        not frame.empty,
        f"a rectangle of 40 x 30 at 1, 2 is answered by {len(frame.payload)} bytes, as one out of "
        "the frame, not by a picture",
    )
    case.expect(
        frame.size == (40, 30),
        f"a rectangle of 40 x 30 gives a picture of {frame.size}, not (40, 30)",
    )


@images("rectangle.qt-padding", "Zero bytes before U are skipped", "11.22, 2.2")
async def qt_padding(case: Case) -> None:
    """Qt clients send `U` as a 32-bit number: `00 00 00 55` and a rectangle give one frame and
    no extra bytes."""
    await _one_frame(case, bytes(3) + rectangle(0, 0, 64, 48), "00 00 00 55 and a rectangle")


@images("rectangle.byte-by-byte", "U may come byte by byte", "11.23")
async def byte_by_byte(case: Case) -> None:
    """A request of 17 bytes that arrives one byte at a time is one request."""
    client = await ImageClient.open(case)
    for byte in rectangle(0, 0, 64, 48):
        await client.send(bytes([byte]))
        await asyncio.sleep(0.01)
    frame = await client.frame()
    case.expect(
        frame.size == (64, 48),
        f"a rectangle of 64 x 48 gives a picture of {frame.size}, not (64, 48)",
    )
    await client.ends("one U, byte by byte")


@images("rectangle.binary", "Arguments of U are no requests", "11.24")
async def binary(case: Case) -> None:
    """The sixteen bytes after `U` are binary: `OK` and `U` among them are not taken as requests."""
    client = await ImageClient.open(case)
    numbers = (int.from_bytes(b"OKOK"), int.from_bytes(b"UUUU"), 0x4F4B, 0x55)
    await client.ask(rectangle(*numbers))
    await client.ends("one U whose arguments look like requests")


@images("rectangle.followed", "Bytes after the 17th are new requests", "11.26")
async def followed(case: Case) -> None:
    """`U`, its rectangle and `OK` in one write are two requests, answered in this order."""
    client = await ImageClient.open(case)
    await client.send(rectangle(0, 0, 32, 24) + FULL_FRAME + rectangle(0, 0, 24, 32))
    facts = client.facts
    sizes = [(await client.frame()).size for _ in range(3)]
    wanted = [(32, 24), (facts.width, facts.height), (24, 32)]
    case.expect(
        sizes == wanted,
        f"pictures of U, OK and U in one write have the sizes {sizes}, not {wanted}",
    )
    await client.ends("U, OK and U")


async def _odd(case: Case, *rectangles: tuple[int, int, int, int]) -> None:
    client = await ImageClient.open(case)
    for numbers in rectangles:
        await client.ask(rectangle(*numbers))
        await client.silent(0.2, f"one reply to the rectangle {numbers}")
    frame = await client.ask()
    case.expect(
        frame.size[0], f"OK after odd rectangles gives a frame of {frame.size}, not above 0"
    )


@images("rectangle.outside", "A rectangle outside is answered once", "11.25, 2.7")
async def outside(case: Case) -> None:
    """A rectangle out of the frame gets exactly one reply, and the connection stays usable."""
    facts = await facts_of(case)
    await _odd(case, (facts.width, 0, 320, 240), (0, facts.height + 7, 10, 10))


@images("rectangle.crossing", "A rectangle across the border is answered once", "2.7")
async def crossing(case: Case) -> None:
    """A rectangle that is partly out of the frame gets exactly one reply."""
    facts = await facts_of(case)
    await _odd(case, (facts.width - 10, facts.height - 10, 20, 20))


@images("rectangle.nothing", "A rectangle without area is answered once", "2.7")
async def nothing(case: Case) -> None:
    """A width or height of zero gets exactly one reply."""
    await _odd(case, (0, 0, 0, 10), (0, 0, 10, 0), (0, 0, 0, 0))


@images("rectangle.huge", "Rectangles cannot overflow", "2.7")
async def huge(case: Case) -> None:
    """The largest numbers, and sums beyond 32 bits, get one reply like every other rectangle."""
    most = 0xFFFFFFFF
    await _odd(case, (most,) * 4, (most - 15, 0, 32, 16), (0, 0, most, most), (1 << 31, 0, 4, 4))


@images("rectangle.empty-form", "What an empty picture looks like", "11.25, 2.7", Severity.SHOULD)
async def empty_form(case: Case) -> None:
    """Outside the frame the picture has no pixels: raw 0 x 0, or a JPEG reply without payload."""
    client = await ImageClient.open(case)
    frame = await client.ask(rectangle(client.facts.width, 0, 320, 240))
    wanted = bytes(4) if frame.raw else b""
    case.expect(
        frame.payload == wanted,
        f"the picture of a rectangle out of the frame has {len(frame.payload)} bytes of payload, "
        f"not {len(wanted)}",
    )


_BACKLOG = 60
"""Requests of a client that does not read; far more than the socket buffers hold as frames."""


@images("clients.several", "Several clients at a time", "2.1")
async def several(case: Case) -> None:
    """Clients are served independently; each gets the pictures that it asked for."""
    clients = [await ImageClient.open(case) for _ in range(8)]
    sizes = [(16 + 8 * number, 16) for number in range(len(clients))]
    for client, size in zip(clients, sizes, strict=True):
        await client.send(rectangle(0, 0, *size))
    for client, size in zip(clients, sizes, strict=True):
        found = (await client.frame()).size
        case.expect(
            found == size,
            f"a client that asked for a picture of {size} gets one of {found}, not that",
        )


@images("clients.slow-reader", "Who does not read stops nobody", "11.30, 2.6")
async def slow_reader(case: Case) -> None:
    """While a client lets its pictures pile up, others get theirs, and simulated time goes on."""
    robot = await case.spawn()
    stalled = await ImageClient.open(case)
    await stalled.send(FULL_FRAME * _BACKLOG)
    other = await ImageClient.open(case)
    for _ in range(3):
        await other.ask()
    await robot.run(1.0)


@images("clients.resumes", "A stream survives a pause of its reader", "11.31, 2.6")
async def resumes(case: Case) -> None:
    """A client that stops reading for some time and goes on finds every frame whole, one for each
    of its requests."""
    client = await ImageClient.open(case)
    facts = client.facts
    await client.send(FULL_FRAME * 20)
    await case.clock.sleep(5.0)
    for number in range(20):
        frame = await client.frame()
        case.expect(
            frame.kind == facts.kind and frame.size == (facts.width, facts.height),
            f"frame {number + 1} of 20 has type {frame.kind} and size {frame.size}, not "
            f"{facts.kind} and {(facts.width, facts.height)}",
        )
    await client.ends("as many frames as requests")


@images("clients.vanishes", "Survives clients that vanish", "11.32")
async def vanishes(case: Case) -> None:
    """Clients that reset in the middle of a frame or of a request disturb neither the server nor
    the next client."""
    for request in (FULL_FRAME * 5, b"U\0\0", b"O"):
        client = await ImageClient.open(case)
        await client.send(request)
        if request.startswith(FULL_FRAME):
            await client.wire.read_exactly(100, FRAME_WITHIN, FRAME_LEAST_WALL)
        client.wire.reset()
    await (await ImageClient.open(case)).ask()


@images("clients.half-close", "Answers who has sent end of file", "2.1", Severity.INFORMATIVE)
async def half_close(case: Case) -> None:
    """A client that ends its sending side behind a request still gets the picture."""
    client = await ImageClient.open(case)
    await client.send(rectangle(0, 0, 320, 200))
    client.wire.half_close()
    await client.frame()


@images("clients.robot-leaves", "Outlives robots", "11.35, 2.1")
async def robot_leaves(case: Case) -> None:
    """When a robot is removed, image connections stay, and the frame keeps its size."""
    client = await ImageClient.open(case)
    watcher = await camera_robot(case)
    before = (await client.ask()).size
    watcher.robot.close()
    await case.clock.sleep(1.5)
    after = (await client.ask()).size
    case.expect(
        before == after, f"the full frame is {after} after a robot left, not {before}, as before"
    )


# Pictures that nobody asked for.


@images("legacy.frame-first", "Legacy mode sends a frame at once", "11.27, 2.8")
async def frame_first(case: Case) -> None:
    """In legacy mode one full frame comes within a second of connect, and no second one."""
    facts = await _legacy(case)
    wire = await case.open("images")
    size = (await read_frame(wire)).size
    case.expect(
        size == (facts.width, facts.height),
        f"the first picture is {size}, not {(facts.width, facts.height)}",
    )
    data = await wire.silence(1.0)
    case.expect(not data, f"{len(data)} bytes follow the first picture, not 0")


@images("legacy.two-frames", "Legacy mode answers OK as well", "11.28, 2.8")
async def two_frames(case: Case) -> None:
    """In legacy mode a client that sends OK at once receives exactly two frames."""
    await _legacy(case)
    wire = await case.open("images")
    await wire.send(FULL_FRAME)
    for _ in range(2):
        await read_frame(wire)
    data = await wire.silence(1.0)
    case.expect(not data, f"{len(data)} bytes follow the second picture, not 0")


async def _legacy(case: Case) -> Facts:
    facts = await facts_of(case)
    if not facts.pushes:
        case.skip("legacy mode is off")
    return facts


@images("push.not-for-askers", "Who has asked is not pushed to", "11.29, 2.12")
async def not_for_askers(case: Case) -> None:
    """A server may push a picture to a client that stays silent; never to one whose first request
    came within half a second."""
    client = await ImageClient.open(case)
    await case.clock.sleep(0.1)
    await client.ask()
    await client.silent(3.5, "the answer to a request in the first half second")


@images("push.whole", "A pushed picture is a frame", "2.8, 2.12", Severity.SHOULD)
async def whole_pushes(case: Case) -> None:
    """What comes to a client that stays silent for 4 s, if anything, is one whole full frame."""
    facts = await facts_of(case)
    if facts.pushes:
        case.skip("legacy mode is on")
    wire = await case.open("images")
    data = await wire.silence(4.0)
    if not data:
        return
    length = 5 + int.from_bytes(data[1:5])
    case.expect(data[0] == facts.kind, f"the picture begins with type {data[0]}, not {facts.kind}")
    case.expect(len(data) == length, f"{len(data)} bytes came, not {length}, as the header names")
    try:
        await wire.send(FULL_FRAME)
        await read_frame(wire)
    except Hangup as error:
        case.fail(f"OK after the pushed picture has no answer: {error}")
