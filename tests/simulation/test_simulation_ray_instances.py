"""One Embree scene of everything that moves: it finds what is found without it."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from ray_scenes import Caster, add_meshes, add_shape, random_fans
from sim_fakes import Geom, engine_with

from usarsim_server.simulation.rays import cast as casting
from usarsim_server.simulation.rays import instances
from usarsim_server.simulation.rays import moving as moving_geometry
from usarsim_server.simulation.rays.instances import PlacedBodies, device, library
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.rays.triangles import TriangleScene

ROBOTS = 70
"""More than two scenes hold."""


@pytest.fixture
def fresh_library() -> Iterator[None]:
    """Embree is looked for anew, now and afterwards."""
    library.cache_clear()
    yield
    library.cache_clear()


def panes() -> mujoco.MjSpec:
    """Loose things of every shape in a small room, each with a pane of glass beside it."""
    dice = np.random.default_rng(11)
    spec = mujoco.MjSpec()
    add_meshes(spec)
    spec.mesh("tray").inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    for number, shape in enumerate(("box", "sphere", "ellipsoid", "capsule", "cylinder", "mesh")):
        body = spec.worldbody.add_body(name=f"loose{number}", pos=dice.uniform((-3, -3, 3), 6.0))
        body.add_freejoint()
        add_shape(spec, body, f"shape{number}", shape, dice, spread=0.2).mass = 1.0
        body.add_geom(name=f"glass{number}", type=Geom.mjGEOM_BOX, size=[0.02, 0.8, 0.8], mass=0.1)
    return spec


@pytest.mark.skipif(library() is None, reason="Embree cannot be asked on this machine")
class TestOneScene:
    """What it finds."""

    def test_is_what_is_found_without_it(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Distances, normals and names are the same to the bit, through glass too, for all eyes."""
        engine = engine_with((0.0, 0.0), (1.2, 0.3), (-1.0, 0.5), scenery=panes)
        snapshot = engine.snapshot()
        things = snapshot.xpos[1:]
        fans: list[RayFan] = []
        for number, fan in enumerate(random_fans(np.random.default_rng(5), 40, 60)):
            looks = {"identify": number % 3 == 0, "through_glass": number % 2 == 0}
            ways = things[number % len(things)] - fan.origin + 0.3 * fan.directions
            ways /= np.linalg.norm(ways, axis=1)[:, None]
            fans.append(replace(fan, directions=ways, max_range=6.0 + number % 7, **looks))
        monkeypatch.setattr(casting, "ray_code", lambda: None)
        monkeypatch.setattr(moving_geometry, "MANY_PAIRS", 0)
        at_once = [Caster(engine).at(snapshot, *fans, robot=robot) for robot in (None, 1)]
        monkeypatch.setattr(moving_geometry, "library", lambda: None)
        hits = 0
        for robot, answers in zip((None, 1), at_once, strict=True):
            for one, other in zip(
                answers, Caster(engine).at(snapshot, *fans, robot=robot), strict=True
            ):
                np.testing.assert_array_equal(one.distances, other.distances)
                np.testing.assert_array_equal(one.normals, other.normals)
                assert one.names == other.names
                hits += int(np.isfinite(one.distances).sum())
        assert hits > 1000

    def test_more_robots_than_a_mask_has_bits(self) -> None:
        """Each ray of a large team meets the next robot in line, not the one that it belongs to."""
        box = TriangleScene([(0, _box())])
        numbers = np.arange(ROBOTS)
        places = np.stack([3.0 * numbers, np.zeros(ROBOTS), np.full(ROBOTS, 500.0)], axis=1)
        turns = np.broadcast_to(np.eye(3), (ROBOTS, 3, 3))
        bodies = PlacedBodies([box.embree] * ROBOTS, numbers + 7, 2 * numbers + 3, turns, places)
        ways = np.tile([1.0, 0.0, 0.0], (ROBOTS, 1))
        seen = bodies.first_met(places, ways, np.full(ROBOTS, 5.0), 2 * numbers + 3)
        assert seen.tolist() == [*range(8, ROBOTS + 7), -1]
        assert bodies.first_met(places, ways, np.full(ROBOTS, 1.5), 2 * numbers + 3).max() == -1, (
            "too far"
        )
        nobody = np.full(ROBOTS, -1)
        assert (bodies.first_met(places, ways, np.full(ROBOTS, 5.0), nobody) == numbers + 7).all()
        away = places + [0.0, 0.0, 2.0] * (numbers % 3 == 1)[:, None]
        bodies.move(turns, away)
        seen = bodies.first_met(places, ways, np.full(ROBOTS, 4.0), 2 * numbers + 3)
        last = (numbers + 1 == ROBOTS) | ((numbers + 1) % 3 == 1)
        assert (seen == np.where(last, -1, numbers + 8)).all(), "some have been moved away"

    def test_a_shape_without_a_surface_is_not_met(self) -> None:
        """Nothing is placed where there is nothing to see."""
        nothing = TriangleScene([])
        one = np.zeros(1, dtype=np.intp)
        bodies = PlacedBodies([nothing.embree], one, one, np.eye(3)[None], np.zeros((1, 3)))
        assert bodies.first_met(np.ones((1, 3)), np.eye(3)[:1], np.ones(1), one - 1).tolist() == [
            -1
        ]

    def test_is_given_back(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The scene of an instant that nobody needs any more is released."""
        released: list[int] = []
        monkeypatch.setattr(instances, "_release", lambda _, scenes: released.extend(scenes))
        box = TriangleScene([(0, _box())])
        one = np.zeros(1, dtype=np.intp)
        bodies = PlacedBodies([box.embree], one, one, np.eye(3)[None], np.zeros((1, 3)))
        assert not released
        del bodies
        gc.collect()
        assert len(released) == 1


@pytest.mark.usefixtures("fresh_library")
class TestWithoutTheLibrary:
    """Machines and versions where Embree cannot be asked."""

    @pytest.mark.parametrize("fails", [OSError, AttributeError])
    def test_symbols_that_are_not_there(
        self, fails: type[Exception], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """There is no scene then, and shapes are as good as ever."""

        def refuse(_: str) -> ctypes.PyDLL:
            raise fails

        monkeypatch.setattr(ctypes, "PyDLL", refuse)
        assert library() is None
        box = TriangleScene([(0, _box())])
        one = np.zeros(1, dtype=np.intp)
        with pytest.raises(RuntimeError, match="Embree"):
            PlacedBodies([box.embree], one, one, np.eye(3)[None], np.zeros((1, 3)))
        assert box.cast(np.array([[-3.0, 0, 0]]), np.eye(3)[:1]).distances.tolist() == [2.0]

    def test_another_layout(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """An `embreex` whose objects are not as it declares them is not looked into."""

        class Larger(instances.rtcore_scene.EmbreeScene):
            """With a dictionary, so of another size."""

        monkeypatch.setattr(instances.rtcore_scene, "EmbreeScene", Larger)
        assert library() is None
        assert device() is device()


def _box() -> np.ndarray:
    """Triangles (12, 3, 3) of a cube of 2 m about the origin."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='box' size='1 1 1'/></worldbody></mujoco>"
    )
    return moving_geometry.triangles(model, 0, np.zeros(3), np.eye(3))
