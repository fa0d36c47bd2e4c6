"""T3D levels and meshes (worlds reference 4 and 13)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from built_worlds import AXES, import_text
from mesh_samples import faces_out
from t3d_maps import actor, brush, corner, cuboid, level, polygon, room, start
from t3d_maps import read_level as read

from usarsim_maps.build.csg import evaluate
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Collision, LightKind, Scene, Solidity
from usarsim_server.simulation.frames import wire_from_pose


def volume(scene: Scene) -> float:
    """Of the solid."""
    return sum(cell.volume for cell in evaluate(scene.brushes, disjoint=True).cells)


class TestBrushes:
    """Geometry of the level."""

    def test_normals_point_outwards(self, tmp_path: Path) -> None:
        """Also where DrawScale3D mirrors the brush (worlds 10)."""
        for properties in ("", "DrawScale3D=(X=-1,Y=1,Z=1)\n"):
            scene = read(
                tmp_path, level(brush("B", (100, 0, 0), (350, 250, 250), properties=properties))
            )
            (one,) = scene.brushes
            middle = np.concatenate([p.vertices for p in one.polygons]).mean(axis=0)
            for face in one.polygons:
                a, b, c = face.vertices[:3]
                assert np.cross(b - a, c - b) @ (face.vertices.mean(axis=0) - middle) > 0.0
            assert volume(scene) == pytest.approx(1.0)

    def test_pivot_and_rotation(self, tmp_path: Path) -> None:
        """PrePivot, rotation and location are applied in the engine's order (worlds 11)."""
        properties = (
            "PrePivot=(X=100,Y=0,Z=0)\nRotation=(Pitch=0,Yaw=16384,Roll=0)\n"
            "Location=(X=500,Y=0,Z=250)\n"
        )
        (one,) = read(
            tmp_path, level(brush("B", (0, 0, 0), (250, 500, 250), properties=properties))
        ).brushes
        points = np.concatenate([p.vertices for p in one.polygons])
        # Unreal: forward turns to +Y, right to -X, so X runs from 500 - 500 to 500, Y from -100.
        np.testing.assert_allclose(points.min(axis=0), (0.0, -0.6, 1.0), atol=1e-9)
        np.testing.assert_allclose(points.max(axis=0), (2.0, 0.4, 2.0), atol=1e-9)

    def test_scales(self, tmp_path: Path) -> None:
        """DrawScale 2 with DrawScale3D (1, 2, 0.5) makes a unit cube 2 x 4 x 1 (worlds 12)."""
        properties = "DrawScale=2\nDrawScale3D=(X=1,Y=2,Z=0.5)\n"
        (one,) = read(
            tmp_path, level(brush("B", (0, 0, 0), (250, 250, 250), properties=properties))
        ).brushes
        points = np.concatenate([p.vertices for p in one.polygons])
        np.testing.assert_allclose(np.ptp(points, axis=0), (2.0, 4.0, 1.0))

    def test_origin_and_normal_may_be_there(self, tmp_path: Path) -> None:
        """Polygons with and without Origin and Normal are the same solid (worlds 14)."""
        text = level(brush("B", (0, 0, 0), (250, 250, 250)))
        extra = "Origin +00000.0,+00000.0,+00000.0\nNormal +00000.0,+00000.0,+00001.0\nTextureU"
        assert volume(read(tmp_path, text.replace("TextureU", extra))) == pytest.approx(1.0)
        assert volume(read(tmp_path, text)) == pytest.approx(1.0)

    def test_the_inner_polylist_counts(self, tmp_path: Path) -> None:
        """The empty list at actor level is ignored (worlds 15)."""
        text = level(brush("B", (0, 0, 0), (250, 250, 250)))
        assert text.index("Begin PolyList\nEnd PolyList") < text.index("Begin Brush")
        assert len(read(tmp_path, text).brushes[0].polygons) == 6

    def test_the_builder_brush_is_a_tool(self, tmp_path: Path) -> None:
        """Without CsgOper, or with CSG_Active, a brush adds nothing (worlds 17)."""
        text = level(
            brush("Builder", (-9999, -9999, 0), (9999, 9999, 99), operation=""),
            brush("Red", (-9999, -9999, 0), (9999, 9999, 99), operation="CSG_Active"),
            brush("B", (0, 0, 0), (250, 250, 250)),
        )
        assert [one.name for one in read(tmp_path, text).brushes] == ["B"]

    def test_volumes_are_neither_felt_nor_seen(self, tmp_path: Path, findings: Findings) -> None:
        """A volume, even one with a CsgOper, is no solid (worlds 18)."""
        text = level(
            brush("Floor", (-500, -500, -50), (500, 500, 0)),
            brush("V", (100, -100, 0), (200, 100, 200), kind="TriggerVolume"),
            start("S", (0, 0, 60)),
        )
        world = import_text(tmp_path, text)
        assert world.rays((0, 0, 0.4), AXES[:1])[0] == np.inf
        assert world.solid_rays((0, 0, 0.4), AXES[:1])[0] == np.inf
        read(tmp_path, text, findings)
        assert findings.skipped["TriggerVolume"] == 1

    @pytest.mark.parametrize(
        ("flags", "solidity"),
        [(0, Solidity.SOLID), (0x20, Solidity.SEMISOLID), (0x08, Solidity.NONSOLID)],
    )
    def test_flags(self, tmp_path: Path, flags: int, solidity: Solidity) -> None:
        """PolyFlags say whether a brush is solid (worlds 4.2)."""
        text = level(brush("B", (0, 0, 0), (250, 250, 250), properties=f"PolyFlags={flags}\n"))
        assert read(tmp_path, text).brushes[0].solidity is solidity

    def test_old_files_have_no_level_line(self, tmp_path: Path) -> None:
        """UE1 and UE2 files list actors directly in the map; MainScale and PostScale count."""
        scaled = brush(
            "B",
            (0, 0, 0),
            (250, 250, 250),
            "CSG_Subtract",
            "MainScale=(Scale=(X=2.0),SheerAxis=SHEER_ZX)\nPostScale=(Scale=(Z=3.0))\n",
        )
        scene = read(tmp_path, f"Begin Map\n{scaled}\nEnd Map\nBegin Surface\nEnd Surface\n")
        points = np.concatenate([p.vertices for p in scene.brushes[0].polygons])
        np.testing.assert_allclose(np.ptp(points, axis=0), (2.0, 1.0, 3.0))

    def test_broken_polygons_are_left_out(self, tmp_path: Path, findings: Findings) -> None:
        """Too few corners or senseless numbers cost a polygon and a line in the report."""
        faces = "\n".join(polygon(face) for face in cuboid((0, 0, 0), (250, 250, 250)))
        bad = "Begin Polygon\nVertex 1,2\nEnd Polygon\n" + polygon(
            [(0, 0, 0), (1e30, 0, 0), (0, 1, 0)]
        )
        text = level(
            "Begin Actor Class=Brush Name=B\nBegin Brush\nBegin PolyList\n"
            f"{bad}\n{faces}\nEnd PolyList\nEnd Brush\nCsgOper=CSG_Add\nEnd Actor"
        )
        assert volume(read(tmp_path, text, findings)) == pytest.approx(1.0)
        assert findings.warnings()[0].times == 2

    def test_no_mirror_image(self, tmp_path: Path) -> None:
        """An asymmetric map keeps its sides: Unreal's +Y is to the right (worlds 9)."""
        world = import_text(tmp_path, corner())
        down = AXES[5:]
        # Long wall along +X at Y 0..100 UU: y from -0.4 to 0.
        assert world.rays((1.5, -0.2, 5.0), down)[0] == pytest.approx(4.0)
        assert world.rays((1.5, 0.2, 5.0), down)[0] == pytest.approx(5.0)
        # Short wall along +Y, that is to the right; tower to the left.
        assert world.rays((0.2, -1.2, 5.0), down)[0] == pytest.approx(4.0)
        assert world.rays((2.2, 0.8, 5.0), down)[0] == pytest.approx(3.0)


