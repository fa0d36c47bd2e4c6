"""Arms over sockets: the slider tool of the original, and a camera that is turned."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator

import pytest

from usarsim_server.testing import ScriptedClient, running_server

REPORTS = 200
"""Until when a link has to be where it was told to go, 20 s of simulated time or more."""


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """The control port of a server with an empty world, at ten times real time."""
    with running_server(world="empty", speed=10.0) as (_, endpoints):
        yield endpoints["control"].port


def test_sliders_for_an_arm(port: int) -> None:
    """The SliderController finds its links in the first line after the greeting (142, 183).

    It sends INIT and GETCONF at once, reads exactly one line, cuts it at blanks, and moves links
    that it counts from 0.
    """
    with ScriptedClient(port) as client:
        client.send_bytes(
            b"INIT {ClassName USARBot.KR60} {Location 0,0,0}\nGETCONF {Type Actuator}\n"
        )
        assert client.read_line().startswith("NFO {Gametype")
        tokens = client.read_line().split(" ")
        assert tokens[:5] == ["CONF", "{Type", "Actuator}", "{Name", "KR60Arm}"]
        keys = ("{Link", "{JointType", "{MinValue", "{MaxValue")
        fields: dict[str, list[str]] = {key: [] for key in keys}
        for key, value in itertools.pairwise(tokens):
            if key in fields:
                fields[key].append(value.rstrip("}"))
        assert fields["{Link"] == ["1", "2", "3", "4", "5", "6"]
        assert set(fields["{JointType"]) == {"Revolute"}
        assert [float(low) for low in fields["{MinValue"]][1] == pytest.approx(-2.356)
        assert [float(high) for high in fields["{MaxValue"]][1] == pytest.approx(0.61)
        client.send("ACT {Name KR60Arm} {Link 0} {Value 0.50} {Link 1} {Value -0.25}", "\n")
        for _ in range(REPORTS):
            line = client.wait_for("ASTA")
            found = re.match(
                r"ASTA \{Time [\d.]+\} \{Name KR60Arm\} \{Link 1\} \{Value ([\d.-]+)\} "
                r"\{Link 2\} \{Value ([\d.-]+)\} ",
                line,
            )
            assert found is not None
            if abs(float(found[1]) - 0.5) < 1e-3 and abs(float(found[2]) + 0.25) < 1e-3:
                return
        pytest.fail(f"the arm did not arrive: {line}")


def test_a_camera_is_turned(port: int) -> None:
    """A client of the other generation reads MISSTA of the pan-tilt that it moves."""
    with ScriptedClient(port) as client:
        client.send("INIT {ClassName USARBot.P2AT} {Location 5,0,-0.25}")
        client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 0.20} {Link 2} {Value -0.10}")
        for _ in range(REPORTS):
            line = client.wait_for("MISSTA")
            found = re.fullmatch(
                r"MISSTA \{Time \d+\.\d\d\} \{Name CameraPanTilt\} \{Link 1\} "
                r"\{Value (-?\d\.\d{4})\} \{Torque -?\d+\.\d\d\} \{Link 2\} "
                r"\{Value (-?\d\.\d{4})\} \{Torque -?\d+\.\d\d\}",
                line,
            )
            assert found is not None, line
            if abs(float(found[1]) - 0.2) < 1e-3 and abs(float(found[2]) + 0.1) < 1e-3:
                return
        pytest.fail(f"the camera did not arrive: {line}")
