"""World controllers, avatars and robots that speak and listen, for the tests of several rooms."""

from __future__ import annotations

import re
from dataclasses import dataclass

import pytest

from usarsim_server.testing import Rehearsal, RehearsedClient

HEIGHT = -0.15
"""z of the middle of a Box on the floor."""


def controller(stage: Rehearsal, name: str = "USARBot.WorldController") -> RehearsedClient:
    """A new connection that is a world controller."""
    connection = stage.connect()
    connection.send(f"INIT {{ClassName {name}}} {{Name WC}} {{Location 0,0,0}}")
    return connection


def control(client: RehearsedClient, kind: str, **segments: str) -> list[str]:
    """Send one CONTROL; returns the answers."""
    client.take()
    text = " ".join(f"{{{key} {value}}}" for key, value in segments.items())
    client.send(f"CONTROL {{Type {kind}}} {text}")
    return client.take()


def create(client: RehearsedClient, name: str, location: str, **segments: str) -> None:
    """Create a box, or another class."""
    kind = segments.pop("ClassName", "Box")
    assert control(client, "Create", ClassName=kind, Name=name, Location=location, **segments) == []


def status(client: RehearsedClient, **filters: str) -> dict[str, dict[str, str]]:
    """GetSTA as a table by name; the line has to be well formed (protocol 171)."""
    (line,) = control(client, "GetSTA", **filters)
    assert re.fullmatch(r"STA( \{[^{}]*\})*", line)
    pairs = [pair.partition(" ")[::2] for pair in re.findall(r"\{([^{}]*)\}", line)]
    assert [key for key, _ in pairs] == (
        ["Name", "Size", "Location", "Memory", "Rotation"] * (len(pairs) // 5)
    )
    rows = [dict(pairs[start : start + 5]) for start in range(0, len(pairs), 5)]
    return {row["Name"]: row for row in rows}


def vector(text: str) -> list[float]:
    """The numbers of a vector as the server prints it."""
    return [float(part) for part in text.split(",")]


def where(client: RehearsedClient, name: str) -> list[float]:
    """Location of an object, wire frame."""
    return vector(status(client, Name=name)[name]["Location"])


def turned(client: RehearsedClient, name: str) -> list[float]:
    """Rotation of an object, wire frame."""
    return vector(status(client, Name=name)[name]["Rotation"])


def near(*place: float, within: float = 2e-3) -> object:
    """A place to compare with; printing cuts digits off."""
    return pytest.approx(place, abs=within)


def ahead(robot: RehearsedClient) -> float:
    """What the middle beam of the newest scan says, m."""
    line = [line for line in robot.lines if "{Type RangeScanner}" in line][-1]
    found = re.search(r"\{Range ([^}]*)\}", line)
    assert found is not None
    values = vector(found.group(1))
    return values[len(values) // 2]


def numbers(line: str, key: str) -> list[float]:
    found = re.search(rf"\{{{key} ([^}}]*)\}}", line)
    assert found is not None, f"no {key} in {line}"
    return [float(part) for part in found.group(1).split(",")]


def last(client: RehearsedClient, wire_type: str) -> str:
    return [line for line in client.lines if f"{{Type {wire_type}}}" in line][-1]


def truth(stage: Rehearsal, client: RehearsedClient) -> tuple[list[float], list[float]]:
    client.take()
    stage.run(0.25)
    line = last(client, "GroundTruth")
    return numbers(line, "Location"), numbers(line, "Orientation")


@dataclass(frozen=True, slots=True)
class Status:
    """One STA of an avatar."""

    time: float
    kind: str
    name: str
    place: list[float]
    turn: list[float]
    walking: bool


def avatar(stage: Rehearsal, place: str = "0,0,-1", **segments: str) -> RehearsedClient:
    """A new avatar."""
    client = stage.connect()
    kind = segments.pop("ClassName", "USARAvatar.USARAvatarNewMale")
    more = " ".join(f"{{{key} {value}}}" for key, value in segments.items())
    client.send(f"INIT {{ClassName {kind}}} {{Location {place}}} {more}")
    return client


def leave(stage: Rehearsal, *clients: RehearsedClient) -> None:
    """Hang up, and let that be known."""
    for client in clients:
        client.close()
    stage.settle()
    stage.run(0.02)


def statuses(client: RehearsedClient) -> list[Status]:
    """All STA since the last call, each well formed."""
    found = [STATUS.fullmatch(line) for line in client.take("STA")]
    assert all(found)
    return [
        Status(
            float(one["time"]),
            one["kind"],
            one["name"],
            [float(part) for part in one["place"].split(",")],
            [float(part) for part in one["turn"].split(",")],
            {"True": True, "False": False}[one["walks"]],
        )
        for one in found
        if one is not None
    ]


STATUS = re.compile(
    r"STA \{Time (?P<time>\d+\.\d{4})\} \{Type (?P<kind>\w+)\} \{Name (?P<name>[^}]*)\} "
    r"\{Location (?P<place>[^ }]*)\} \{Orientation (?P<turn>[^ }]*)\} \{Walking (?P<walks>\w+)\}"
)
