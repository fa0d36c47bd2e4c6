"""Rays against MuJoCo's own rays: what is hit, how far, with which normal, and what never is."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from ray_scenes import (
    Caster,
    Reference,
    agree,
    check_against_reference,
    narrow_fans,
    outside_height_fields,
    random_fans,
    random_scene,
    ray,
)
from sim_fakes import (
    RADIUS,
    ROBOT,
    Geom,
    add_box,
    base_qpos,
    box,
    engine_with,
    floor,
    furnished,
    run,
    yard,
)

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.rays.cast import cast, cast_all
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.query import PendingReport, RayFan
from usarsim_server.simulation.rays.scenery import StaticGeometry, is_glass, words_of
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

Array = NDArray[np.float64]


class TestStatic:
    """Fixed geometry of every kind."""

    @pytest.mark.parametrize("seed", range(6))
    def test_distances_are_those_of_mujoco(self, seed: int) -> None:
        """In random worlds of all shapes distances agree within 1 mm (edges may be 1 mm off)."""
        engine = Engine(lambda: random_scene(seed), PhysicsOptions())
        mujoco.mj_kinematics(engine.world.model, engine.data)
        fans = random_fans(np.random.default_rng(seed), count=14)
        assert check_against_reference(Caster(engine), outside_height_fields(engine, fans)) > 200

    def test_planes_are_endless(self) -> None:
        """A plane stops rays as it stops wheels: everywhere, also beyond its drawn size."""

        def scenery() -> mujoco.MjSpec:
            spec = mujoco.MjSpec()
            spec.worldbody.add_geom(type=Geom.mjGEOM_PLANE, size=[1.0, 1.0, 1.0])
            return spec

        (hit,) = Caster(Engine(scenery, PhysicsOptions()))(ray((5, 5, 2), (0, 0, -1)))
        assert hit.distances[0] == pytest.approx(2.0)

    def test_planes_are_seen_from_above_only(self) -> None:
        """A plane is the surface of a half-space: seen from below it is not there."""
        (hit,) = Caster(Engine(floor(), PhysicsOptions()))(ray((0, 0, -2), (0, 0, 1)))
        assert np.isinf(hit.distances[0])

    def test_sloping_planes(self) -> None:
        """Distance to a slope is that of geometry."""
        caster = Caster(Engine(floor(slope=np.radians(30.0)), PhysicsOptions()))
        (hit,) = caster(ray((-1, 0, 0), (1, 0, 0), normals=True))
        assert hit.distances[0] == pytest.approx(1.0)
        assert hit.normals is not None
        np.testing.assert_allclose(hit.normals[0], (-0.5, 0.0, np.sqrt(0.75)), atol=1e-9)

    def test_a_world_without_anything(self) -> None:
        """In an empty world nothing is hit, and asking does not fail."""
        (hit,) = Caster(Engine(mujoco.MjSpec, PhysicsOptions()))(
            ray((0, 0, 1), (1, 0, 0), normals=True)
        )
        assert np.isinf(hit.distances[0])
        assert hit.normals is not None
        assert not hit.normals.any()

    def test_the_parking_shelf_is_invisible(self) -> None:
        """Looking up one sees the sky, not the shelf above the world."""
        caster = Caster(engine_with((0.0, 0.0), spare=3))
        (hit,) = caster(ray((0, 0, 1), (0, 0, 1), reach=1e6), robot=0)
        assert np.isinf(hit.distances[0])

    def test_geometry_without_colour_is_invisible(self) -> None:
        """What is drawn with alpha zero is not seen by rays either."""

        def scenery() -> mujoco.MjSpec:
            spec = floor()()
            add_box(spec, "ghost", (2.0, 0.0, 0.5), (0.1, 1.0, 0.5)).rgba = [1, 1, 1, 0]
            add_box(spec, "wall", (3.0, 0.0, 0.5), (0.1, 1.0, 0.5))
            return spec

        (hit,) = Caster(Engine(scenery, PhysicsOptions()))(ray((0, 0, 0.5), (1, 0, 0)))
        assert hit.distances[0] == pytest.approx(2.9)

    def test_far_from_the_origin(self) -> None:
        """A kilometre away from the origin distances are good to a millimetre."""
        scenery = furnished(box("wall", (1003.0, 1000.0, 0.5), (0.1, 1.0, 0.5)))
        caster = Caster(Engine(scenery, PhysicsOptions()))
        (hit,) = caster(ray((1000.2, 1000.3, 0.5), (1, 0, 0)))
        assert hit.distances[0] == pytest.approx(2.7, abs=1e-3)


class TestGlass:
    """Transparent material lets some rays through."""

    @pytest.fixture
    def caster(self) -> Caster:
        """A glass pane by material, one by name, and a wall behind them."""

        def scenery() -> mujoco.MjSpec:
            spec = floor()()
            spec.add_material(name="Window_Glass", rgba=[0.5, 0.7, 0.9, 0.3])
            add_box(spec, "pane", (1.0, 0.0, 0.5), (0.01, 1.0, 0.5)).material = "Window_Glass"
            add_box(spec, "TransparentDoor", (2.0, 0.0, 0.5), (0.01, 1.0, 0.5))
            add_box(spec, "wall", (3.0, 0.0, 0.5), (0.1, 1.0, 0.5))
            return spec

        return Caster(Engine(scenery, PhysicsOptions()))

    def test_stops_rays_normally(self, caster: Caster) -> None:
        """A laser or sonar sees a pane."""
        (hit,) = caster(ray((0, 0, 0.5), (1, 0, 0)))
        assert hit.distances[0] == pytest.approx(0.99)

    def test_lets_through_on_request(self, caster: Caster) -> None:
        """An infrared ray reads the wall behind the glass (robots 77)."""
        (hit,) = caster(ray((0, 0, 0.5), (1, 0, 0), through_glass=True))
        assert hit.distances[0] == pytest.approx(2.9)

    def test_both_kinds_in_one_batch(self, caster: Caster) -> None:
        """Fans of both kinds are answered in order, whatever their mixture."""
        fans = [ray((0, 0, 0.5), (1, 0, 0), through_glass=bool(k % 3)) for k in range(7)]
        seen = [float(hit.distances[0]) for hit in caster(*fans)]
        np.testing.assert_allclose(seen, [2.9 if k % 3 else 0.99 for k in range(7)], atol=1e-4)


class TestFans:
    """Batches, ranges and normals."""

    def test_beyond_the_range_is_a_miss(self) -> None:
        """What is farther than a fan's range is not hit, each fan by its own range."""
        caster = Caster(Engine(yard, PhysicsOptions()))
        near, far, plain = caster(
            ray((0, 0, 0.5), (1, 0, 0), reach=2.89, normals=True),
            ray((0, 0, 0.5), (1, 0, 0), reach=2.91),
            ray((0, 0, 3.0), (0, 0, -1), reach=2.99),
        )
        assert np.isinf(near.distances[0])
        assert near.normals is not None
        assert not near.normals.any()
        assert far.distances[0] == pytest.approx(2.9)
        assert np.isinf(plain.distances[0])

    def test_moving_things_beyond_the_range_are_a_miss(self) -> None:
        """The range holds for robots and crates as well."""
        caster = Caster(engine_with((0.0, 0.0), (2.0, 0.0)))
        inside, outside = caster(
            ray((0.3, 0, 0.15), (1, 0, 0), reach=1.51),
            ray((0.3, 0, 0.15), (1, 0, 0), reach=1.49),
            robot=0,
        )
        assert inside.distances[0] == pytest.approx(1.5, abs=1e-6)
        assert np.isinf(outside.distances[0])

    @pytest.mark.parametrize("reach", [1e9, np.inf])
    def test_no_limit(self, reach: float) -> None:
        """A ray to a satellite may be as long as it likes."""
        caster = Caster(engine_with((0.0, 0.0), (2.0, 0.0)))
        up, ahead = caster(
            ray((0, 0, 1), (0, 0, 1), reach), ray((0.3, 0, 0.15), (1, 0, 0), reach), robot=0
        )
        assert np.isinf(up.distances[0])
        assert ahead.distances[0] == pytest.approx(1.5, abs=1e-6)

    def test_answers_keep_the_order_of_the_fans(self) -> None:
        """Fans of different sizes and origins are answered in their order."""
        caster = Caster(Engine(yard, PhysicsOptions()))
        fans = []
        for count in (1, 5, 2):
            directions = np.tile([1.0, 0.0, 0.0], (count, 1))
            fans.append(RayFan(np.array([0.1 * count, 0.0, 0.5]), directions, 20.0))
        for fan, hit in zip(fans, caster(*fans), strict=True):
            expected = np.full(len(fan.directions), 2.9 - fan.origin[0])
            np.testing.assert_allclose(hit.distances, expected, atol=1e-5)

    def test_no_fans_no_answers(self) -> None:
        """An empty batch is fine."""
        assert Caster(engine_with((0.0, 0.0)))() == []

    def test_normals_only_for_those_who_ask(self) -> None:
        """A fan that does not ask gets no normals, also beside one that does."""
        caster = Caster(Engine(yard, PhysicsOptions()))
        silent, asking = caster(
            ray((0, 0, 0.5), (1, 0, 0)), ray((0, 0, 0.5), (1, 0, 0), normals=True)
        )
        assert silent.normals is None
        assert asking.normals is not None
        np.testing.assert_allclose(asking.normals, [[-1.0, 0.0, 0.0]], atol=1e-9)

    @pytest.mark.parametrize("seed", range(3))
    def test_normals_are_unit_and_face_the_origin(self, seed: int) -> None:
        """Normals have length one where something was hit, face the ray, and are MuJoCo's."""
        engine = Engine(lambda: random_scene(seed, copies=4), PhysicsOptions())
        caster = Caster(engine)
        reference = Reference(engine.world)
        reference.show(engine.snapshot(), None)
        fans = outside_height_fields(engine, random_fans(np.random.default_rng(seed + 50)))
        compared = 0
        for fan, hit in zip(fans, caster(*fans), strict=True):
            assert hit.normals is not None
            found = np.isfinite(hit.distances)
            lengths = np.linalg.norm(hit.normals, axis=1)
            np.testing.assert_allclose(lengths[found], 1.0, atol=1e-6)
            assert not lengths[~found].any()
            facing = np.einsum("ij,ij->i", hit.normals, fan.directions)
            assert (facing[found] <= 1e-9).all()
            truth, normals, _ = reference.cast(fan.origin, fan.directions)
            same = found & agree(hit.distances, truth)
            cosine = np.abs(np.einsum("ij,ij->i", hit.normals, normals))
            compared += int(same.sum())
            # Facets of round shapes lean a little; 8 degrees is one facet of the coarsest.
            assert (cosine[same] > np.cos(np.radians(16.0))).all()
        assert compared > 40

    def test_normals_of_moving_things(self) -> None:
        """The normal of a robot's flat side faces who looks at it, from either side."""
        caster = Caster(engine_with((0.0, 0.0), (2.0, 0.0)))
        ahead, back = caster(
            ray((0.3, 0, 0.15), (1, 0, 0), normals=True),
            ray((4.0, 0, 0.15), (-1, 0, 0), normals=True),
            robot=0,
        )
        assert ahead.normals is not None
        assert back.normals is not None
        np.testing.assert_allclose(ahead.normals, [[-1.0, 0.0, 0.0]], atol=1e-6)
        np.testing.assert_allclose(back.normals, [[1.0, 0.0, 0.0]], atol=1e-6)

    def test_many_start_points(self) -> None:
        """A fan may have a start point for every ray; each is answered from its own."""
        caster = Caster(engine_with((0.0, 0.0), (2.0, 0.0), scenery=yard))
        dice = np.random.default_rng(5)
        origins = dice.uniform((-0.5, -1.0, 0.4), (0.5, 1.0, 0.6), (30, 3))
        origins[:15, 2] = 0.15
        directions = np.tile([1.0, 0.0, 0.0], (30, 1))
        (together,) = caster(RayFan(origins, directions, 20.0, normals=True), robot=0)
        single = caster(
            *[RayFan(o, d[None], 20.0) for o, d in zip(origins, directions, strict=True)], robot=0
        )
        np.testing.assert_allclose(
            together.distances, [hit.distances[0] for hit in single], atol=1e-5
        )
        assert len(set(np.round(together.distances, 3))) > 5

    @pytest.mark.parametrize("seed", range(3))
    def test_many_start_points_at_robots(self, seed: int) -> None:
        """Each of many parallel rays meets the robot that MuJoCo's single ray meets, or nothing."""
        engine = engine_with((0.0, 0.0), (1.5, 0.2, RADIUS, 0.5), (2.0, -0.8))
        caster, snapshot = Caster(engine), engine.snapshot()
        dice = np.random.default_rng(seed)
        origins = dice.uniform((-1.0, -1.2, 0.02), (-0.5, 0.6, 0.3), (300, 3))
        directions = np.tile([1.0, 0.0, 0.0], (300, 1))
        fan = RayFan(origins, directions, 2.4, normals=True, identify=True)
        (hit,) = caster.at(snapshot, fan, robot=0)
        reference = Reference(engine.world)
        reference.show(snapshot, 0)
        assert hit.normals is not None
        assert hit.names is not None
        met = np.zeros(1, dtype=np.int32)
        for row, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
            normal = np.zeros(3)
            far = mujoco.mj_ray(
                reference.model, reference.data, origin, direction, None, 1, -1, met, normal
            )
            if met[0] < 0 or far > fan.max_range:
                assert np.isinf(hit.distances[row])
                assert hit.names[row] is None
                assert not hit.normals[row].any()
            else:
                assert hit.distances[row] == pytest.approx(far, abs=1e-3)
                assert hit.normals[row] @ normal > 0.99, "a facet leans a little"
                assert hit.names[row] == caster.dynamic.objects.names[met[0]]
        assert 30 < np.isfinite(hit.distances).sum() < 270


