"""Meshes in UDK maps: of the map itself, of packages in asset folders, missing ones."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from lzo_fixture import lzo_pack
from mesh_samples import faces_out, read, write
from t3d_maps import cuboid
from udk_maps import TABLE, Map, box_triangles, convex, room, scene_of, static_mesh, world_of
from unreal_fixture import Enumeration, Name, Object, Ref, Structs, Writer, matrix, rotator, vector

from usarsim_maps.convert import Request, import_map
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Collision
from usarsim_server.base.errors import MapImportError

# ---- meshes --------------------------------------------------------------------------------


def library(folder: Path, **more: object) -> Path:
    """A package `Furniture.upk` with the mesh `Kitchen.Table`, 2 x 1 x 0.8 m, in a folder."""
    made = Writer(flags=1)
    triangles = box_triangles((0, 0, 0), (500, 250, 200))
    static_mesh(made, "Table", triangles, group="Kitchen", **more)  # type: ignore[arg-type]
    folder.mkdir(exist_ok=True)
    (folder / "Furniture.upk").write_bytes(made.content())
    return folder


def test_meshes_from_packages(tmp_path: Path) -> None:
    """A mesh is found by package, group and name; placed by actor and component together."""
    made = room()
    made.placed(
        "StaticMeshActor",
        "Table_0",
        TABLE,
        [("Location", vector(250, 0, 0)), ("Rotation", rotator(yaw=16384))],
        [("Translation", vector(125, 0, 0)), ("Scale", 0.5)],
    )
    scene = scene_of(tmp_path, made, assets=(library(tmp_path / "lib"),))
    (table,) = scene.objects
    assert (table.name, table.kind) == ("Table_0", "StaticMeshActor")
    (part,) = table.parts
    local = part.shape.vertices @ part.matrix[:3, :3].T + part.matrix[:3, 3]
    world = local @ table.pose.matrix().T + np.array(table.pose.position)
    # Local x from 0.5 m, 1 m long, points to -y; local y (right) is half a metre towards -x.
    np.testing.assert_allclose(world.min(axis=0), [0.5, -1.5, 0], atol=1e-9)
    np.testing.assert_allclose(world.max(axis=0), [1.0, -0.5, 0.4], atol=1e-9)
    assert part.shape.materials == ("Pack.Mesh_Mat",)
    assert tmp_path / "lib" / "Furniture.upk" in scene.source.files


@pytest.mark.parametrize("version", [760, 822, 826, 832, 860, 868])
def test_faces_of_meshes_look_outwards(tmp_path: Path, version: int) -> None:
    """Triangles are read in every version; the reader's order makes normals point outwards."""
    made = Map(version)
    mesh = static_mesh(made, "Box", box_triangles((-50, -50, -50), (50, 50, 50)))
    if version < 770:
        mesh.tail[3] = struct.pack("<2i", 32, 0)
        mesh.tail.pop(2)
    made.placed("StaticMeshActor", "Box_0", Ref(mesh))
    (thing,) = scene_of(tmp_path, made).objects
    box = thing.parts[0].shape
    assert len(box.vertices) == 8
    assert faces_out(box)
    # u is x / 100 and v upwards is 1 - y / 100, y the engine's.
    corners = box.vertices[box.triangles]
    np.testing.assert_allclose(box.uvs[..., 0], corners[..., 0] * 2.5, atol=1e-6)
    np.testing.assert_allclose(box.uvs[..., 1], 1.0 + corners[..., 1] * 2.5, atol=1e-6)


def test_slots_and_overrides(tmp_path: Path) -> None:
    """Triangles know their slot; an actor's component replaces materials by slot."""
    made = Map()
    triangles = box_triangles((0, 0, 0), (100, 100, 100))
    mesh = static_mesh(
        made,
        "Box",
        triangles,
        slots=[number % 2 for number in range(12)],
        materials=["P.First_Mat", "P.Second_Mat"],
    )
    other = Ref("P.Third_Mat", "Material")
    made.placed(
        "StaticMeshActor", "Box_0", Ref(mesh), component=[("Materials", [Ref(None), other])]
    )
    (thing,) = scene_of(tmp_path, made).objects
    (part,) = thing.parts
    assert part.shape.materials == ("P.First_Mat", "P.Second_Mat")
    assert part.shape.slots.tolist() == [number % 2 for number in range(12)]
    assert dict(part.materials) == {1: "P.Third_Mat"}


AXES_AT = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 300.0)]