class TestPlaces:
    """Starts, path nodes, victims."""

    def test_starts(self, tmp_path: Path) -> None:
        """The default Tag gives way to the Name; the order is the file's (worlds 25, 27)."""
        scene = read(
            tmp_path,
            level(
                start("PlayerStart_7", (250, 500, 80), yaw=16384),
                start("PlayerStart_3", (0, 0, 80), "Station"),
                start("PlayerStart_0", (0, 0, 80), yaw=81920),
            ),
        )
        assert [one.tag for one in scene.starts] == ["PlayerStart_7", "Station", "PlayerStart_0"]
        location, rotation = wire_from_pose(scene.starts[0].pose)
        assert location == pytest.approx((1.0, 2.0, -0.32))
        assert rotation == pytest.approx((0.0, 0.0, math.pi / 2))
        # Item 8: more than a turn is the same heading.
        assert wire_from_pose(scene.starts[2].pose)[1] == pytest.approx(rotation)

    def test_path_nodes_and_people(self, tmp_path: Path) -> None:
        """Path nodes follow the same rule; those that are victims are no nodes (worlds 26)."""
        package = "VictimPackage.animation.Generic"
        scene = read(
            tmp_path,
            level(
                actor("PathNode", "PathNode_0", (0, 0, 0), 'Tag="PathNode"'),
                actor(
                    "PathNode", "PathNode_1", (0, 0, 0), f'Tag="{package}Female_AnimTree_layingX"'
                ),
                actor("PathNode", "PathNode_2", (250, 0, 0), 'Tag="Gate"'),
                actor(
                    "PathNode", "PathNode_3", (0, 0, 0), f'Tag="{package}Male_AnimTree_hugKnees"'
                ),
                actor("PathNode", "PathNode_4", (0, 0, 0), f'Tag="{package}Male_AnimTree_Dead"'),
            ),
        )
        assert [node.tag for node in scene.path_nodes] == ["PathNode_0", "Gate"]
        assert scene.path_nodes[1].position == pytest.approx((1.0, 0.0, 0.0))
        people = [(v.name, v.properties["figure"], v.posture, v.status) for v in scene.victims]
        assert people == [
            ("FemaleVictim_0", "female", "lying", "Alive"),
            ("MaleVictim_0", "male", "sitting", "Alive"),
            ("MaleVictim_1", "male", "lying", "Dead"),
        ]

    def test_victim_actors(self, tmp_path: Path) -> None:
        """MaleVictim and FemaleVictim keep name, place, heading and scale (worlds 28)."""
        scene = read(
            tmp_path,
            level(
                actor(
                    "FemaleVictim", "FemaleVictim_2", (250, 0, 80), "DrawScale3D=(X=1,Y=1,Z=0.8)"
                ),
                actor("MaleVictim", "MaleVictim_5", (0, 0, 80), "DrawScale=1.5"),
            ),
        )
        assert [(v.name, v.properties["figure"], v.scale) for v in scene.victims] == [
            ("FemaleVictim_2", "female", pytest.approx(0.8 ** (1 / 3))),
            ("MaleVictim_5", "male", pytest.approx(1.5)),
        ]

    def test_lights(self, tmp_path: Path) -> None:
        """Place, radius, brightness and colour of a light (worlds 76)."""
        component = (
            "Begin Object Class=PointLightComponent Name=C\nRadius=500\nBrightness=0.5\n"
            "LightColor=(B=0,G=128,R=255,A=0)\nEnd Object"
        )
        scene = read(
            tmp_path,
            level(
                actor("PointLight", "P", (250, 250, 250), component),
                actor("DirectionalLight", "D", (0, 0, 0), "Rotation=(Pitch=-16384)"),
                actor("SkyLight", "K"),
            ),
        )
        point, sun, sky = scene.lights
        assert point.position == pytest.approx((1, -1, 1))
        assert (point.reach, point.brightness) == (2.0, 0.5)
        assert point.color == pytest.approx((1.0, 128 / 255, 0.0))
        assert sun.kind is LightKind.DIRECTIONAL
        assert sun.direction == pytest.approx((0, 0, -1))
        assert sky.kind is LightKind.AMBIENT

    def test_unknown_things_are_counted(self, tmp_path: Path, findings: Findings) -> None:
        """Unknown classes, blocks and properties never stop an import (worlds 16)."""
        text = level(
            actor("UTWeaponLocker", "W", properties="Frobnication=(A=(B=(C=1)))"),
            actor("UTWeaponLocker", "W2"),
            room(),
        ).replace("End Level", "Begin Weird Stuff\nfoo bar\nEnd Weird\nEnd Level")
        assert len(read(tmp_path, text, findings).brushes) == 1
        assert findings.skipped == {"UTWeaponLocker": 2, "block weird": 1}
        assert findings.classes["Brush"] == 1

    def test_smoke_fog_and_level_facts(self, tmp_path: Path) -> None:
        """Smoke becomes particles, fog a haze, KillZ a height."""
        scene = read(
            tmp_path,
            level(
                actor("SmokeLocalDynamic", "S", (0, 0, 250), "DrawScale=2"),
                actor("ExponentialHeightFog", "F"),
                actor("WorldInfo", "W", properties='KillZ=-500\nTitle="My map"'),
            ),
        )
        (puff,) = scene.smoke.puffs
        assert puff.position == pytest.approx((0, 0, 3))
        assert puff.lifetime > 0.0
        assert 0.0 < scene.smoke.haze < 0.1
        assert scene.kill_z == pytest.approx(-2.0)
        assert scene.title == "My map"


