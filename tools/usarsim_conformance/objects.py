"""Objects that a world controller puts into the world (protocol reference 3.14)."""

from __future__ import annotations

import math

from usarsim_conformance.case import Case
from usarsim_conformance.control import ControlClient
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place


async def controller(case: Case) -> ControlClient:
    """A connection that is a world controller.

    Raises:
        NotApplicable: if the server has none.
    """
    client = await case.connect()
    await client.send("INIT {ClassName USARBot.WorldController} {Name WC} {Location 0,0,0}")
    await client.send("CONTROL {Type GetSTA} {Name NoSuchObject}")
    if await client.maybe(lambda line: line.head == "STA") is None:
        case.skip("the server has no world controller")
    return client


_BUILDS = 45.0
"""s of simulated time for an answer behind a Create: servers may build what is new beside the
running world, one thing after the other."""


async def status_of(client: ControlClient, name: str) -> Line:
    """What GetSTA tells of an object; a bare `STA` if it does not exist."""
    return await client.ask(
        f"CONTROL {{Type GetSTA}} {{Name {name}}}",
        lambda line: line.head == "STA",
        _BUILDS,
        "STA",
    )


async def create(
    case: Case,
    client: ControlClient,
    place: Place,
    size: tuple[float, float, float],
    extra: str = "",
) -> str:
    """A block, its middle at a place; its name.

    Args:
        case: the check.
        client: a world controller.
        place: of its middle.
        size: m along x, y, z.
        extra: further segments, with a blank before.

    Raises:
        NotApplicable: if there is no class Cube of one metre that can be scaled.
    """
    name = case.new_name()
    scale = ",".join(f"{side:g}" for side in size)
    physics = "" if "{Physics" in extra else " {Physics None}"
    await client.send(
        f"CONTROL {{Type Create}} {{ClassName Cube}} {{Name {name}}} {{Memory red}}"
        f" {place.coordinates} {{Scale {scale}}}{physics} {{Permanent false}}{extra}"
    )
    line = await status_of(client, name)
    if line.get("Name") != name:
        case.skip(f"no object of class Cube could be created: {line}")
    told = line.numbers("Size")
    case.expect(
        len(told) == 3
        and all(abs(a - b) < 0.01 + 0.01 * b for a, b in zip(told, size, strict=True)),
        f"Size of a Cube of 1 m with Scale {scale} is {line.get('Size')}",
    )
    case.need(all(map(math.isfinite, told)), f"Size is none: {line}")
    return name
