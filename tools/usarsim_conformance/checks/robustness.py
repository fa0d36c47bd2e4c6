"""Bad input, floods and clients that do not read (protocol reference 6.1, no. 16 to 20)."""

from __future__ import annotations

import contextlib
import random
import re

from usarsim_conformance.case import Case
from usarsim_conformance.clock import Stalled
from usarsim_conformance.control import ControlClient, Robot
from usarsim_conformance.registry import Failed, Severity, once

_GARBAGE_LINES = 1000
_LONG_LINE = 65536
_LONGEST = 1 << 20
_FLOOD_WITHIN = 60.0
"""s of simulated time in which two thousand commands are worked off."""
_SCANS = 700
"""A megabyte of scans: more than sockets hold, less than may cost a client its connection."""


async def _obeys(case: Case, robot: Robot) -> None:
    """The connection still answers, and the robot still streams."""
    await case.expect_alive(robot.client, "what was sent")
    await robot.wait(lambda line: line.head == "STA", what="STA")


@once("robust.garbage", "Random bytes are survived", "6, no. 19")
async def garbage(case: Case) -> None:
    """The connection stays open after 1000 lines of random bytes, and a valid command sent
    afterwards works."""
    robot = await case.spawn()
    # Reproducible: the same bytes in every run.
    dice = random.Random(19)
    for _ in range(10):
        lines = (dice.randbytes(dice.randint(1, 60)) for _ in range(_GARBAGE_LINES // 10))
        await robot.client.send_bytes(b"\r\n".join(lines) + b"\r\n")
    await _obeys(case, robot)


@once("robust.near-misses", "Nearly right commands are survived", "1.7")
async def near_misses(case: Case) -> None:
    """Commands with braces, blanks and values in wrong places, and truncated ones, do no harm."""
    robot = await case.spawn()
    dice = random.Random(7)
    good = (
        "DRIVE {Left 1} {Right -1}", "SET {Type Camera} {Name Camera} {Opcode Zoom} {Params 0.3}",
        "GETGEO {Type Sonar}", "MISPKG {Name CameraPanTilt} {Link 1} {Value 0.1}",
        "ACT {Name x} {Link 0} {Value 1}", "MULTIDRIVE {FRFlipper 0.5}",
        "CONTROL {Type AbsMove} {Name x} {Location 1,2,3}", "MOVE {Type Run} {Location 1,2}",
    )  # fmt: skip
    spoiled = []
    for _ in range(400):
        text = list(dice.choice(good))
        for _ in range(dice.randint(1, 4)):
            place = dice.randrange(len(text))
            match dice.randrange(3):
                case 0:
                    text[place] = dice.choice("{} \t,.-0Ax")
                case 1:
                    text.insert(place, dice.choice("{}{} ,"))
                case _:
                    text = text[: place + 1]
        spoiled.append("".join(text))
    await robot.send(*spoiled, "DRIVE {Left 0} {Right 0}")
    await _obeys(case, robot)


@once("robust.long-line", "A line of 65536 bytes is processed", "6, no. 20")
async def long_line(case: Case) -> None:
    """A line of 65536 bytes is processed."""
    robot = await case.spawn()
    start, end = "GETCONF {Comment ", "} {Type Robot}"
    filler = "x" * (_LONG_LINE - len(start) - len(end) - 2)
    await robot.send(start + filler + end)
    await robot.wait("CONF {")


@once("robust.endless-line", "A line without end is discarded", "6, no. 20")
async def endless_line(case: Case) -> None:
    """A line of 1 MiB without terminator is discarded, and the connection survives."""
    robot = await case.spawn()
    for _ in range(16):
        await robot.client.send_bytes(b"DRIVE {Left 9" * (_LONGEST // 16 // 13 + 1))
    await robot.client.send_bytes(b"\r\n")
    await _obeys(case, robot)


@once("robust.many-segments", "A command of a thousand segments", "6, no. 20", Severity.SHOULD)
async def many_segments(case: Case) -> None:
    """A command with a thousand segments is read: the last of them counts."""
    robot = await case.spawn()
    await robot.send("GETCONF " + "{A 1}" * 1000 + " {Type Robot}")
    await robot.wait("CONF {")


@once("robust.flood", "A flood of commands is executed", "protocol reference, addendum")
async def flood(case: Case) -> None:
    """Two thousand DRIVE commands in a row, more than a client that answers every line, are worked
    off: a request behind them is answered. Servers may let who sends so much wait for others."""
    robot = await case.spawn()
    for _ in range(20):
        await robot.send(*["DRIVE {Left 0.1} {Right 0.1}"] * 100)
    await case.expect_alive(robot.client, "2000 DRIVE commands", _FLOOD_WITHIN)


@once("robust.request-flood", "A flood of requests is answered", "6, no. 18")
async def request_flood(case: Case) -> None:
    """Two hundred requests in one packet are all answered."""
    robot = await case.spawn()
    await robot.send(*["GETGEO {Type Robot}"] * 200)
    count = 0
    while count < 200 and await robot.client.maybe("GEO {") is not None:
        count += 1
    case.expect(count == 200, f"{count} of 200 requests are answered, not all")


@once("robust.init-flood", "INIT over and over", "6, no. 79", Severity.SHOULD)
async def init_flood(case: Case) -> None:
    """Two hundred further INIT commands on a connection do no harm."""
    robot = await case.spawn()
    await robot.send(*[case.init(robot.place, robot.name)] * 200)
    await _obeys(case, robot)


@once("robust.long-names", "Very long names and numbers", "1.7")
async def long_names(case: Case) -> None:
    """A robot name of 2000 characters and numbers of 2000 digits do no harm: an INIT with such a
    name may be refused, and then another one works on the same connection."""
    place, client = await case.place(), await case.connect()
    digits = "1" * 2000
    await client.send(case.init(place, case.new_name() + "n" * 2000))
    robot = await case.spawn(place=place, client=client)
    await robot.send(
        f"DRIVE {{Left {digits}}} {{Right -{digits}}}",
        f"DRIVE {{Left 0.{digits}}}",
        "DRIVE {Left 0} {Right 0}",
        f"MISPKG {{Name x}} {{Link {digits}}} {{Value 1}}",
        f"SET {{Type INS}} {{Opcode POSE}} {{Params {','.join([digits] * 9)}}}",
    )
    await _obeys(case, robot)
    for line in await robot.run(0.5):
        case.expect(
            not re.search(r"[ ,](nan|inf)", line.text, re.I),
            f"a line has nan or inf, not a number: {line}",
        )


@once("robust.far-away", "Places far away", "1.7", Severity.SHOULD, exclusive=True)
async def far_away(case: Case) -> None:
    """INIT with a location beyond all worlds, or none that is a number, harms nobody else: other
    robots go on."""
    other = await case.spawn()
    for location in ("1e30,1e30,-1e30", "nan,nan,nan", "9999999,0,0", "x,y,z"):
        client = await case.connect()
        await client.send(
            f"INIT {{ClassName USARBot.{case.robot_class}}} {{Name {case.new_name()}}}"
            f" {{Location {location}}}{case.dialect_segment}"
        )
        await client.listen(0.6)
        client.close()
    await other.run(0.8)
    pose = await other.pose()
    case.expect(
        abs(pose.location[0]) < 1e6,
        f"Location of another robot is {pose.location}, not within 1e6 m",
    )


@once("robust.slow-reader", "A client that does not read stops nobody", "6, no. 16", exclusive=True)
async def slow_reader(case: Case) -> None:
    """A client that stops reading does not stop the simulation: another robot's time advances, and
    its requests are answered."""
    watcher = await case.spawn()
    lazy = await case.spawn(client=await case.connect(tiny=True))
    await watcher.run(0.5)
    with contextlib.suppress(Failed):  # the server may refuse to take more of it
        for _ in range(25):
            await lazy.send(*["GETGEO {Type Sonar}", "GETGEO {Type Robot}"] * 100)
    try:
        await watcher.run(3.0)
        await case.expect_alive(watcher.client, "a flood for another client, which does not read")
    except Stalled as error:
        case.fail(f"Time does not advance beside a client that does not read: {error}")
    lazy.close()


@once(
    "robust.late-reader",
    "A client that reads late reads whole lines",
    "6, no. 17 and 18",
    exclusive=True,
)
async def late_reader(case: Case) -> None:
    """A client that does not read for seconds while it asks for measurements gets whole, well
    formed lines when it reads again, and the reply to its request among them."""
    robot = await case.spawn(client=await case.connect(tiny=True))
    await robot.send(*["SET {Type RangeScanner} {Opcode SCAN}"] * _SCANS)
    await case.clock.sleep(2.5)
    await robot.send("GETSTARTPOSES")
    while (line := await robot.client.line()) is not None:
        whole = re.fullmatch(r"[A-Z]+( ?\{[^{}]*\})* ?", line.text)
        case.expect(whole, f"what comes is not a whole line: {line}")
        if line.head == "NFO" and "StartPoses" in line.names:
            return
    case.fail(f"GETSTARTPOSES has no answer behind {_SCANS} scans to a client that reads late")


@once("robust.reset-reader", "A client that resets while not reading", "6, no. 14")
async def reset_reader(case: Case) -> None:
    """A client that stopped reading and then resets its connection harms nobody."""
    watcher = await case.spawn()
    lazy = await case.spawn()
    await lazy.send(*["GETGEO {Type Robot}"] * 500)
    await case.clock.sleep(0.5)
    lazy.client.wire.reset()
    await _obeys(case, watcher)


@once("robust.torn-command", "Hanging up in the middle of a command", "6, no. 14")
async def torn_command(case: Case) -> None:
    """A connection that ends in the middle of a command, with and without a robot, harms
    nobody."""
    watcher = await case.spawn()
    client: ControlClient = await case.connect()
    await client.send_bytes(b"INIT {ClassName USARBot.")
    client.close()
    robot = await case.spawn()
    await robot.client.send_bytes(b"DRIVE {Left 3} {Ri")
    robot.close()
    await _obeys(case, watcher)


@once("robust.isolated", "Clients do not read each other's lines", "1.1")
async def isolated(case: Case) -> None:
    """Replies go to whoever asked; a silent connection beside a busy one stays silent."""
    silent = await case.connect()
    robot = await case.spawn()
    await robot.send(*["GETCONF {Type Robot}", "GETSTARTPOSES"] * 10)
    await robot.run(0.5)
    line = await silent.line(0.3)
    case.expect(line is None, f"a silent connection is told {line}, not nothing")