CUBE = """Begin StaticMesh Name=Cube Version=2
{triangles}
End StaticMesh
"""


def cube_mesh_text(size: float) -> str:
    """A static mesh as UE2's batch export writes it: vertex order is the reverse of brushes."""
    triangles = []
    for face in cuboid((0, 0, 0), (size, size, size)):
        a, b, c, d = face
        for corners in ((c, b, a), (d, c, a)):
            lines = [
                f"Vertex {n} {x} {y} {z} {x / size} {y / size}"
                for n, (x, y, z) in enumerate(corners)
            ]
            triangles.append(
                "\n".join(["Begin Triangle", "Texture Pkg.Skin", *lines, "End Triangle"])
            )
    return CUBE.format(triangles="\n".join(triangles))


def mesh_actor(kind: str = "StaticMeshActor", extra: str = "", component: str = "") -> str:
    """An actor that names a mesh in a component, as UE3 writes it."""
    inner = (
        "Begin Object Class=StaticMeshComponent Name=C\n"
        f"StaticMesh=StaticMesh'Pkg.Props.Cube'\n{component}\nEnd Object"
    )
    return actor(kind, "Cube_0", (250, 250, 0), f'{inner}\n{extra}\nTag="Box"')


class TestMeshes:
    """Static meshes beside the map."""

    def library(self, folder: Path) -> Path:
        """An asset folder with the cube."""
        (folder / "assets" / "deep").mkdir(parents=True)
        (folder / "assets" / "deep" / "Cube.t3d").write_text(cube_mesh_text(125.0))
        return folder / "assets"

    def test_a_mesh_is_found_and_faces_outwards(self, tmp_path: Path) -> None:
        """The exported mesh of 125 UU is a solid box of half a metre where the actor stands."""
        scene = read(tmp_path, level(room(), mesh_actor()), assets=(self.library(tmp_path),))
        (thing,) = scene.objects
        (part,) = thing.parts
        assert (thing.name, thing.tag, thing.movable) == ("Cube_0", "Box", False)
        assert faces_out(part.shape)
        world = import_text(tmp_path, level(room(), mesh_actor()), assets=(tmp_path / "assets",))
        assert world.rays((1.25, -1.25, 2.0), AXES[5:])[0] == pytest.approx(1.5, abs=1e-5)
        assert world.solid_rays((1.25, -1.25, 2.0), AXES[5:])[0] == pytest.approx(1.5, abs=1e-5)
        assert world.rays((1.25, -0.75, 2.0), AXES[5:])[0] == pytest.approx(2.0, abs=1e-5)

    def test_missing_meshes_are_listed_once(self, tmp_path: Path, findings: Findings) -> None:
        """A mesh that is not there is listed with its uses; the rest loads (worlds 70)."""
        scene = read(tmp_path, level(room(), mesh_actor(), mesh_actor()), findings)
        assert scene.objects == ()
        assert findings.missing_list()[0] == ("mesh", "Pkg.Props.Cube", 2)
        boxes = read(tmp_path, level(room(), mesh_actor()), placeholders=True)
        assert len(boxes.objects[0].parts) == 1

    def test_kactors_move(self, tmp_path: Path) -> None:
        """A KActor can be pushed (worlds 29); the new world has it as a body."""
        text = level(room(), mesh_actor("KActor"), start("S", (0, 0, 60)))
        world = import_text(tmp_path, text, assets=(self.library(tmp_path),))
        assert world.scene.objects[0].movable
        assert world.model.body("Cube_0").mass[0] == pytest.approx(0.125 * 200.0, rel=0.02)

    @pytest.mark.parametrize(
        ("extra", "component", "collision", "visible"),
        [
            ("", "", Collision.AUTO, True),
            ("bCollideActors=False", "", Collision.NONE, True),
            ("CollisionType=COLLIDE_NoCollision", "", Collision.NONE, True),
            ("", "BlockActors=False", Collision.NONE, True),
            ("bHidden=True", "", Collision.AUTO, False),
        ],
    )
    def test_collision_and_visibility(
        self, tmp_path: Path, extra: str, component: str, collision: Collision, visible: bool
    ) -> None:
        """An actor's switches are obeyed."""
        text = level(room(), mesh_actor(extra=extra, component=component))
        (part,) = read(tmp_path, text, assets=(self.library(tmp_path),)).objects[0].parts
        assert (part.collision, part.visible) == (collision, visible)

    def test_scale_and_offset_of_components(self, tmp_path: Path) -> None:
        """Components have a place and a scale of their own in the actor; materials by slot."""
        text = level(
            room(),
            mesh_actor(
                extra="DrawScale=2",
                component="Translation=(X=0,Y=0,Z=125)\nScale3D=(X=1,Y=1,Z=2)\nMaterials(0)=Material'P.Red'",
            ),
        )
        scene = read(tmp_path, text, assets=(self.library(tmp_path),))
        (part,) = scene.objects[0].parts
        points = part.shape.vertices @ part.matrix[:3, :3].T + part.matrix[:3, 3]
        np.testing.assert_allclose(np.ptp(points, axis=0), (1, 1, 2), atol=1e-9)
        assert points[:, 2].min() == pytest.approx(1.0)
        assert part.materials == {0: "P.Red"}
        assert "P.Red" in scene.materials

    def test_ue2_names_the_mesh_on_the_actor(self, tmp_path: Path) -> None:
        """In UE2 the reference stands on the actor itself."""
        text = level(
            room(), actor("StaticMeshActor", "M", (0, 0, 0), "StaticMesh=StaticMesh'P.Cube'")
        )
        scene = read(tmp_path, text, assets=(self.library(tmp_path),))
        assert len(scene.objects[0].parts) == 1

    def test_movers_keep_their_polygons(self, tmp_path: Path) -> None:
        """A mover of the old engines is an object of its own, not part of the level's CSG."""
        text = level(room(), brush("Door", (0, 0, 0), (250, 25, 500), "", kind="Mover"))
        scene = read(tmp_path, text)
        assert len(scene.brushes) == 1
        (part,) = scene.objects[0].parts
        assert np.ptp(part.shape.vertices, axis=0) == pytest.approx((1.0, 0.1, 2.0))
