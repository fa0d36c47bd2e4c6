"""Damaged and hostile UDK packages: one clear error, bounded work."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from udk_maps import TABLE, room
from unreal_fixture import (
    Map,
    Name,
    Object,
    Ref,
    Struct,
    Structs,
    box_nodes,
    box_triangles,
    convex,
    static_mesh,
    vector,
)

from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context, read_scene
from usarsim_server.errors import MapImportError

# ---- damage --------------------------------------------------------------------------------


def rich() -> bytes:
    """A package with a bit of everything."""
    made = room()
    body = [("ConvexElems", Structs([convex([(0, 0, 0), (9, 0, 0), (0, 9, 0), (0, 0, 9)])]))]
    mesh = static_mesh(made, "Box", box_triangles((0, 0, 0), (50, 50, 50))[:4], body=body)
    made.placed("KActor", "Ball_0", Ref(mesh), [("Tag", Name("Ball"))])
    made.placed("StaticMeshActor", "Table_0", TABLE)
    made.actor("MaleVictim", "MaleVictim_0", [("DrawScale3D", vector(1, 1, 2))])
    made.actor("PathNode", "PathNode_0", [("Location", vector(1, 1, 2))])
    lamp = made.actor("PointLight", "PointLight_0")
    inner = made.add(Object("PointLightComponent", "PointLightComponent_0", lamp))
    inner.properties = [("Radius", 500.0)]
    lamp.properties.append(("LightComponent", Ref(inner)))
    made.built(box_nodes((-500, -500, 0), (500, 500, 750)), outside=0)
    return made.content()


RICH = rich()
FUZZ = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@given(st.data())
@FUZZ
def test_flipped_bytes(tmp_path: Path, data: st.DataObject) -> None:
    """A package with some bytes changed is read, or refused in one line (item 72)."""
    content = bytearray(RICH)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.sampled_from([0, 1, 2, 0x7F, 0x80, 0xFF, content[place] ^ 1]))
    attempt(tmp_path, bytes(content))


def test_words_out_of_range(tmp_path: Path) -> None:
    """Large and negative numbers in any place are noticed (item 72)."""
    chosen = random.Random(5)
    for _ in range(300):
        content = bytearray(RICH)
        place = chosen.randrange(0, len(content) - 4)
        struct.pack_into("<i", content, place, chosen.choice([-1, 1 << 30, -(1 << 31), 65536]))
        attempt(tmp_path, bytes(content))


def attempt(folder: Path, content: bytes) -> None:
    """Read a package; only one kind of error may come, in one line that names the file."""
    source = folder / "fuzz.udk"
    source.write_bytes(content)
    told = ""
    try:
        read_scene(source)
    except MapImportError as error:
        told = str(error)
    assert not told or told.startswith(str(source))
    assert "\n" not in told


def test_objects_in_each_other(tmp_path: Path) -> None:
    """A million references to the same object do not take a million times its size."""
    made = Map()
    big = made.add(Object("Thing", "Thing_0"))
    big.properties = [(f"P{n}", Struct("S", bytes(16))) for n in range(2000)]
    mesh = Ref("Furniture.Kitchen.Table", "StaticMesh")
    for number in range(200):
        made.placed("StaticMeshActor", f"A_{number}", mesh).archetype = big
    (tmp_path / "loop.udk").write_bytes(made.content())
    findings = Findings()
    read_scene(tmp_path / "loop.udk", Context(findings=findings))
    assert any("over and over" in w.text for w in findings.warnings())


def test_essential_objects(tmp_path: Path) -> None:
    """A brush that cannot be read is an error that names it; a lamp is only left out (item 72)."""
    made = room()
    brush = next(item for item in made.objects if item.kind == "Polys")
    made.actor("PointLight", "Lamp_0", [("LightComponent", Ref(brush))])
    brush.tail[0] = struct.pack("<2i", 1 << 20, 0)
    (tmp_path / "map.udk").write_bytes(made.content())
    with pytest.raises(MapImportError, match=r"byte \d+: Room: 1048576 polygons"):
        read_scene(tmp_path / "map.udk")
