"""A robot with an arm and a gripper, over real sockets."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from usarsim_server.testing import ScriptedClient

Connect = Callable[[], ScriptedClient]


def _links(line: str) -> dict[int, float]:
    """Positions by link number of a MISSTA or ASTA line."""
    found = re.findall(r"\{Link (\d+)\} \{Value (-?[\d.]+)\}", line)
    return {int(link): float(value) for link, value in found}


def _settled(client: ScriptedClient, head: str, link: int, target: float) -> bool:
    states = (_links(client.wait_for(head)) for _ in range(150))
    return any(abs(state[link] - target) < 0.02 for state in states)


def test_a_slider_client_moves_an_arm(connect: Connect) -> None:
    """CONF is the line after INIT; ACT counts links from 0, ASTA from 1 (139, 142, 158, 183)."""
    client = connect()
    client.wait_for("NFO {Gametype")
    client.send("INIT {ClassName P3AT_arm} {Location -60,0,-0.3}\r\nGETCONF {Type Actuator}")
    conf = client.read_line()
    assert conf.startswith("CONF {Type Actuator} {Name ")
    name = re.search(r"\{Name (\w+)\}", conf)
    assert name is not None
    links = re.findall(r"\{Link (\d+)\} \{JointType (\w+)\} \{MaxTorque [\d.]+\}", conf)
    assert [int(number) for number, _ in links] == list(range(1, len(links) + 1))
    start = _links(client.wait_for("ASTA {Time"))[1]
    client.send(f"ACT {{Name {name.group(1)}}} {{Link 0}} {{Value {start + 0.4:.3f}}} {{Link 77}}")
    assert _settled(client, "ASTA", 1, start + 0.4)


def test_a_gripper_closes_and_opens(connect: Connect) -> None:
    """SET CLOSE and OPEN show in EFF (check 161)."""
    client = connect()
    client.send("INIT {ClassName P3AT_arm} {Location -60,5,-0.3}\r\nGETCONF {Type Gripper}")
    conf = client.wait_for("CONF {Type Gripper}")
    name = re.search(r"\{Name (\w+)\}", conf)
    assert name is not None
    for opcode, status in (("CLOSE", "CLOSED"), ("OPEN", "OPEN")):
        client.send(f"SET {{Type Gripper}} {{Name {name.group(1)}}} {{Opcode {opcode}}}")
        assert client.wait_for(lambda line, end=status: line.endswith(f"{{Status {end}}}"))


@pytest.mark.parametrize("order", ["", " {Order 0}"])
def test_a_pan_tilt_of_the_old_generation(connect: Connect, order: str) -> None:
    """MISPKG counts links from 1, MISSTA reports them, GETGEO names the carrier (140, 141, 157)."""
    client = connect()
    client.send(f"INIT {{ClassName P2AT}} {{Location -70,{5 + len(order)},-0.3}}")
    client.send("GETGEO {Type MisPkg}")
    assert "{ParentLink -1}" in client.wait_for("GEO {Type MisPkg} {Name CameraPanTilt}")
    client.send(f"MISPKG {{Name CameraPanTilt}} {{Link 1}} {{Value 0.15}}{order}")
    assert _settled(client, "MISSTA", 1, 0.15)
