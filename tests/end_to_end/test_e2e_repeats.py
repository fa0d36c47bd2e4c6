"""Equal seed, world and command times give equal bytes, for every class, across processes."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence

import pytest

from usarsim_server.data import data_directory
from usarsim_server.testing import ScriptedClient, ServerProcess

CLASSES = sorted(path.stem for path in data_directory("robots").glob("*.toml"))
TOGETHER = 12
"""Classes in one world."""
SECONDS = 2.0
"""Simulated s that are compared."""
TICKS = 5
"""Ticks of 0.1 s between two orders."""

ORDERS = (
    "DRIVE {Left 0.8} {Right 1.1}",
    "DRIVE {Speed 0.6} {FrontSteer 0.2} {RearSteer 0.0}",
    "DRIVE {AltitudeVelocity 0.4} {LinearVelocity 0.3} {LateralVelocity 0.0} "
    "{RotationalVelocity 0.2} {Normalized False}",
    "DRIVE {Propeller 0.5} {Rudder 0.1} {SternPlane 0.1}",
    "DRIVE {WheelNumber 1} {WheelSpeed 1.0} {WheelSteer 0.1}",
    "DRIVE {Name HeadYaw} {Steertype 1} {Angle 0.3}",
    "MULTIDRIVE {FRFlipper 0.4} {FLFlipper 0.4}",
    "SET {Type Joint} {Name HeadPitch} {Opcode Angle} {Params 0.2}",
    "MISPKG {Name CameraPanTilt} {Link 1} {Value 0.4} {Order 0}",
    "ACT {Name Arm} {Link 1} {Value 0.3}",
    "GETCONF {Type Robot}",
    "GETGEO {Type Robot}",
)
"""For every kind of machine, and questions in between; each obeys what it understands."""


def script() -> str:
    """All that a controller says after INIT, sent at once."""
    lines = [f"SYNC {{Ticks {TICKS}}}"]
    for order in ORDERS:
        lines += [order] if order.startswith("GET") else [order, "SYNC"]
    return "\r\n".join([*lines, f"SYNC {{Ticks {round(10 * SECONDS)}}}"]) + "\r\n"


def listen(client: ScriptedClient, heard: list[str]) -> None:
    """Keep every line up to the last tick of the script."""
    ticks = script().count("SYNC")
    while ticks:
        heard.append(client.read_line())
        ticks -= heard[-1].startswith("NFO {Status Tick}")


def play(classes: Sequence[str], *options: str) -> list[list[str]]:
    """What the controllers of some robots hear in one process."""
    heard: list[list[str]] = [[] for _ in classes]
    most = str(len(classes))
    arguments = ("--world", "empty", "--lockstep", "--seed", "11", "--max-robots", most, *options)
    with ServerProcess(*arguments) as server:
        clients = []
        for number, name in enumerate(classes):
            client = server.client()
            # Close enough to be in each other's way, and in each other's scans.
            place = f"{1.8 * (number % 6):.1f},{1.8 * (number // 6):.1f},-0.5"
            client.send(f"INIT {{ClassName USARBot.{name}}} {{Location {place}}}")
            while not client.read_line().startswith("NFO {Status Tick}"):
                pass
            clients.append(client)
        threads = [
            threading.Thread(target=listen, args=(client, lines), daemon=True)
            for client, lines in zip(clients, heard, strict=True)
        ]
        for thread in threads:
            thread.start()
        for client in clients:
            client.socket.sendall(script().encode())
        for thread in threads:
            thread.join()
        for client in clients:
            client.close()
    return heard


def assert_equal(first: list[list[str]], again: list[list[str]], classes: Sequence[str]) -> None:
    """No line differs, and there was something to compare."""
    for name, one, other in zip(classes, first, again, strict=True):
        differing = [pair for pair in zip(one, other, strict=False) if pair[0] != pair[1]]
        assert not differing, (name, differing[0])
        assert len(one) == len(other), name
        assert sum(line.startswith("STA") for line in one) >= 10 * SECONDS / 5, name


@pytest.mark.parametrize(
    "classes",
    [CLASSES[start : start + TOGETHER] for start in range(0, len(CLASSES), TOGETHER)],
    ids=lambda classes: f"{classes[0]}-{classes[-1]}",
)
def test_every_class_repeats(classes: list[str]) -> None:
    """Two processes tell the same to the letter, with robots in each other's way."""
    assert_equal(play(classes), play(classes), classes)


@pytest.mark.parametrize("count", [1, 32])
def test_teams_repeat(count: int) -> None:
    """One robot alone, and thirty-two of four kinds, among them one that reports every 0.01 s."""
    classes = (("Nao", "P3AT", "P2AT", "Kenaf") * count)[:count]
    assert_equal(play(classes), play(classes), classes)


def alone(name: str) -> list[str]:
    """What a robot in the fastest world tells whose controller says all it has to say at once."""
    heard: list[str] = []
    init = f"INIT {{ClassName USARBot.{name}}} {{Start RobotStart1}}"
    options = ("--world", "arena", "--speed", "max", "--seed", "3")
    with ServerProcess(*options) as server, server.client() as client:
        client.socket.sendall("\r\n".join((init, *ORDERS, "")).encode())
        while not heard or not re.search(r"\{Time 4\.", heard[-1]):
            heard.append(client.read_line())
    return heard


@pytest.mark.parametrize("name", ["Nao", "P3AT", "Talon"])
def test_the_fastest_world_repeats(name: str) -> None:
    """Without lockstep, too, if the controller leaves nothing to chance."""
    assert alone(name) == alone(name)
