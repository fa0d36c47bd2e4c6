"""Mirror images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from built_worlds import AXES, World, build_world, import_text, mesh_of, scene_of, thing
from t3d_maps import corner

from usarsim_maps.scene import Heightfield, Light, map_victim
from usarsim_maps.units import reflect
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import PathNode, Smoke, SmokePuff, SmokeVolume, StartPose

TURNED = Pose((1.0, 2.0, 0.5), quaternion_from_rpy(0.3, -0.2, 0.7))


def heights(world: World, mirrored: bool) -> np.ndarray:
    """Depths below a grid of places, or below their mirror images."""
    sign = -1.0 if mirrored else 1.0
    places = [
        (x, sign * y, 8.0) for x in np.linspace(-3.03, 3.04, 13) for y in np.linspace(-3.1, 3.1, 13)
    ]
    seen = [world.rays(place, AXES[5:])[0] for place in places]
    felt = [world.solid_rays(place, AXES[5:])[0] for place in places]
    return np.array([seen, felt])


def test_a_level_is_mirrored(tmp_path: Path) -> None:
    """With `mirror` the map is its mirror image, for rays and for contacts (item 74)."""
    plain = import_text(tmp_path, corner())
    other = import_text(tmp_path, corner(), mirror=True)
    np.testing.assert_allclose(heights(other, True), heights(plain, False), atol=1e-5)
    assert (
        np.abs(heights(other, False) - heights(plain, False))[
            np.isfinite(heights(plain, False))
        ].max()
        > 1.0
    )
    assert not other.scene.source.mirrored


def test_objects_and_terrain_are_mirrored(tmp_path: Path) -> None:
    """A turned object without symmetry and a hill end where their images are."""
    wedge = mesh_of(
        [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 1), (1, 0, 1), (0, 2, 1)],
        [(0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5)],
    )
    # A sum of a function of x and one of y: every square is flat, however it is cut in two.
    hills = (0.3 * np.arange(9) % 0.7)[None, :] + (0.2 * np.arange(7) % 0.5)[:, None]
    field = Heightfield("hills", hills, (1.0, 1.0), Pose((-4.0, -2.0, -1.0)))
    scene = scene_of(
        thing(wedge, "wedge", TURNED),
        starts=[StartPose("S", Pose((0, 0, 3)))],
        heightfields=(field,),
    )
    plain, other = build_world(tmp_path, scene), build_world(tmp_path, reflect(scene))
    one, two = heights(plain, False), heights(other, True)
    assert np.isfinite(one).any()
    np.testing.assert_allclose(two, one, atol=2e-3)


def test_twice_is_nothing() -> None:
    """The mirror image of the mirror image is the scene."""
    smoke = Smoke(
        (SmokeVolume("v", "box", TURNED, (1, 2, 3), 0.1),),
        (SmokePuff("p", (1, 2, 3), (1, 1, 1), 5, 0.1, 1),),
    )
    scene = replace(
        scene_of(starts=[StartPose("S", TURNED)], smoke=smoke),
        victims=(map_victim("V", TURNED),),
        path_nodes=(PathNode("N", (1.0, 2.0, 3.0)),),
        lights=(Light("L", position=(1.0, 2.0, 3.0), direction=(0.1, 0.2, -1.0)),),
    )
    once, twice = reflect(scene), reflect(reflect(scene))
    assert once.starts != scene.starts
    assert (twice.starts, twice.victims, twice.smoke) == (scene.starts, scene.victims, scene.smoke)
    assert (twice.path_nodes, twice.lights) == (scene.path_nodes, scene.lights)
    matrix = np.diag([1.0, -1.0, 1.0])
    expected = matrix @ TURNED.matrix() @ matrix
    assert once.starts[0].pose.matrix() == pytest.approx(expected)
