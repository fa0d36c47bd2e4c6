"""Maps of UDK: brushes, starts and the rest, as in the same maps as T3D; from end to end."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from built_worlds import AXES, build_world
from t3d_maps import corner, cuboid
from udk_maps import Map, box_nodes, room, scene_of, world_of
from unreal_fixture import Name, Object, Ref, Struct, rotator, vector

from usarsim_maps.build.csg import evaluate
from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context, read_scene
from usarsim_maps.unreal.brushes import read_built_level
from usarsim_maps.unreal.library import load_package
from usarsim_maps.unreal.udk import level_of
from usarsim_server.simulation.frames import wire_from_pose

# ---- brushes -------------------------------------------------------------------------------


def test_a_room(tmp_path: Path) -> None:
    """A single subtract brush is a closed room of the true size (worlds 19)."""
    world = world_of(tmp_path, room())
    assert world.rays((0, 0, 1.0)) == pytest.approx([2, 2, 2, 2, 2, 1])
    assert world.solid_rays((0, 0, 1.0)) == pytest.approx([2, 2, 2, 2, 2, 1])


def test_order_is_that_of_the_level(tmp_path: Path) -> None:
    """Brushes act in the order of the level's list of actors, not of the table (worlds 20)."""
    for order in (1, -1):
        made = Map()
        made.box("Floor", (-500, -500, -50), (500, 500, 0))
        made.box("Block", (-250, -250, 0), (250, 250, 500))
        pair = [
            made.box("Hole", (-125, -125, 0), (125, 125, 500), "CSG_Subtract"),
            made.box("Pin", (-25, -25, 0), (25, 25, 500)),
        ]
        made.actors[-2:] = pair[::order]
        made.start("S", (400, 400, 60))
        folder = tmp_path / str(order)
        folder.mkdir()
        world = world_of(folder, made)
        (down,) = world.rays((0, 0, 3.0), np.array([[0, 0, -1.0]]))
        assert down == pytest.approx(1.0 if order == 1 else 3.0)


def test_builder_brush_and_volumes(tmp_path: Path, findings: Findings) -> None:
    """A brush without operation is a tool, a volume is for logic: no geometry (worlds 17, 18)."""
    made = room()
    made.brush("Builder", cuboid((-100, -100, 0), (100, 100, 100)), "")
    made.brush("Volume", cuboid((-99, -99, 0), (99, 99, 99)), "CSG_Active", kind="TriggerVolume")
    scene = scene_of(tmp_path, made, findings)
    assert [brush.name for brush in scene.brushes] == ["Room"]
    assert findings.skipped["TriggerVolume"] == 1
    assert findings.classes["Brush"] == 2


def test_transformed_brush_looks_outwards(tmp_path: Path) -> None:
    """Pivot, scale, mirror and turn act as the formula says; faces look outwards (worlds 10, 11,
    12)."""
    made = Map()
    made.brush(
        "Box",
        cuboid((-125, -125, -125), (125, 125, 125)),
        properties=[
            ("Location", vector(1000, 500, 250)),
            ("Rotation", rotator(yaw=16384)),
            ("DrawScale", 2.0),
            ("DrawScale3D", vector(-1.0, 2.0, 0.5)),
            ("PrePivot", vector(100, 0, 0)),
        ],
    )
    (brush,) = scene_of(tmp_path, made).brushes
    points = np.concatenate([polygon.vertices for polygon in brush.polygons])
    # x' = -2 (x - 100) turned by 90 degrees to the right, about (4, -2, 1) m.
    low, high = points.min(axis=0), points.max(axis=0)
    np.testing.assert_allclose(high - low, [4, 2, 1], atol=1e-9)
    np.testing.assert_allclose((low + high) / 2, [4, -2.8, 1], atol=1e-9)
    for polygon in brush.polygons:
        a, b, c = polygon.vertices[:3]
        assert np.cross(b - a, c - b) @ (a - (low + high) / 2) > 0.0


def test_solidity(tmp_path: Path) -> None:
    """Flags of brushes and polygons make them semisolid or nonsolid; portals are nothing."""
    made = Map()
    made.box("Solid", (0, 0, 0), (500, 500, 500))
    made.brush("Semi", cuboid((0, 0, 0), (9, 9, 9)), properties=[("PolyFlags", 0x20)])
    made.brush("Thin", cuboid((0, 0, 0), (9, 9, 9)), flags=3584 | 0x08)
    made.brush("Portal", cuboid((0, 0, 0), (9, 9, 9)), flags=0x0400_0000)
    brushes = scene_of(tmp_path, made).brushes
    found = {brush.name: brush.solidity.value for brush in brushes}
    assert found == {"Solid": "solid", "Semi": "semisolid", "Thin": "nonsolid"}


