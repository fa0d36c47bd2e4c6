"""A server whose world is a map of another program, over sockets."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from signalled import finished

from usarsim_server.testing import ServerProcess

LOW, HIGH = (-500.0, -500.0, 0.0), (500.0, 500.0, 600.0)
"""A room of 4 x 4 x 2.4 m, in Unreal units."""

FACES = ["lll llh lhh lhl", "hll hhl hhh hlh", "lll hll hlh llh"]
FACES += ["lhl lhh hhh hhl", "lll lhl hhl hll", "llh hlh hhh lhh"]
"""Corners by low (l) or high (h) x, y, z; ordinary cross products point outwards."""


def vertex(corner: str) -> str:
    """One line of a polygon."""
    values = [HIGH[k] if letter == "h" else LOW[k] for k, letter in enumerate(corner)]
    return "Vertex " + ",".join(f"{value:+013.6f}" for value in values)


def level() -> str:
    """One room with a start to the right of its middle, and a person."""
    polygons = "\n".join(
        "Begin Polygon\n" + "\n".join(map(vertex, face.split())) + "\nEnd Polygon" for face in FACES
    )
    return (
        "Begin Map\nBegin Level\n"
        f"Begin Actor Class=Brush Name=Room\nBegin Brush\nBegin PolyList\n{polygons}\n"
        "End PolyList\nEnd Brush\nCsgOper=CSG_Subtract\nEnd Actor\n"
        "Begin Actor Class=PlayerStart Name=PlayerStart_0\n"
        'Location=(X=-125,Y=250,Z=60)\nTag="Home"\nEnd Actor\n'
        "Begin Actor Class=FemaleVictim Name=FemaleVictim_3\n"
        "Location=(X=300,Y=-300,Z=60)\nEnd Actor\n"
        "End Level\nEnd Map\n"
    )


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The map, and a cache of its own for the server's process."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "Room.t3d"
    path.write_text(level())
    return path


def test_a_map_is_served(source: Path) -> None:
    """`serve --world MAP` tells the map's starts; a laser there sees the map's walls (worlds 25,
    56)."""
    with ServerProcess("--world", str(source)) as server, server.client() as client:
        assert "{Level Room}" in client.wait_for("NFO {Gametype")
        client.send("GETSTARTPOSES")
        poses = client.wait_for("NFO {StartPoses")
        assert "{Home -0.5000,1.0000,-0.2400 0.0000,0.0000,0.0000}" in poses
        client.send("INIT {ClassName USARBot.P2AT} {Name R} {Start Home}")
        scan = client.wait_for(lambda line: "{Type RangeScanner}" in line and "{Range " in line)
        ranges = re.search(r"\{Range ([^}]*)\}", scan)
        assert ranges is not None
        beams = [float(value) for value in ranges[1].split(",")]
        # Scans run from right to left: a wall 1 m to the right, 2.5 m ahead, 3 m to the left.
        assert beams[0] == pytest.approx(1.0, abs=0.05)
        assert beams[len(beams) // 2] == pytest.approx(2.5, abs=0.3)
        assert beams[-1] == pytest.approx(3.0, abs=0.05)


def test_a_broken_map_is_refused(source: Path) -> None:
    """One line on standard error with file and line, exit code 2, no traceback (item 73)."""
    source.write_text(level()[:900])
    done = finished("serve", "--world", str(source), "--port", "0")
    assert done.returncode == 2
    assert re.search(r"error: .*Room\.t3d: line \d+: ", done.stderr)
    assert "Traceback" not in done.stderr