def test_hulls(tmp_path: Path) -> None:
    """The artist's hulls, boxes, balls and capsules are what a mesh collides with."""
    body = [
        ("ConvexElems", Structs([convex([(0, 0, 0), (250, 0, 0), (0, 250, 0), (0, 0, 250)])])),
        ("BoxElems", Structs([[("TM", matrix(AXES_AT)), ("X", 50.0), ("Y", 100.0), ("Z", 150.0)]])),
        ("SphereElems", Structs([[("TM", matrix(AXES_AT)), ("Radius", 125.0)]])),
        ("SphylElems", Structs([[("Radius", 25.0), ("Length", 250.0)]])),
    ]
    made = Map()
    mesh = static_mesh(made, "Box", box_triangles((0, 0, 0), (500, 500, 500)), body=body)
    made.placed("StaticMeshActor", "Box_0", Ref(mesh))
    (thing,) = scene_of(tmp_path, made).objects
    shape = thing.parts[0].shape
    hull, box, ball, capsule = shape.hulls
    np.testing.assert_allclose(hull, [[0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 0, 1]])
    np.testing.assert_allclose(
        [box.min(axis=0), box.max(axis=0)], [[-0.1, -0.2, 0.9], [0.1, 0.2, 1.5]]
    )
    np.testing.assert_allclose(np.linalg.norm(ball - [0, 0, 1.2], axis=1), 0.5, atol=1e-6)
    assert capsule[:, 2].max() == pytest.approx(0.6)
    assert capsule[:, 0].max() == pytest.approx(0.1)


def test_hulls_are_felt_and_faces_are_seen(tmp_path: Path) -> None:
    """Rays meet the triangles, contacts the hull (worlds 35, 56, 57)."""
    made = room()
    body = [
        (
            "ConvexElems",
            Structs([convex([p for f in cuboid((0, 0, 0), (125, 125, 125)) for p in f])]),
        )
    ]
    mesh = static_mesh(made, "Box", box_triangles((0, 0, 0), (250, 250, 250)), body=body)
    made.placed("StaticMeshActor", "Box_0", Ref(mesh))
    world = world_of(tmp_path, made)
    down = np.array([[0, 0, -1.0]])
    assert world.rays((0.2, -0.2, 2.0), down) == pytest.approx([1.0])
    assert world.solid_rays((0.2, -0.2, 2.0), down) == pytest.approx([1.5])
    assert world.solid_rays((0.8, -0.8, 2.0), down) == pytest.approx([2.0])


def test_movable_and_not_solid(tmp_path: Path) -> None:
    """A KActor can be pushed; what does not collide in the map does not here (worlds 29)."""
    made = room()
    mesh = static_mesh(made, "Box", box_triangles((0, 0, 0), (50, 50, 50)))
    made.placed("KActor", "Ball_0", Ref(mesh), [("Tag", Name("Ball"))])
    ghost = [("CollisionType", Enumeration("ECollisionType", "COLLIDE_NoCollision"))]
    made.placed("StaticMeshActor", "Ghost_0", Ref(mesh), ghost)
    made.placed("StaticMeshActor", "Ghost_1", Ref(mesh), component=[("BlockActors", False)])
    made.placed("InterpActor", "Door_0", Ref(mesh), [("bHidden", True)])
    ball, first, second, door = scene_of(tmp_path, made).objects
    assert (ball.movable, ball.tag, door.movable) == (True, "Ball", False)
    assert ball.parts[0].collision is Collision.AUTO
    assert first.parts[0].collision is second.parts[0].collision is Collision.NONE
    assert not door.parts[0].visible
    assert ball.parts[0].shape is door.parts[0].shape


def test_missing_meshes(tmp_path: Path, findings: Findings) -> None:
    """Meshes in packages that are not there are listed with their number; the rest loads
    (worlds 70)."""
    made = room()
    for number in range(3):
        made.placed("StaticMeshActor", f"Table_{number}", TABLE)
    scene = scene_of(tmp_path, made, findings)
    assert ("mesh", "Furniture.Kitchen.Table", 3) in findings.missing_list()
    assert not scene.objects
    assert len(scene_of(tmp_path, made, placeholders=True).objects) == 3


def test_damaged_libraries(tmp_path: Path) -> None:
    """A package of meshes that cannot be read is a warning, and its meshes are missing."""
    made = room()
    made.placed("StaticMeshActor", "Table_0", TABLE)
    folder = library(tmp_path / "lib")
    package = folder / "Furniture.upk"
    package.write_bytes(package.read_bytes()[:500])
    findings = Findings()
    assert not scene_of(tmp_path, made, findings, assets=(folder,)).objects
    assert any("Furniture.upk" in w.text for w in findings.warnings())
    library(folder, slots=[0] * 12)
    content = bytearray(package.read_bytes())
    place = content.index(struct.pack("<2i", 12, 12 * 372))
    struct.pack_into("<i", content, place - 4, 1)
    package.write_bytes(content)
    findings = Findings()
    assert not scene_of(tmp_path, made, findings, assets=(folder,)).objects
    assert any("does not hold its triangles" in w.text for w in findings.warnings())