def test_broken_polygons_are_left_out(tmp_path: Path, findings: Findings) -> None:
    """Polygons with coordinates without meaning are dropped and counted."""
    made = Map()
    bad = [(0.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (1e30, 1.0, 0.0)]
    made.brush("Box", [*cuboid((0, 0, 0), (500, 500, 500)), bad, bad[:2]])
    (brush,) = scene_of(tmp_path, made, findings).brushes
    assert len(brush.polygons) == 6
    assert any("2 broken polygons" in w.text for w in findings.warnings())


def test_texture_coordinates(tmp_path: Path) -> None:
    """A texture with axes of length one repeats every 128 units from its origin."""
    made = Map()
    made.box("Box", (0, 0, 0), (256, 256, 256))
    (brush,) = scene_of(tmp_path, made).brushes
    for polygon in brush.polygons:
        assert polygon.material == "Pack.Wall_Mat"
        assert np.ptp(polygon.uvs, axis=0) == pytest.approx([2.0, 2.0])


def test_same_as_text(tmp_path: Path) -> None:
    """A map as binary package and as T3D gives the same brushes and starts (worlds 9)."""
    made = Map()
    made.box("Floor", (-1000, -1000, -50), (1000, 1000, 0))
    made.box("Long", (0, 0, 0), (750, 100, 250))
    made.box("Short", (0, 100, 0), (100, 400, 250))
    made.box("Tower", (500, -250, 0), (600, -100, 500))
    made.start("PlayerStart_0", (-500, -500, 60))
    binary = scene_of(tmp_path, made)
    (tmp_path / "corner.t3d").write_text(corner())
    text = read_scene(tmp_path / "corner.t3d")
    assert [s.pose for s in binary.starts] == [s.pose for s in text.starts]
    for one, other in zip(binary.brushes, text.brushes, strict=True):
        for p, q in zip(one.polygons, other.polygons, strict=True):
            np.testing.assert_array_equal(p.vertices, q.vertices)


# ---- the built level -----------------------------------------------------------------------


def test_built_level_agrees(tmp_path: Path, findings: Findings) -> None:
    """The tree that the editor stored is compared with the brushes; the report says so."""
    made = Map()
    made.box("Block", (-500, -250, 0), (500, 250, 300))
    made.built(box_nodes((-500, -250, 0), (500, 250, 300)))
    scene = scene_of(tmp_path, made, findings)
    assert findings.facts["brushes and built level"] == "agree at 600 of 600 points"
    assert scene.filled is False
    assert not findings.warnings()


def test_built_level_that_is_out_of_date(tmp_path: Path, findings: Findings) -> None:
    """Geometry that was not rebuilt after a change is a warning."""
    made = Map()
    made.box("Block", (-500, -250, 0), (500, 250, 300))
    made.built(box_nodes((-500, -250, 0), (0, 250, 300)))
    scene_of(tmp_path, made, findings)
    (warning,) = findings.warnings()
    assert "rebuild the geometry" in warning.text


def test_tree(tmp_path: Path) -> None:
    """Points are classified by the tree; one that runs in circles comes to an end."""
    made = Map()
    made.box("Block", (-500, -250, 0), (500, 250, 300))
    made.built(box_nodes((-500, -250, 0), (500, 250, 300)))
    source = tmp_path / "map.udk"
    source.write_bytes(made.content())
    package = load_package(source)
    level = level_of(package)
    built = read_built_level(package, level)
    inside = built.solid([[0, 0, 150], [499, 249, 1], [501, 0, 1], [0, 0, -1], [0, 0, 301]])
    assert inside.tolist() == [True, True, False, False, False]
    turning = built.nodes.copy()
    turning["children"] = 0
    assert type(built)(turning, True).solid([[0, 0, 0]]).shape == (1,)


# ---- places, lights, air -------------------------------------------------------------------


def test_starts(tmp_path: Path) -> None:
    """Called by tag, or by name if the tag is the default; poses exact, yaw unwrapped (worlds 25,
    8)."""
    made = room()
    made.start("PlayerStart_1", (250, 500, 250), "RobotStart1", yaw=81920)
    starts = scene_of(tmp_path, made).starts
    assert [start.tag for start in starts] == ["PlayerStart_0", "RobotStart1"]
    assert starts[1].pose.position == (1.0, -2.0, 1.0)
    assert starts[1].turns == 1
    place, (_, _, yaw) = wire_from_pose(starts[1].pose)
    assert place == pytest.approx((1.0, 2.0, -1.0))
    assert yaw + math.tau == pytest.approx(7.8540, abs=1e-4)


def test_nodes_and_victims(tmp_path: Path) -> None:
    """Path nodes by the same rule; those tagged as victims are people (worlds 26, 28)."""
    made = room()
    made.actor(
        "PathNode", "PathNode_3", [("Location", vector(0, 250, 0)), ("Tag", Name("PathNode"))]
    )
    tag = "VictimPackage.animation.GenericFemale_AnimTree_hugKnees"
    made.actor("PathNode", "PathNode_4", [("Tag", Name(tag))])
    scale = [("DrawScale3D", vector(1, 1, 2)), ("DrawScale", 0.5)]
    made.actor("MaleVictim", "MaleVictim_0", [("Location", vector(250, 0, 0)), *scale])
    scene = scene_of(tmp_path, made)
    assert [(n.tag, n.position) for n in scene.path_nodes] == [("PathNode_3", (0.0, -1.0, 0.0))]
    female, male = scene.victims
    assert (female.properties["figure"], female.posture) == ("female", "sitting")
    assert (male.name, male.properties["figure"]) == ("MaleVictim_0", "male")
    assert male.scale == pytest.approx(0.25 ** (1 / 3))


def test_lights_and_air(tmp_path: Path) -> None:
    """Radius, brightness, colour and cone come from the component; fog and smoke are kept
    (worlds 76)."""
    made = room()
    for kind in ("PointLight", "SpotLight", "DominantDirectionalLight", "SkyLight"):
        lamp = made.actor(kind, f"{kind}_0", [("Location", vector(0, 0, 500))])
        inner = made.add(Object(f"{kind}Component", f"{kind}Component_0", lamp))
        inner.properties = [
            ("Radius", 500.0),
            ("Brightness", 0.5),
            ("LightColor", Struct("Color", bytes([0, 0, 255, 0]))),
            ("OuterConeAngle", 30.0),
        ]
        lamp.properties.append(("LightComponent", Ref(inner)))
    made.actor("SmokeLocalDynamic", "Smoke_0", [("Location", vector(0, 0, 0))])
    fog = made.actor("ExponentialHeightFog", "Fog_0")
    inner = made.add(Object("ExponentialHeightFogComponent", "FogComponent_0", fog))
    inner.properties = [("FogDensity", 0.04)]
    fog.properties.append(("Component", Ref(inner)))
    scene = scene_of(tmp_path, made)
    kinds = [light.kind.value for light in scene.lights]
    assert kinds == ["point", "spot", "directional", "ambient"]
    point, spot = scene.lights[:2]
    assert (point.position, point.reach, point.color) == ((0, 0, 2), 2.0, (1, 0, 0))
    assert (spot.brightness, spot.cone) == (0.5, 30.0)
    assert scene.smoke.haze == pytest.approx(0.04 / 1000 * 250 * math.log(2))
    assert [puff.lifetime for puff in scene.smoke.puffs] == [10.0]
    assert scene.kill_z == -20.0


MAPS = os.environ.get("USARSIM_MAPS", "")
SOCCER = Path(MAPS) / "RoboSoccer.udk"

# ---- the real map --------------------------------------------------------------------------

with_soccer = pytest.mark.skipif(
    not (MAPS and SOCCER.is_file()), reason="USARSIM_MAPS names no folder with RoboSoccer.udk"
)


@with_soccer
def test_soccer_map(tmp_path: Path, findings: Findings) -> None:
    """The league's soccer map: actors, one untagged start 0.58 m above the floor (worlds 3)."""
    world = build_world(tmp_path, read_scene(SOCCER, Context(findings=findings)), findings)
    assert findings.classes["StaticMeshActor"] == 19
    assert [brush.name for brush in world.scene.brushes] == ["Brush_4", "Brush0", "Brush9"]
    assert [start.tag for start in world.scene.starts] == ["PlayerStart_0"]
    (place,) = world.built.checks
    assert place.height == pytest.approx(0.576, abs=1e-3)
    assert place.overlap == 0.0
    assert len(world.scene.lights) == 8
    assert sum(n for kind, _, n in findings.missing_list() if kind == "mesh") == 20
    x, y, z = world.scene.starts[0].pose.position
    # A room of 10.24 x 6.144 m.
    front, back, left, right = world.rays((x, y, z), AXES)[:4]
    assert front + back == pytest.approx(10.24, abs=1e-3)
    assert left + right == pytest.approx(6.144, abs=1e-3)


@with_soccer
def test_soccer_map_is_as_the_editor_built_it() -> None:
    """Cells of brushes and the stored tree agree at 20 000 points (worlds reference 1 no. 2)."""
    package = load_package(SOCCER)
    level = level_of(package)
    built = read_built_level(package, level)
    assert built is not None
    scene = read_scene(SOCCER)
    cells = evaluate(scene.brushes, scene.filled).cells
    points = np.random.default_rng(1).uniform((-5, -4, -4), (8, 5, 4), (20_000, 3))
    solid = np.zeros(len(points), dtype=bool)
    for cell in cells:
        normals = np.array([face.plane[:3] for face in cell.faces])
        offsets = np.array([face.plane.offset for face in cell.faces])
        solid |= (points @ normals.T <= offsets).all(axis=1)
    told = built.solid(points * [1, -1, 1] * 250.0)
    assert 2_000 < solid.sum() < 18_000
    assert (told == solid).all()
