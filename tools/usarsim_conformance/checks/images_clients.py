"""Several image clients, slow ones, and those that vanish (side channels reference 2.1, 2.6)."""

from __future__ import annotations

from usarsim_conformance.case import Case
from usarsim_conformance.side_checks import checks_of
from usarsim_conformance.side_images import (
    FRAME_WITHIN,
    OK,
    Facts,
    ImageClient,
    camera_robot,
    facts_of,
    read_frame,
    rectangle,
)
from usarsim_conformance.verdicts import Severity
from usarsim_conformance.wire import Hangup

images = checks_of("images")

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
        case.expect(found == size, f"a client asked for {size} and got {found}")


@images("clients.slow-reader", "Who does not read stops nobody", "11.30, 2.6")
async def slow_reader(case: Case) -> None:
    """While a client lets its pictures pile up, others get theirs, and simulated time goes on."""
    robot = await case.spawn()
    stalled = await ImageClient.open(case)
    await stalled.send(OK * _BACKLOG)
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
    await client.send(OK * 20)
    await case.clock.sleep(5.0)
    for number in range(20):
        frame = await client.frame()
        case.expect(
            frame.kind == facts.kind and frame.size == (facts.width, facts.height),
            f"frame {number + 1} of 20 is of type {frame.kind} and {frame.size}",
        )
    await client.silent(0.5, "as many frames as requests")


@images("clients.vanishes", "Survives clients that vanish", "11.32")
async def vanishes(case: Case) -> None:
    """Clients that reset in the middle of a frame or of a request disturb neither the server nor
    the next client."""
    for request in (OK * 5, b"U\0\0", b"O"):
        client = await ImageClient.open(case)
        await client.send(request)
        if request.startswith(OK):
            await client.wire.read_exactly(100, FRAME_WITHIN)
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
    case.expect(before == after, f"the frame was {before} and is {after}")


# Pictures that nobody asked for.


@images("legacy.frame-first", "Legacy mode sends a frame at once", "11.27, 2.8")
async def frame_first(case: Case) -> None:
    """In legacy mode one full frame comes within a second of connect, and no second one."""
    facts = await _legacy(case)
    wire = await case.open("images")
    size = (await read_frame(wire)).size
    case.expect(size == (facts.width, facts.height), f"the first picture is {size}")
    data = await wire.silence(1.0)
    case.expect(not data, f"{len(data)} bytes follow the first picture")


@images("legacy.two-frames", "Legacy mode answers OK as well", "11.28, 2.8")
async def two_frames(case: Case) -> None:
    """In legacy mode a client that sends OK at once receives exactly two frames."""
    await _legacy(case)
    wire = await case.open("images")
    await wire.send(OK)
    for _ in range(2):
        await read_frame(wire)
    data = await wire.silence(1.0)
    case.expect(not data, f"{len(data)} bytes follow the second picture")


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
async def whole(case: Case) -> None:
    """What comes to a client that stays silent for 4 s, if anything, is one whole full frame."""
    facts = await facts_of(case)
    if facts.pushes:
        case.skip("legacy mode is on")
    wire = await case.open("images")
    data = await wire.silence(4.0)
    if not data:
        return
    length = 5 + int.from_bytes(data[1:5])
    case.expect(data[0] == facts.kind, f"it begins with type {data[0]}")
    case.expect(len(data) == length, f"{len(data)} bytes came, its header names {length}")
    try:
        await wire.send(OK)
        await read_frame(wire)
    except Hangup as error:
        case.fail(f"after the pushed picture {error}")
