"""Opens the level `server` for a scenario: its own server, or one that is there already."""

from __future__ import annotations

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.levels.rover import Place
from usarsim_exploration.levels.server import ServerLevel
from usarsim_exploration.levels.serving import WorldServer
from usarsim_exploration.scenario import Scenario
from usarsim_server.base.addresses import bare_host
from usarsim_server.base.errors import at


def open_level(scenario: Scenario, connect: str = "") -> ServerLevel:
    """Bring the team of a scenario into a world with physics.

    Args:
        connect: `HOST[:PORT[:WIRELESS]]` of a server in lockstep that runs the same world, as
            `usarsim explore worlds NAME --out` writes it; empty: start one.

    Raises:
        ExplorationError: the scenario has what servers have not; or there is no server.
    """
    for event in scenario.events:
        if event.kind in ("close", "open"):
            cure = "write backend = grid, or leave it out"
            raise ExplorationError(at("event", f"{event.text}: walls of servers stay", cure))
    physics, environment = scenario.physics, scenario.world.environment
    place = _place(connect) if connect else _own(scenario)
    try:
        return ServerLevel(
            physics, scenario.team, environment.shape, environment.cell, scenario.radio, place,
            metres=scenario.rules.starts,
        )  # fmt: skip
    except BaseException:
        if place.own is not None:
            place.own.close()
        raise


def _own(scenario: Scenario) -> Place:
    ranges = [one.radio_range for one in scenario.team if one.radio_range > 0.0]
    reach = min(ranges, default=1.0)  # who has none is silent
    own = WorldServer(
        scenario.world, scenario.radio, reach, scenario.basics.seed, scenario.physics.control
    )
    return Place(own.host, own.control, own.wireless, own)


def _place(text: str) -> Place:
    inside, bracket, rest = text.rpartition("]")
    host, *ports = rest.split(":") if bracket else text.split(":")
    host = bare_host(inside + bracket + host)
    try:
        numbers = [int(one) for one in ports]
        if len(numbers) > 2 or not host or any(not 0 < one < 65536 for one in numbers):
            raise ValueError
    except ValueError:
        cure = "write HOST, HOST:PORT or HOST:PORT:WIRELESS, an IPv6 host in brackets"
        raise ExplorationError(at("--connect", f"{text!r} is no address", cure)) from None
    control, wireless = [*numbers, *(3000, 50000)[len(numbers) :]]
    return Place(host, control, wireless)