def test_packages_serve_text_maps(tmp_path: Path) -> None:
    """A map in T3D finds its meshes in packages, too."""
    folder = library(tmp_path / "lib")
    text = (
        "Begin Map\nBegin Level\nBegin Actor Class=StaticMeshActor Name=T\n"
        "Begin Object Class=StaticMeshComponent Name=C\n"
        "StaticMesh=StaticMesh'Furniture.Kitchen.Table'\nEnd Object\n"
        "End Actor\nEnd Level\nEnd Map\n"
    )
    (thing,) = read(write(tmp_path, text, "map.t3d"), assets=(folder,)).objects
    shape = thing.parts[0].shape
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), [2.0, 1.0, 0.8])


def test_a_package_of_meshes(tmp_path: Path) -> None:
    """Imported by itself a package of meshes becomes a row of them."""
    made = Writer(flags=1)
    static_mesh(made, "One", box_triangles((-250, -250, -250), (250, 250, 250)))
    static_mesh(made, "Two", box_triangles((0, 0, 0), (250, 250, 250)))
    world = world_of(tmp_path, made)
    assert [thing.name for thing in world.scene.objects] == ["One", "Two"]
    np.testing.assert_allclose(world.built.lower, [0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(world.built.upper, [2, 3.5, 2], atol=1e-6)
    (tmp_path / "empty.upk").write_bytes(Writer(flags=1).content())
    with pytest.raises(MapImportError, match="without a level"):
        read(tmp_path / "empty.upk")


# ---- sublevels, options --------------------------------------------------------------------


def with_sublevel(cutting: bool) -> tuple[Map, Map]:
    """A map that loads another, which has a pillar and a start, and a hole if asked for."""
    made, inner = room(), Map()
    inner.box("Pillar", (-50, -50, 0), (50, 50, 750), "CSG_Subtract" if cutting else "CSG_Add")
    inner.start("PlayerStart_9", (250, 0, 60), "Second")
    streaming = made.add(Object("LevelStreamingAlwaysLoaded", "LevelStreaming_0", made.info))
    streaming.properties = [("PackageName", Name("Annex"))]
    made.info.properties.append(("StreamingLevels", [Ref(streaming)]))
    return made, inner


def test_sublevels(tmp_path: Path) -> None:
    """Levels that a map loads at run time belong to it; their holes do not reach into others."""
    for cutting in (False, True):
        made, inner = with_sublevel(cutting)
        (tmp_path / "Annex.udk").write_bytes(inner.content())
        findings = Findings()
        scene = scene_of(tmp_path, made, findings)
        assert [start.tag for start in scene.starts] == ["PlayerStart_0", "Second"]
        assert len(scene.brushes) == (1 if cutting else 2)
        assert cutting == any("cut holes" in w.text for w in findings.warnings())
        assert tmp_path / "Annex.udk" in scene.source.files
    (tmp_path / "Annex.udk").write_bytes(b"damaged")
    findings = Findings()
    assert len(scene_of(tmp_path, made, findings).starts) == 1
    assert any("the sublevel was left out" in w.text for w in findings.warnings())
    (tmp_path / "Annex.udk").unlink()
    scene_of(tmp_path, made, findings)
    assert ("sublevel", "Annex", 1) in findings.missing_list()


def test_scale_and_mirror(tmp_path: Path) -> None:
    """The user's scale replaces 250; a mirrored map is reflected (worlds 74)."""
    made = room()
    made.start("PlayerStart_1", (250, 500, 100), "Side", yaw=8192)
    scene = scene_of(tmp_path, made, scale=125.0, mirror=True)
    assert scene.starts[1].pose.position == (2.0, 4.0, 0.8)
    assert scene.starts[1].pose.rotate((1, 0, 0)) == pytest.approx((0.7071, 0.7071, 0), abs=1e-4)
    assert (scene.source.units_per_metre, scene.source.mirrored) == (125.0, False)


def test_compressed_map(tmp_path: Path) -> None:
    """A map that was saved compressed is the same world; a second import remembers (worlds 67,
    75)."""
    plain, packed = tmp_path / "plain.udk", tmp_path / "packed.udk"
    plain.write_bytes(room().content())
    packed.write_bytes(room().content(2, lzo_pack))
    one, other = (import_map(Request(path, name="same")) for path in (plain, packed))
    assert (one.folder / "scene.xml").read_bytes() == (other.folder / "scene.xml").read_bytes()
    assert import_map(Request(packed, name="same")).cached
