"""A robot in a corridor full of smoke, over real sockets: lasers suffer, sonars do not."""

from __future__ import annotations

import re
from pathlib import Path

from usarsim_server.testing import ScriptedClient, ServerProcess

SCOUT = """
name = "SmokeScout"
extends = "P3AT_real"
dialect = "udk"
sensor = [
    { type = "Hokuyo", name = "urg", position = [0.2, 0, -0.3] },
    { type = "SICK", name = "fogged", position = [0.2, 0, -0.3], smoke = "scatter" },
]
"""


def _ahead(client: ScriptedClient, name: str) -> float:
    """Middle beam of a scanner."""
    line = client.wait_for(
        lambda line: "{Type RangeScanner}" in line and f"{{Name {name}}}" in line
    )
    found = re.search(r"\{Range ([^}]*)\}", line)
    assert found is not None
    ranges = [float(text) for text in found.group(1).split(",")]
    return ranges[len(ranges) // 2]


def _sonar_ahead(client: ScriptedClient) -> float:
    line = client.wait_for(lambda line: "{Type Sonar} {Name F4}" in line)
    found = re.search(r"\{Range ([\d.]+)\}", line)
    assert found is not None
    return float(found.group(1))


def test_lasers_suffer_from_smoke_and_sonars_do_not(tmp_path: Path) -> None:
    """In smoke a Hokuyo reads 0, a scattering laser reads short, the SICK and sonars go on."""
    (tmp_path / "SmokeScout.toml").write_text(SCOUT)
    with ServerProcess("--world", "smoke_corridor", "--robots", str(tmp_path)) as server:
        inside, outside = server.client(), server.client()
        inside.send("INIT {ClassName SmokeScout} {Location 8.0,0,-0.3}")
        outside.send("INIT {ClassName SmokeScout} {Location 1.5,0,-0.3} {Rotation 0,0,3.14159}")
        for client in (inside, outside):
            client.wait_for("STA")
        assert _ahead(inside, "urg") == 0.0
        clear = _ahead(outside, "lms200")
        assert abs(_ahead(outside, "fogged") - clear) < 0.03
        assert _ahead(outside, "urg") > 0.0
        shorter = [_ahead(inside, "fogged") < _ahead(inside, "lms200") - 0.1 for _ in range(8)]
        assert any(shorter), "some echoes come back from the smoke itself"
        assert _sonar_ahead(inside) > 0.5