class TestBatches:
    """Many viewers at once."""

    def test_are_answered_as_if_each_had_asked_alone(self) -> None:
        """Robots with fans of all sizes and kinds get in one batch what they get one by one."""
        engine = engine_with(*[(1.5 * k, 0.3 * k) for k in range(5)], scenery=yard)
        static, dynamic = StaticGeometry(engine.world), DynamicGeometry(engine.world)
        snapshot, dice = engine.snapshot(), np.random.default_rng(3)
        empty = RayFan(np.zeros(3), np.zeros((0, 3)), 1.0)
        queries = [PendingReport(snapshot, 1), PendingReport(snapshot, 2, [empty])]
        for robot in (0, 1, 2, 3, 4, None, 99):
            x, y, z = snapshot.xpos[engine.world.layouts[(robot or 0) % 5].base]
            angles = np.linspace(-1.5, 1.5, 181)
            scan = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
            fans = [RayFan(np.array([x, y, z]), scan, 20.0), *narrow_fans(dice)]
            fans.append(RayFan(np.array([x, y, z]), scan[80:90], 5.0, normals=True, identify=True))
            queries.append(PendingReport(snapshot, robot, fans))
        together = cast_all(queries, static, dynamic)
        for query, answers in zip(queries, together, strict=True):
            alone = cast(query.fans, snapshot, query.robot, static, dynamic)
            for fan, one, other in zip(query.fans, answers, alone, strict=True):
                np.testing.assert_array_equal(one.distances, other.distances)
                assert one.names == other.names
                assert (one.normals is None) is not fan.normals
                if one.normals is not None and other.normals is not None:
                    np.testing.assert_array_equal(one.normals, other.normals)


