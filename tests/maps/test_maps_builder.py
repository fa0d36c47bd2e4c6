"""Scenes into worlds: what is seen, what is felt, what is told (worlds reference 13)."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from built_worlds import (
    AXES,
    WEDGE_FACES,
    build_world,
    cuboid_mesh,
    grid_mesh,
    import_text,
    mesh_of,
    scene_of,
    thing,
)
from PIL import Image
from t3d_maps import actor, brush, level, room, start

from usarsim_maps.build import emitter
from usarsim_maps.scene import (
    Box,
    Capsule,
    Collision,
    Cylinder,
    Heightfield,
    Light,
    LightKind,
    Material,
    Part,
    Plane,
    SceneObject,
    Shape,
    Sphere,
    map_victim,
)
from usarsim_server.base.errors import MapImportError
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import PathNode, Smoke, SmokePuff, SmokeVolume, StartPose
from usarsim_server.worlds.victims import PELVIS_HEIGHT

FLOOR = thing(cuboid_mesh((-5, -5, -0.2), (5, 5, 0.0)), "floor")
HERE = StartPose("Here", Pose((0.0, 0.0, 0.3)))
TWO_FACES = [(0, 1, 2), (0, 2, 3)]


def turned(degrees: float) -> tuple[float, float, float, float]:
    """About z."""
    return quaternion_from_rpy(0.0, 0.0, math.radians(degrees))


class TestSeeing:
    """Rays."""

    def test_a_closed_room(self, tmp_path: Path) -> None:
        """From the centre of a room all six walls are at half its extents (worlds 19, 56)."""
        world = import_text(tmp_path, level(room(), start("S", (0, 0, 60))))
        expected = [2.0, 2.0, 2.0, 2.0, 1.5, 1.5]
        np.testing.assert_allclose(world.rays((0, 0, 1.5)), expected, atol=1e-5)
        np.testing.assert_allclose(world.solid_rays((0, 0, 1.5)), expected, atol=1e-6)

    def test_a_concave_mesh_is_met_at_its_surface(self, tmp_path: Path) -> None:
        """Rays meet a hollow mesh at its true triangles from inside and outside (worlds 56)."""
        hollow = thing(cuboid_mesh((-1, -2, 0), (1, 2, 2), inward=True), "hollow")
        world = build_world(tmp_path, scene_of(FLOOR, hollow, starts=[HERE]))
        np.testing.assert_allclose(world.rays((0, 0, 1)), [1, 1, 2, 2, 1, 1], atol=1e-5)
        assert world.rays((4, 0, 1), AXES[1:2])[0] == pytest.approx(3.0, abs=1e-5)
        assert world.names((0, 0, 1), (1, 0, 0)) == "hollow"

    def test_sensors_and_contacts_use_different_shapes(self, tmp_path: Path) -> None:
        """A sensor never meets a geom of group 3, MuJoCo's contacts none of group 2 (worlds 57)."""
        dice = np.random.default_rng(0)
        bowl = thing(cuboid_mesh((1, 1, 0), (2, 2, 1)), "post", movable=False)
        fence = SceneObject("fence", (Part(cuboid_mesh((-3, 1, 0), (-2, 2, 1)), visible=False),))
        ghost = SceneObject(
            "ghost", (Part(cuboid_mesh((2, -3, 0), (3, -2, 1)), collision=Collision.NONE),)
        )
        world = build_world(tmp_path, scene_of(FLOOR, bowl, fence, ghost, starts=[HERE]))
        ways = dice.normal(size=(500, 3))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        model = world.model
        assert {int(g) for g in model.geom_group} == {2, 3}
        assert not (model.geom_contype[model.geom_group == 2]).any()
        assert world.rays((-2.5, 0, 0.5), AXES[2:3])[0] == np.inf
        assert world.solid_rays((-2.5, 0, 0.5), AXES[2:3])[0] == pytest.approx(1.0)
        assert world.rays((2.5, 0, 0.5), AXES[3:4])[0] == pytest.approx(2.0)
        assert world.solid_rays((2.5, 0, 0.5), AXES[3:4])[0] == np.inf

    def test_single_sided_faces_are_seen_from_both_sides(self, tmp_path: Path) -> None:
        """A quad of two triangles stops rays from the front and from behind (worlds 58)."""
        quad = mesh_of([(1, -1, 0), (1, 1, 0), (1, 1, 2), (1, -1, 2)], TWO_FACES)
        world = build_world(tmp_path, scene_of(FLOOR, thing(quad, "sheet"), starts=[HERE]))
        assert world.rays((0, 0, 1), AXES[:1])[0] == pytest.approx(1.0)
        assert world.rays((3, 0, 1), AXES[1:2])[0] == pytest.approx(2.0)

    def test_copies_stand_where_they_are_put(self, tmp_path: Path) -> None:
        """Copies of one mesh, turned, scaled and mirrored, share files and are each in place."""
        wedge = mesh_of(
            [(0, 0, 0), (1, 0, 0), (0, 0.5, 0), (0, 0, 1), (1, 0, 1), (0, 0.5, 1)],
            WEDGE_FACES,
        )
        mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
        copies = [
            thing(wedge, "a", Pose((-3, 0, 0))),
            thing(wedge, "b", Pose((3, 0, 0), turned(90))),
            SceneObject("c", (Part(wedge, mirror),), Pose((0, 3, 0))),
        ]
        world = build_world(tmp_path, scene_of(FLOOR, *copies, starts=[HERE]))
        covered, free = [(-2.9, 0.1), (2.9, 0.1), (-0.1, 3.1)], [(0.1, 3.1), (3.1, 0.1)]
        for cast in (world.rays, world.solid_rays):
            for places, depth in ((covered, 2.0), (free, 3.0)):
                for place in places:
                    assert cast((*place, 3.0), AXES[5:])[0] == pytest.approx(depth, abs=1e-5)
        assert len(list((world.built.folder / "meshes").iterdir())) == 3

    def test_pieces_of_several_files_are_each_in_place(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Solid pieces go into files of a bounded number, those of one shape together."""
        monkeypatch.setattr(emitter, "CHUNK", 2)
        wedge = mesh_of(
            [(0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 1), (0.5, 0, 1), (0, 0.5, 1)], WEDGE_FACES
        )
        shapes = (wedge, cuboid_mesh((0, 0, 0), (0.5, 0.5, 1)))
        row = [thing(shapes[n % 2], f"t{n}", Pose((n - 2.0, 0, 0))) for n in range(4)]
        world = build_world(tmp_path, scene_of(FLOOR, *row, starts=[HERE]))
        files = sorted((world.built.folder / "solids").iterdir())
        assert [file.read_text().count("<geom") for file in files] == [2, 2, 1]
        down = [world.solid_rays((n - 1.9, 0.1, 3.0), AXES[5:])[0] for n in range(4)]
        assert down == pytest.approx([2.0] * 4)
        model = world.model
        felt = [model.geom(n).name for n in np.flatnonzero(model.geom_group == 3).tolist()]
        assert [name.partition(":")[2].removesuffix(".solid") for name in felt] == [
            *("floor", "t0", "t2", "t1", "t3"),
        ]

    def test_pictures_keep_their_orientation(self, tmp_path: Path) -> None:
        """The texture coordinate v = 1 is the upper edge of the picture; JPEG becomes PNG
        (worlds reference 12)."""
        image = Image.new("RGB", (64, 64), (255, 0, 0))
        image.paste((0, 0, 255), (0, 32, 64, 64))  # red above, blue below
        image.save(tmp_path / "flag.jpg", quality=100)
        uvs = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], dtype=float)
        corners = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]
        quad = mesh_of(corners, TWO_FACES, uvs=uvs, materials=("flag",))
        looks = {"flag": Material("flag", (1, 1, 1, 1), tmp_path / "flag.jpg")}
        world = build_world(tmp_path, scene_of(FLOOR, thing(quad), starts=[HERE], materials=looks))
        model = world.model
        mesh = int(model.geom_dataid[model.geom("thing").id])
        texture = model.mesh_texcoord[model.mesh_texcoordadr[mesh] :][
            : model.mesh_texcoordnum[mesh]
        ]
        start = model.mesh_vertadr[mesh]
        heights = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
        axis = int(np.argmax(np.ptp(heights, axis=0)))
        # MuJoCo counts rows of the picture from above: where v = 1 in the file the row is 0.
        assert sorted(set(texture[:, 1].tolist())) == [0.0, 1.0]
        assert np.ptp(heights[:, axis]) == pytest.approx(1.0)
        kept = int(np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_2D)[0])
        pixels = model.tex_data[model.tex_adr[kept] :][: 64 * 64 * 3].reshape(64, 64, 3)
        assert pixels[5, 32, 0] > 200
        assert pixels[58, 32, 2] > 200

    def test_missing_and_broken_pictures(self, tmp_path: Path) -> None:
        """A picture that is not there is listed once, one that is none is told of; the world loads
        with plain materials (worlds 70)."""
        looks = {
            "wall": Material("wall", texture=tmp_path / "nowhere.tga"),
            "door": Material("door", image=b"\x89PNG\r\n\x1a\nnonsense"),
        }
        mesh = mesh_of([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], materials=(*looks, "other"))
        world = build_world(tmp_path, scene_of(FLOOR, thing(mesh), starts=[HERE], materials=looks))
        assert world.findings.missing_list() == [("texture", "nowhere.tga", 1)]
        assert "door: the picture cannot be read" in world.texts()


class TestFeeling:
    """Contacts."""

    def drop(self, model: mujoco.MjModel, body: str, seconds: float) -> mujoco.MjData:
        """Let the world run."""
        data = mujoco.MjData(model)
        for _ in range(int(seconds / model.opt.timestep)):
            mujoco.mj_step(model, data)
        return data

    def ball(
        self, world_folder: Path, place: tuple[float, float, float], **more: object
    ) -> mujoco.MjModel:
        """The world with a ball of 0.5 kg in it."""
        spec = mujoco.MjSpec.from_file(str(world_folder / "scene.xml"))
        body = spec.worldbody.add_body(name="ball", pos=place)
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], mass=0.5, **more)
        spec.option.timestep = 0.002
        return spec.compile()

    def test_a_hollow_room_is_empty(self, tmp_path: Path) -> None:
        """A ball in the middle of a hollow mesh touches nothing until it is down (worlds 51)."""
        hollow = thing(cuboid_mesh((-2, -2, 0), (2, 2, 3), inward=True), "hollow")
        world = build_world(tmp_path, scene_of(hollow, starts=[HERE]))
        model = self.ball(world.built.folder, (0.0, 0.0, 1.5))
        data = mujoco.MjData(model)
        for _ in range(200):
            mujoco.mj_step(model, data)
            assert data.ncon == 0
        data = self.drop(model, "ball", 3.0)
        assert data.body("ball").xpos[2] == pytest.approx(0.1, abs=0.01)

    def test_a_fast_ball_does_not_tunnel(self, tmp_path: Path) -> None:
        """At 5 m/s and 2 ms a ball stays above a floor of one quad (worlds 54, 59)."""
        quad = mesh_of([(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0)], TWO_FACES)
        world = build_world(tmp_path, scene_of(thing(quad, "floor"), starts=[HERE]))
        for height in (1.28, 1.5, 1.7):
            data = self.drop(self.ball(world.built.folder, (0.3, 0.1, height)), "ball", 4.0)
            assert data.body("ball").xpos[2] == pytest.approx(0.1, abs=0.02)

    def test_down_is_down(self, tmp_path: Path) -> None:
        """A free ball falls towards -z (worlds 77)."""
        world = build_world(tmp_path, scene_of(FLOOR, starts=[HERE]))
        data = self.drop(self.ball(world.built.folder, (0, 0, 3.0)), "ball", 0.3)
        assert data.body("ball").xpos[2] < 2.8

    def test_movable_things_can_be_pushed(self, tmp_path: Path) -> None:
        """A movable thing is a body with its mass; the same one fixed is none (worlds 29)."""
        crate = cuboid_mesh((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))
        world = build_world(
            tmp_path,
            scene_of(
                FLOOR,
                thing(crate, "loose", Pose((1, 0, 0.2)), movable=True, mass=3.0),
                thing(crate, "fixed", Pose((2, 0, 0.2))),
                starts=[HERE],
            ),
        )
        model = world.model
        assert model.body("loose").mass[0] == pytest.approx(3.0)
        assert model.nbody == 2
        spec_ball = self.ball(world.built.folder, (0.4, 0, 0.2))
        data = mujoco.MjData(spec_ball)
        data.qvel[spec_ball.body("ball").dofadr[0]] = 4.0
        for _ in range(500):
            mujoco.mj_step(spec_ball, data)
        assert data.body("loose").xpos[0] > 1.01
        assert world.names((2, 0, 3), (0, 0, -1)) == "fixed"

    def test_shapes_of_all_kinds(self, tmp_path: Path) -> None:
        """Boxes, balls, cylinders, capsules and planes are exact, fixed or movable."""
        shapes: dict[str, tuple[Shape, float]] = {
            "box": (Box((1, 1, 1)), 0.5),
            "ball": (Sphere(0.4), 0.4),
            "can": (Cylinder(0.3, 1.2), 0.6),
            "pill": (Capsule(0.3, 0.6), 0.6),
        }
        things = {
            f"{how}_{name}": (shape, Pose((3.0 * n - 4.5, y, 1.0)), 8.0 - top)
            for n, (name, (shape, top)) in enumerate(shapes.items())
            for how, y in (("fixed", 2.0), ("loose", -2.0))
        }
        objects = [
            SceneObject(name, (Part(shape),), pose, movable="loose" in name)
            for name, (shape, pose, _) in things.items()
        ]
        ground = SceneObject("ground", (Part(Plane()),))
        world = build_world(tmp_path, scene_of(ground, *objects, starts=[HERE]))
        for name, (_, pose, depth) in things.items():
            above = (*pose.position[:2], 9.0)
            assert world.names(above, (0, 0, -1)) == name
            assert world.rays(above, AXES[5:])[0] == pytest.approx(depth, abs=1e-3)
            kinds = {
                int(world.model.geom_type[geom])
                for geom in range(world.model.ngeom)
                if name in (world.model.geom(geom).name, world.model.body(
                    int(world.model.geom_bodyid[geom])).name)
            }  # fmt: skip
            assert len(kinds) == 1
            assert mujoco.mjtGeom.mjGEOM_MESH not in kinds
        assert world.rays((0, 20, 2), AXES[5:])[0] == pytest.approx(2.0)

    def test_balls_and_cylinders_roll(self, tmp_path: Path) -> None:
        """A ball and a cylinder that are pushed roll on, at an even height."""
        lying = quaternion_from_rpy(math.pi / 2.0, 0.0, 0.0)
        ball = SceneObject("ball", (Part(Sphere(0.3)),), Pose((0, 1, 0.3)), movable=True)
        can = SceneObject(
            "can", (Part(Cylinder(0.3, 0.8)),), Pose((0, -1, 0.3), lying), movable=True
        )
        world = build_world(tmp_path, scene_of(FLOOR, ball, can, starts=[HERE]))
        model = world.model
        model.opt.timestep = 0.002
        data = mujoco.MjData(model)
        for name in ("ball", "can"):
            data.qvel[model.body(name).dofadr[0]] = 1.0
        heights = []
        for _ in range(1000):
            mujoco.mj_step(model, data)
            heights.append([data.body(name).xpos[2] for name in ("ball", "can")])
        assert np.ptp(np.array(heights[100:]), axis=0).max() < 2e-3
        for name in ("ball", "can"):
            assert data.body(name).xpos[0] > 1.0
            assert abs(data.body(name).cvel[1]) > 1.5  # about y: it rolls and does not slide

    @pytest.mark.parametrize("degrees", [0, 20, 45])
    def test_extents_of_round_things(self, tmp_path: Path, degrees: float) -> None:
        """Extents of balls, cylinders and capsules are exact, whatever way they are turned."""
        turn = quaternion_from_rpy(math.radians(degrees), 0.0, math.radians(degrees))
        for shape, radius, half in (
            (Sphere(0.7), 0.7, 0.0),
            (Capsule(0.4, 1.0), 0.4, 0.5),
        ):
            thing = SceneObject("it", (Part(shape),), Pose((0.0, 0.0, 2.0), turn))
            low, high = build_world(tmp_path, scene_of(thing, starts=[HERE])).built.extents
            axis = Pose((0.0, 0.0, 0.0), turn).rotate((0.0, 0.0, half))
            np.testing.assert_allclose(high - low, 2.0 * (np.abs(axis) + radius), atol=1e-9)

    def test_terrain(self, tmp_path: Path) -> None:
        """Terrain is stood on where it is seen (worlds 63)."""
        x, y = np.meshgrid(np.arange(41) * 0.5, np.arange(21) * 0.5)
        heights = 0.3 * np.sin(x) + 0.2 * np.cos(y)
        field = Heightfield("hills", heights, (0.5, 0.5), Pose((-10, -5, 1.0)), tag="T")
        world = build_world(
            tmp_path, scene_of(starts=[StartPose("S", Pose((0, 0, 2)))], heightfields=(field,))
        )
        for place in ((-3.0, 1.0, 5.0), (4.5, -2.5, 5.0)):
            seen, felt = world.rays(place, AXES[5:])[0], world.solid_rays(place, AXES[5:])[0]
            row, column = round((place[1] + 5) / 0.5), round((place[0] + 10) / 0.5)
            assert seen == pytest.approx(4.0 - heights[row, column], abs=1e-4)
            assert felt == pytest.approx(seen, abs=1e-3)

    def test_large_terrain_is_a_height_field(self, tmp_path: Path) -> None:
        """A mesh of 100 000 triangles costs less than 200 MB and collides as a grid (worlds 63)."""
        x, y = np.meshgrid(np.linspace(0, 20, 225), np.linspace(0, 20, 225))
        ground = grid_mesh(
            224, 224, 60.0, np.sin(x * 1.7) * 0.4 + np.cos(y * 1.3) * 0.5 + 0.01 * x * y
        )
        assert len(ground.triangles) > 100_000
        world = build_world(
            tmp_path, scene_of(thing(ground, "ground"), starts=[StartPose("S", Pose((0, 0, 5)))])
        )
        assert world.built.pieces == 1
        assert world.built.memory < 200.0
        seen, felt = world.rays((3, 4, 9), AXES[5:])[0], world.solid_rays((3, 4, 9), AXES[5:])[0]
        assert felt == pytest.approx(seen, abs=0.03)


class TestTelling:
    """Names, places, people, lamps."""

    def test_names_survive(self, tmp_path: Path) -> None:
        """Equal names get distinct ones; the old name finds them all (worlds 69)."""
        desk = cuboid_mesh((0, 0, 0), (0.5, 0.5, 0.5))
        things = [thing(desk, "My desk", Pose((n, 0, 0)), tag=f"T{n}") for n in range(3)]
        world = build_world(tmp_path, scene_of(FLOOR, *things, starts=[HERE]))
        found = world.description.objects_called("my desk")
        assert [one.name for one in found] == ["My_desk", "My_desk-2", "My_desk-3"]
        assert world.description.objects_called("T1") == found[1:2]
        assert world.names((1.25, 0.25, 2), (0, 0, -1)) == "My_desk-2"

    def test_starts_that_cannot_be_used_are_told(self, tmp_path: Path) -> None:
        """A start in a solid, or without floor below, is reported by name (worlds 71)."""
        starts = [
            HERE,
            StartPose("Buried", Pose((0, 0, -0.1))),
            StartPose("Lost", Pose((9.0, 0, 1.0))),
            StartPose("Far", Pose((900.0, 0, 1.0))),
        ]
        world = build_world(tmp_path, scene_of(FLOOR, starts=starts))
        text = world.texts()
        assert "Buried: something solid" in text
        assert "Lost: no floor" in text
        assert "Far: a start pose far outside" in text
        assert "Here" not in text
        assert [place.name for place in world.built.checks] == ["Here", "Buried", "Lost"]

    def test_a_map_without_start_gets_one(self, tmp_path: Path) -> None:
        """It is free and has a floor below."""
        pillar = thing(cuboid_mesh((-1, -1, 0), (1, 1, 2)), "pillar")
        world = build_world(tmp_path, scene_of(FLOOR, pillar))
        (place,) = world.built.checks
        assert place.height == pytest.approx(0.25, abs=0.01)
        assert place.overlap == 0.0
        assert "no start pose" in world.texts()

    def test_people_stand_on_the_floor(self, tmp_path: Path) -> None:
        """The posture follows the room there is; scale and heading are kept (worlds 28)."""
        shelf = thing(cuboid_mesh((2, -2, 1.2), (4, 2, 1.4)), "shelf")
        people = (
            map_victim("MaleVictim_0", Pose((-2, 0, 0.4), turned(90)), scale=(1.2, 1.2, 1.2)),
            map_victim("FemaleVictim_0", Pose((3, 0, 0.4)), "female"),
            map_victim("MaleVictim_1", Pose((-2, 2, 0.5)), posture="lying", status="Dead"),
        )
        world = build_world(tmp_path, scene_of(FLOOR, shelf, starts=[HERE], victims=people))
        first, second, third = world.description.victims
        assert first.posture == "standing"
        assert first.scale == pytest.approx(1.2)
        assert first.pose.position == pytest.approx(
            (-2, 0, 1.2 * PELVIS_HEIGHT["standing"]), abs=1e-5
        )
        assert first.pose.rotate((1, 0, 0)) == pytest.approx((0, 1, 0))
        assert (second.posture, second.properties["figure"]) == ("sitting", "female")
        assert (third.posture, third.status) == ("lying", "Dead")

    def test_path_nodes_keep_their_neighbours(self, tmp_path: Path) -> None:
        """Neighbours are the other nodes, by their names on the wire."""
        nodes = (PathNode("A b", (0, 0, 1), ("C", "nobody")), PathNode("C", (1, 0, 1), ("A b",)))
        world = build_world(tmp_path, scene_of(FLOOR, starts=[HERE], path_nodes=nodes))
        assert [(n.tag, n.neighbours) for n in world.description.path_nodes] == [
            ("A_b", ("C",)),
            ("C", ("A_b",)),
        ]

    def test_smoke_arrives(self, tmp_path: Path) -> None:
        """Volumes, particles and haze are those of the scene."""
        smoke = Smoke(
            (SmokeVolume("fog", "ellipsoid", Pose((1, 2, 1), turned(30)), (2, 3, 2), 0.5),),
            (SmokePuff("fire", (0, 0, 1), (1, 1, 2), 50, 0.1, 7, 5.0),),
            0.01,
        )
        world = build_world(tmp_path, scene_of(FLOOR, starts=[HERE], smoke=smoke))
        read = world.description.smoke
        assert read.puffs == smoke.puffs
        assert (read.haze, read.haze_top) == (0.01, math.inf)
        assert read.volumes[0].size == smoke.volumes[0].size
        assert read.volumes[0].pose.matrix() == pytest.approx(smoke.volumes[0].pose.matrix())

    def test_lights_are_carried_over(self, tmp_path: Path) -> None:
        """Place, colour and count are kept; more than cameras know are left out and told
        (worlds 76)."""
        one = Light("lamp", position=(1, 2, 3), color=(1.0, 0.5, 0.0), reach=4.0)
        sun = Light("sun", LightKind.DIRECTIONAL, direction=(0, 0, -2))
        world = build_world(tmp_path, scene_of(FLOOR, starts=[HERE], lights=(one, sun)))
        model = world.model
        assert model.nlight == 2
        assert model.light("lamp").pos == pytest.approx((1, 2, 3))
        assert model.light("lamp").diffuse == pytest.approx((0.8, 0.4, 0.0), abs=1e-6)
        many = tuple(Light(f"l{n}", position=(n, 0, 2), brightness=n) for n in range(20))
        crowded = build_world(tmp_path, scene_of(FLOOR, starts=[HERE], lights=many))
        assert crowded.model.nlight == 7
        assert "13 of 20 lights were left out" in crowded.texts()
        assert crowded.model.light(0).name == "l13"

    def test_backdrops_do_not_count(self, tmp_path: Path) -> None:
        """A box of 2 km around a room is cut off; a painted sky is left out (pitfall, 12)."""
        text = level(
            brush("Giant", (-250_000, -250_000, -5_000), (250_000, 250_000, 60_000)),
            brush("Hall", (-1000, -1000, 0), (1000, 1000, 800), "CSG_Subtract"),
            start("S", (0, 0, 60)),
        )
        world = import_text(tmp_path, text)
        assert (world.built.upper - world.built.lower).max() < 10.0
        np.testing.assert_allclose(world.rays((0, 0, 1))[:4], 4.0, atol=1e-4)
        sky = thing(cuboid_mesh((-900, -900, -900), (900, 900, 900)), "SkyDome_01")
        clear = build_world(tmp_path, scene_of(FLOOR, sky, starts=[HERE]))
        assert clear.rays((0, 0, 1))[4] == np.inf

    @pytest.mark.parametrize("size", [0.001, 5000.0])
    def test_absurd_sizes_are_refused(self, tmp_path: Path, size: float) -> None:
        """A map of a millimetre or of 10 km has the wrong scale; the cure names one
        (worlds reference 11 no. 7)."""
        mesh = cuboid_mesh((-size, -size, -size), (size, size, size))
        with pytest.raises(MapImportError, match=r"absurd.*--scale"):
            build_world(tmp_path, scene_of(thing(mesh), starts=[HERE]))

    def test_empty_maps_are_refused(self, tmp_path: Path) -> None:
        """Nothing to stand on is an error with a cure."""
        with pytest.raises(MapImportError, match="no geometry"):
            build_world(tmp_path, scene_of())
        ghost = SceneObject(
            "g", (Part(cuboid_mesh((0, 0, 0), (2, 2, 2)), collision=Collision.NONE),)
        )
        with pytest.raises(MapImportError, match="nothing solid"):
            build_world(tmp_path, scene_of(ghost))

    def test_runs_repeat(self, tmp_path: Path) -> None:
        """Two imports of one map give the same files to the byte (worlds 75)."""
        text = level(
            room(),
            brush("Block", (100, 100, 0), (300, 250, 200)),
            actor("PointLight", "L", (0, 0, 500)),
            start("S", (0, 0, 60)),
        )
        folders = []
        for name in ("one", "two"):
            (tmp_path / name).mkdir()
            folders.append(import_text(tmp_path / name, text).built.folder)
        files = [
            {p.relative_to(f): p.read_bytes() for p in sorted(f.rglob("*")) if p.is_file()}
            for f in folders
        ]
        assert files[0] == files[1]
