"""Maps that robots cannot live in: what users are told, and what robots do (item 71)."""

from __future__ import annotations

from pathlib import Path

import pytest
from built_worlds import build_world, cuboid_mesh, mesh_of, scene_of, thing
from t3d_maps import level, room, start

from usarsim_server.cli import main
from usarsim_server.importers.convert import Request, import_map
from usarsim_server.importers.findings import Findings
from usarsim_server.importers.scene import Mesh
from usarsim_server.testing import Rehearsal

WALLS = [(0, 0, 0), (4, 0, 0), (4, 0, 3), (0, 0, 3), (0, 4, 0), (4, 4, 0), (4, 4, 3), (0, 4, 3)]


def walls() -> Mesh:
    """Two upright rectangles."""
    return mesh_of(WALLS, [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)])


def notes(findings: Findings, subject: str) -> list[str]:
    """What was said about something."""
    return [warning.text for warning in findings.warnings() if warning.subject == subject]


def test_starts_in_walls_and_below_floors(tmp_path: Path) -> None:
    """Each is named with what will happen and what to do; a good one is not."""
    source = tmp_path / "odd.t3d"
    places = [("InWall", (520, 0, 60)), ("Below", (0, 0, -40)), ("Good", (0, 0, 60))]
    starts = [start(f"PlayerStart_{n}", place, tag) for n, (tag, place) in enumerate(places)]
    source.write_text(level(room(), *starts))
    result = import_map(Request(source))
    told = {subject: text for subject, text, _ in result.report.warnings}
    for name in ("InWall", "Below"):
        assert "solid" in told[name]
        assert "sidecar" in told[name]
    assert "Good" not in told
    with Rehearsal(world=str(result.folder)) as rehearsal:
        alive, fallen = rehearsal.connect(), rehearsal.connect()
        alive.send("INIT {ClassName USARBot.P2AT} {Name A} {Start Good}")
        fallen.send("INIT {ClassName USARBot.P2AT} {Name B} {Start Below}")
        rehearsal.run(4.0)
        assert fallen.take("DIE {Killer None}"), "it falls below the world, and its client is told"
        assert not alive.take("DIE")
        rehearsal.run(0.5)
        assert alive.take("STA"), "the other goes on"


def test_a_map_without_floor(tmp_path: Path) -> None:
    """Walls alone can be imported, but the report says that robots will fall, and the cures."""
    findings = Findings()
    world = build_world(tmp_path, scene_of(thing(walls(), "walls")), findings)
    (text,) = notes(findings, "level")
    assert "only 0 % of the map have a floor" in text
    assert "--up" in text
    with Rehearsal(world=str(world.built.folder)) as rehearsal:
        client = rehearsal.connect()
        client.send("INIT {ClassName USARBot.P2AT} {Location 2,-2,-1}")
        rehearsal.run(5.0)
        assert client.take("DIE {Killer None}")


def test_a_floor_is_not_complained_about(tmp_path: Path) -> None:
    """With a floor under the same walls nothing is said."""
    findings = Findings()
    floor = thing(cuboid_mesh((0, 0, -0.2), (4, 4, 0)), "floor")
    build_world(tmp_path, scene_of(thing(walls(), "walls"), floor), findings)
    assert not notes(findings, "level")


@pytest.mark.parametrize(("size", "cure"), [(30_000.0, "--scale 1000"), (0.03, "--scale 0.001")])
def test_absurd_sizes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: float, cure: str
) -> None:
    """A map a thousand times too large or small: one line with sizes and a scale, code 2."""
    source = tmp_path / "odd.obj"
    corners = [(0, 0, 0), (size, 0, 0), (size, 0, -size), (0, 0, -size)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    source.write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4"]) + "\n")
    assert main(["import", str(source), "--out", str(tmp_path / "out")]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert str(source) in line
    assert f"{size:g} x {size:g} x 0 m large" in line
    assert cure in line
    assert "e+" not in line
    assert not (tmp_path / "out" / "odd").exists()