def test_snapshot_of_a_robot_shows_where_its_rays_start() -> None:
    """A ray from a robot's own pose reads the distance from its reference point."""
    engine = engine_with((0.5, 0.0), scenery=yard)
    run(engine, 0.2)
    place = base_qpos(engine, 0)[:3]
    (hit,) = Caster(engine)(ray(tuple(place), (1, 0, 0)), robot=0)
    assert hit.distances[0] == pytest.approx(2.9 - place[0], abs=1e-5)


SHIPPED = [sheet.parent for sheet in sorted(Path(__file__).parents[2].glob("worlds/*/world.toml"))]


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_shipped_worlds(folder: Path) -> None:
    """In every shipped world rays from above the start poses agree with MuJoCo's within 1 mm."""
    world = load_world(folder)
    engine = Engine(lambda: build_scene(world), PhysicsOptions(), [ROBOT] * 3)
    dice = np.random.default_rng(1)
    fans = []
    for robot, start in enumerate(world.starts[:8]):
        if robot < 3:
            engine.occupy(robot, robot, start.pose)
        directions = dice.normal(size=(60, 3)) * [1.0, 1.0, 0.3]
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        fans.append(RayFan(np.add(start.pose.position, (0, 0, 0.3)), directions, 25.0))
    assert check_against_reference(Caster(engine), fans, robot=0) > 200


