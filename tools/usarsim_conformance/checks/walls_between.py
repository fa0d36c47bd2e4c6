"""What walls between two robots do to GETOBS, signal strengths, roads and links (side channels
reference 3.3, 4.3, 4.5 and 5.2)."""

from __future__ import annotations

import math

from usarsim_conformance.case import Case
from usarsim_conformance.registry import Severity, checks_of
from usarsim_conformance.stations import WALL, Stop, stops

truth = checks_of("groundtruth")
wireless = checks_of("wireless")
comserver = checks_of("comserver")

_MOVED = 0.3
_WALLED = 0.2
"""dB by which a difference may be off."""


@truth("getobs.walls", "Every wall counts once", "3.3 and 11.56")
async def walls(case: Case) -> None:
    """ObstCount is the number of walls between two robots, or between two points: each counts
    once, whatever its thickness."""
    found = await stops(case)
    for stop in (found["near"], found["one"], found["three"], found["seven"]):
        case.expect(
            stop.points == stop.walls,
            f"ObstCount from Start to End is {stop.points:g}, not {stop.walls}: {stop} (side "
            "channels reference 3.3: each surface that is met counts once)",
        )


@truth("getobs.moved", "Walls count from where robots are", "3.3")
async def moved(case: Case) -> None:
    """ObstCount From one robot To another is that of the line between where both are now; one that
    a world controller puts behind walls, and back, was elsewhere when it was spawned."""
    for stop in (await stops(case)).values():
        case.expect(
            stop.between == stop.walls,
            f"ObstCount From robot To robot is {stop.between:g}, not {stop.walls}: {stop}, 0 where "
            "it was spawned (side channels reference 3.3: from the places of the robots)",
        )


def _compare(
    case: Case, what: str, values: tuple[float, float], at: tuple[Stop, Stop], slack: float
) -> None:
    (before, after), (one, other) = values, at
    case.need(math.isfinite(before), f"{what} {one} is {before}")
    lost = 10.0 * math.log10(other.distance / one.distance) + WALL * (other.walls - one.walls)
    case.expect(
        abs(before - after - lost) < slack,
        f"{what} falls by {before - after:.2f} dB from {before:g} ({one}) to {after:g} ({other}), "
        f"not by {lost:.2f} (side channels reference 4.5: 10 dB for the tenfold distance, 6.325 "
        "for each wall)",
    )


@wireless("getss.moved", "The strength follows robots that move", "4.5 and 4.6", Severity.SHOULD)
async def strength_moved(case: Case) -> None:
    """From 2 to 20 m Strength falls by 10.0 dB, within 0.3 dB, by the default parameters; when the
    robot is back, it is what it was."""
    found = await stops(case)
    for name in ("far", "back"):
        at = found["near"], found[name]
        _compare(case, "Strength", (at[0].strength, at[1].strength), at, _MOVED)


@wireless("getss.walls", "Walls weaken a signal", "4.5", Severity.SHOULD)
async def strength_walls(case: Case) -> None:
    """Each wall between takes 6.325 dB of Strength by the model with obstacles, three of them 19.0
    dB; within 0.2 dB."""
    found = await stops(case)
    for name in ("one", "three", "seven"):
        at = found["near"], found[name]
        _compare(case, "Strength", (at[0].strength, at[1].strength), at, _WALLED)


@wireless("relay.out-of-range", "Roads close out of range", "4.3, 11.75")
async def out_of_range(case: Case) -> None:
    """Below -93 dBm who connects to a port of DNS is refused or hung up on, and connections that
    there were end; back in range the port accepts again."""
    found = await stops(case)
    beyond, back = found["seven"], found["back"]
    weak = f"at {beyond.law:.1f} dBm by the default parameters, below -93 ({beyond})"
    case.expect(
        not beyond.carries,
        f"the Port of DNS accepts a connection and keeps it {weak}: it is not closed (side "
        "channels reference 4.3)",
    )
    case.expect(
        not beyond.lives,
        f"a connection through a road is not closed {weak} (side channels reference 4.3)",
    )
    case.expect(
        back.carries, f"the Port of DNS takes no connection at {back.law:.1f} dBm again ({back})"
    )


@comserver("getss.walls", "Distance and walls weaken a signal", "5.2 and 4.5", Severity.SHOULD)
async def level_walls(case: Case) -> None:
    """GETSS of ComServer tells the strength of the model with obstacles: 10 dB less at the tenfold
    distance, 6.325 dB less for each wall; within 0.3 dB. Not asked of a server without a model."""
    found = await stops(case)
    if math.isnan(found["near"].level):
        case.skip("ComServer tells no strength")
    for name in ("far", "one", "three", "back"):
        at = found["near"], found[name]
        _compare(case, "the number of OK:", (at[0].level, at[1].level), at, _MOVED)


@comserver("open.out-of-range", "Links are refused out of range", "5.2")
async def link_out_of_range(case: Case) -> None:
    """OPEN of two robots below -93 dBm is answered by `Fail: Cannot connect to`, in range by OK.
    Not asked of a server without a model."""
    found = await stops(case)
    near, beyond = found["near"], found["seven"]
    if math.isnan(near.level):
        case.skip("ComServer has no model")
    case.need(near.link == "OK", f"OPEN was answered by {near.link!r} {near}")
    case.expect(
        beyond.link.startswith("Fail: Cannot connect to"),
        f"OPEN at {beyond.law:.1f} dBm is answered by {beyond.link!r}, not by 'Fail: Cannot "
        f"connect to ...': {beyond} (side channels reference 5.2, cutoff -93 dBm)",
    )
