"""Words and segments of what clients send (protocol reference 6.3)."""

from __future__ import annotations

from usarsim_conformance.case import Case
from usarsim_conformance.registry import Severity, once, unreal


async def _conf_answers(case: Case, command: str, reply: str = "CONF {") -> None:
    """A spelling of GETCONF is understood."""
    robot = await case.spawn()
    line = await robot.client.ask(command, reply)
    case.expect(
        "SteeringType" in line.text or line.get("Name"),
        f"the reply to {command!r} is {line}, not one of the robot",
    )


@once("grammar.case", "Command words and names in any case", "6, no. 32")
async def any_case(case: Case) -> None:
    """Command words and segment names are matched without regard to case."""
    await _conf_answers(case, "getConf {TYPE Robot}")


@once("grammar.value-case", "Types in any case", "1.6")
async def value_case(case: Case) -> None:
    """The Type of a request is matched without regard to case."""
    await _conf_answers(case, "GETCONF {Type rObOt}")


@once("grammar.no-blanks", "Segments without blanks between", "6, no. 33")
async def no_blanks(case: Case) -> None:
    """A command whose segments follow without blanks is accepted."""
    await _conf_answers(case, "GETCONF{Type Robot}{Name x}")


@once("grammar.inner-blanks", "Blanks within braces", "6, no. 34")
async def inner_blanks(case: Case) -> None:
    """Blanks around the name and the value of a segment are ignored."""
    await _conf_answers(case, "GETCONF {  Type   Robot  }   {Name x}")


@unreal("grammar.tabs", "Tabs within braces", "1.5", Severity.SHOULD)
async def tabs(case: Case) -> None:
    """A tab parts name and value like a blank."""
    await _conf_answers(case, "GETCONF {Type\tRobot}")


@unreal("grammar.junk", "Text between segments", "6, no. 35")
async def junk(case: Case) -> None:
    """Text between segments that is no command is ignored."""
    await _conf_answers(case, "GETCONF {Name x} junk {Type Robot}")


@unreal("grammar.open-brace", "A segment that does not end", "6, no. 36")
async def open_brace(case: Case) -> None:
    """Segments before one whose brace is never closed are used."""
    await _conf_answers(case, "GETCONF {Type Robot} {Name")


@unreal("grammar.bare-name", "A segment without a value", "6, no. 37")
async def bare_name(case: Case) -> None:
    """Segments behind one that has a name only, or nothing, are used."""
    await _conf_answers(case, "GETCONF {Bad} {} {Type Robot}")


@unreal("grammar.stray-brace", "A stray closing brace", "6, no. 38")
async def stray_brace(case: Case) -> None:
    """A closing brace without an opening one is ignored."""
    await _conf_answers(case, "GETCONF } {Type Robot}")


@unreal("grammar.first-wins", "The first of two equal names counts", "6, no. 39")
async def first_wins(case: Case) -> None:
    """Of two segments with the same name the first counts."""
    await _conf_answers(case, "GETCONF {Type Robot} {Type NoSuchType}")


@once("grammar.no-open-brace", "A command without an opening brace", "1.7")
async def no_open_brace(case: Case) -> None:
    """A command whose first brace is missing is ignored and does no harm."""
    robot = await case.spawn()
    lines = await robot.client.outcome("GETCONF Type Robot}")
    found = [line for line in lines if line.head == "CONF" and line.type != "Camera"]
    case.expect_silence(found, "GETCONF without its first brace")
    await case.expect_alive(robot.client, "a command without its first brace")


@once("grammar.unknown-command", "Unknown commands are ignored", "6, no. 41")
async def unknown_command(case: Case) -> None:
    """Unknown commands cause no output, and the connection goes on."""
    client = await case.connect()
    lines = await client.outcome(
        "FLY {High 1}", "HELLO", "INITIALISE {ClassName x}", "42", "{Type Robot}"
    )
    case.expect_silence(lines, "unknown commands")
    await case.expect_alive(client, "unknown commands")


@once("grammar.old-commands", "Commands of other eras do no harm", "3.12 and 3.15")
async def old_commands(case: Case) -> None:
    """TRACE, PAUSE, KILL, TEST and other names that were once commands do no harm."""
    robot = await case.spawn()
    await robot.send(
        "TRACE {On true} {Interval 0.5} {Color Red}",
        "TRACE {On false}",
        "PAUSE",
        "TEST",
        "KILL",
        "POSALL",
        "TURN",
        "SETBALL",
        "FACTORY",
        "SENSOR",
        "EFFECTOR",
        "CAMERA {Pan 1}",
    )
    await robot.wait("STA")
    await case.expect_alive(robot.client, "commands that are no longer used")


@once("grammar.unknown-segment", "Unknown segments are ignored", "6, no. 42")
async def unknown_segment(case: Case) -> None:
    """Segments that a command does not know are ignored."""
    await _conf_answers(case, "GETCONF {Colour red} {Type Robot} {Size 3 x 4}")


@once("grammar.before-init", "Robot commands before INIT are ignored", "1.7")
async def before_init(case: Case) -> None:
    """Commands for a robot that come before INIT are ignored silently."""
    client = await case.connect()
    lines = await client.outcome(
        "DRIVE {Left 1} {Right 1}",
        "GETCONF {Type Robot}",
        "GETGEO {Type Robot}",
        "SET {Type Camera} {Opcode Zoom} {Params 1}",
    )
    case.expect_silence(lines, "commands before INIT")
    await case.spawn(client=client)
