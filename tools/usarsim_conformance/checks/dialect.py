"""How a server that speaks several dialects chooses one (protocol reference 6.11)."""

from __future__ import annotations

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.lines import Line
from usarsim_conformance.registry import ONCE, UNREAL, check
from usarsim_conformance.survey import dialect_of
from usarsim_conformance.verdicts import Severity

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


@check(
    "control.dialect.default",
    "A UT2004 robot speaks ut2004",
    source="protocol reference 6, no. 174",
    dialects=ONCE,
)
async def default(case: Case) -> None:
    """INIT with ClassName of a UT2004 robot and nothing else gives ut2004 shapes."""
    robot = await _u4_class(case)
    place = await case.place()
    line = await _streamed(case, f"INIT {{ClassName USARBot.{robot}}} {place.segments}")
    case.expect(dialect_of(line) == "ut2004", f"{line}")


@check(
    "control.dialect.classname",
    "Classname switches to udk",
    source="protocol reference 6, no. 173",
    dialects=ONCE,
)
async def classname(case: Case) -> None:
    """INIT with `Classname` gives udk shapes from the first streamed line."""
    robot = await _u4_class(case)
    place = await case.place()
    line = await _streamed(case, f"INIT {{Classname USARBot.{robot}}} {place.segments}")
    case.expect(dialect_of(line) == "udk", f"{line}")


@check(
    "control.dialect.actuator",
    "GETCONF of Actuator switches to udk",
    source="protocol reference 6, no. 175",
    dialects=ONCE,
)
async def actuator(case: Case) -> None:
    """`GETCONF {Type Actuator}` directly after INIT switches to udk."""
    robot = await _u4_class(case)
    place = await case.place()
    line = await _streamed(
        case, f"INIT {{ClassName USARBot.{robot}}} {place.segments}", "GETCONF {Type Actuator}"
    )
    case.expect(dialect_of(line) == "udk", f"{line}")


@check(
    "control.dialect.forced",
    "Dialect forces a dialect",
    source="protocol reference 6, no. 176",
    dialects=UNREAL,
)
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
    case.expect(dialect_of(line) == case.dialect, f"{line}")


@check(
    "control.dialect.side-by-side",
    "Two dialects at a time",
    source="protocol reference 6, no. 178",
    dialects=ONCE,
)
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
            case.expect(dialect_of(line) == dialect, f"not {dialect}: {line}")


@check(
    "control.dialect.steady",
    "A dialect does not flicker",
    source="protocol reference 5.3",
    dialects=UNREAL,
    severity=Severity.SHOULD,
)
async def steady(case: Case) -> None:
    """All STA lines of a connection have one shape."""
    robot = await case.spawn()
    lines = [line for line in await robot.run(1.0) if line.head == "STA"]
    shapes = {(dialect_of(line), line.names) for line in lines}
    case.expect(len(shapes) == 1, f"{len(shapes)} shapes of STA")