def judged(geom: str, material: str | None) -> bool:
    """Whether a geom of this name and material is glass."""
    spec = mujoco.MjSpec()
    if material is not None:
        spec.add_material(name=material)
    made = spec.worldbody.add_geom(
        name=geom, type=mujoco.mjtGeom.mjGEOM_BOX, size=[1.0, 1.0, 1.0], material=material or ""
    )
    assert made is not None
    return is_glass(spec.compile(), 0)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wall_pane_12", ["wall", "pane"]),
        ("WindowTrans01", ["window", "trans"]),
        ("LT_Floors.SM.Mat_GLASSPane", ["lt", "floors", "sm", "mat", "glass", "pane"]),
        ("transport_box", ["transport", "box"]),
        ("", []),
    ],
)
def test_names_are_parted_into_words(name: str, words: list[str]) -> None:
    """By capitals, digits and punctuation."""
    assert words_of(name) == words


@pytest.mark.parametrize(
    "material",
    [
        "glass",
        "Trans",
        "TransWhite",
        "HU_Trans_Glass02",
        "windowtrans",
        "plexiglass",
        "robot3:glass",
    ],
)
def test_materials_with_trans_or_glass(material: str) -> None:
    """Infrared goes through materials of imported maps with Trans in their name (robots 77)."""
    assert judged("panel_1", material)


@pytest.mark.parametrize("name", ["glass_door", "pane-trans", "GlassWall_3", "transparent_box"])
def test_geoms_named_after_glass(name: str) -> None:
    """A geom's own name will do, whatever it is made of."""
    assert judged(name, "metal")


@pytest.mark.parametrize(
    ("geom", "material"),
    [
        ("transport_box", "cardboard"),
        ("transformer_1", None),
        ("hourglass", "sand"),
        ("panel", "TransportBelt"),
        ("panel", "fibreglass"),
        ("translation_stage", "steel"),
    ],
)
def test_words_that_only_look_like_glass(geom: str, material: str | None) -> None:
    """Other words with the same letters are opaque."""
    assert not judged(geom, material)
