"""World controllers (protocol reference 6.10)."""

from __future__ import annotations

import math
from functools import partial

from usarsim_conformance.case import Case
from usarsim_conformance.control import ControlClient
from usarsim_conformance.objects import controller, status_of
from usarsim_conformance.registry import ONCE, check
from usarsim_conformance.verdicts import Severity

_HIGH = -40.0
"""m, wire z of the objects that checks create, out of every robot's way."""


async def _gone(client: ControlClient, name: str) -> bool:
    return (await status_of(client, name)).text == "STA"


def _row(case: Case) -> float:
    """A y of its own for every object: none is created where another one is."""
    return 2.0 * next(case.run.numbers)


async def _create(case: Case, client: ControlClient, x: float = 0.0) -> tuple[str, float]:
    """An object at x and a y of its own; its name and that y."""
    name, y = case.new_name(), _row(case)
    await client.send(
        f"CONTROL {{Type Create}} {{ClassName Box}} {{Name {name}}} {{Memory red}}"
        f" {{Location {x},{y},{_HIGH}}} {{Rotation 0,0,0}} {{Physics None}} {{Permanent false}}"
    )
    return name, y


async def _created(case: Case) -> tuple[ControlClient, str, float]:
    client = await controller(case)
    name, y = await _create(case, client)
    line = await status_of(client, name)
    if line.get("Name") != name:
        case.skip(f"no object of class Box could be created: {line}")
    return client, name, y


@check(
    "control.world.silent",
    "CONTROL answers nothing but GetSTA",
    source="protocol reference 3.14",
    dialects=ONCE,
)
async def silent(case: Case) -> None:
    """Create, AbsMove and Kill have no reply."""
    client, name, y = await _created(case)
    lines = await client.outcome(
        f"CONTROL {{Type AbsMove}} {{Name {name}}} {{Location 1,{y},{_HIGH}}} {{Rotation 0,0,0}}",
        f"CONTROL {{Type Kill}} {{Name {name}}}",
        "CONTROL {Type NoSuchType}",
        "CONTROL",
    )
    case.expect(not lines, f"something was answered: {lines[:1]}")


@check(
    "control.world.no-controller",
    "CONTROL needs a world controller",
    source="protocol reference 6, no. 167",
    dialects=ONCE,
)
async def nocontroller(case: Case) -> None:
    """CONTROL is ignored on a connection of a robot."""
    robot = await case.spawn()
    lines = await robot.client.outcome("CONTROL {Type GetSTA}")
    found = [line for line in lines if line.head == "STA" and "Size" in line.text]
    case.expect(not found, f"it was answered: {found[:1]}")


@check(
    "control.world.moves",
    "Objects are created, moved and killed",
    source="protocol reference 6, no. 168",
    dialects=ONCE,
)
async def moves(case: Case) -> None:
    """After Create, AbsMove and RelMove GetSTA tells the new place; after Kill a bare `STA`."""
    client, name, y = await _created(case)
    await client.send(
        f"CONTROL {{Type AbsMove}} {{Name {name}}} {{Location 2,{y},{_HIGH}}} {{Rotation 0,0,0}}",
        f"CONTROL {{Type RelMove}} {{Name {name}}} {{Location 1,0,0}} {{Rotation 0,0,0}}",
    )

    async def moved() -> bool:
        at = (await status_of(client, name)).numbers("Location")
        return len(at) == 3 and math.dist(at, (3.0, y, _HIGH)) < 0.05

    case.expect(await case.soon(moved, 3.0), f"it is not at 3,{y},{_HIGH}")
    await client.send(f"CONTROL {{Type Kill}} {{Name {name}}}")
    case.expect(await case.soon(partial(_gone, client, name), 3.0), "it is still there")


@check(
    "control.world.form",
    "GetSTA has balanced braces",
    source="protocol reference 6, no. 171",
    dialects=ONCE,
    severity=Severity.SHOULD,
)
async def form(case: Case) -> None:
    """GetSTA tells Name, Size, Location, Memory, Rotation, each in braces of its own, sizes above
    zero."""
    client, name, _ = await _created(case)
    line = await status_of(client, name)
    case.expect(line.text.count("{") == line.text.count("}"), f"unbalanced: {line}")
    case.expect(line.names == ("Name", "Size", "Location", "Memory", "Rotation"), f"{line}")
    case.expect(all(size > 0.0 for size in line.numbers("Size")), f"{line}")


@check(
    "control.world.same-name",
    "A name is taken once",
    source="protocol reference 6, no. 169",
    dialects=ONCE,
)
async def same_name(case: Case) -> None:
    """Creating an existing name leaves the first object untouched."""
    client, name, y = await _created(case)
    await client.send(
        f"CONTROL {{Type Create}} {{ClassName Box}} {{Name {name}}} {{Location 9,{y},{_HIGH}}}"
    )
    await client.listen(0.3)
    line = await status_of(client, name)
    case.expect(abs(line.numbers("Location")[0]) < 0.1, f"it was replaced: {line}")


@check(
    "control.world.kill-all",
    "KillAll with a box",
    source="protocol reference 6, no. 170",
    dialects=ONCE,
    exclusive=True,
)
async def kill_all(case: Case) -> None:
    """KillAll with a box removes only objects strictly inside, whichever corner comes first."""
    client, inside, y = await _created(case)
    outside, _ = await _create(case, client, x=5.0)
    corners = f"{{MinPos 1,{y + 1},{_HIGH + 1}}} {{MaxPos -1,{y - 1},{_HIGH - 1}}}"
    await client.send(f"CONTROL {{Type KillAll}} {corners}")
    inside_gone = await case.soon(partial(_gone, client, inside), 3.0)
    case.expect(inside_gone, "the object inside is still there")
    line = await status_of(client, outside)
    case.expect(line.get("Name") == outside, "the object outside is gone")


@check(
    "control.world.cleans-up",
    "Objects leave with their controller",
    source="protocol reference 6, no. 172",
    dialects=ONCE,
    severity=Severity.SHOULD,
)
async def cleans_up(case: Case) -> None:
    """Closing the world controller's connection removes its objects."""
    client, name, _ = await _created(case)
    client.close()
    other = await controller(case)
    gone = await case.soon(partial(_gone, other, name), 3.0)
    case.expect(gone, "the object is still there 3 s later")
