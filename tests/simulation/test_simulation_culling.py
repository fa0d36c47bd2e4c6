"""Which rays pass through spheres, against the nearest of many points along each ray."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from usarsim_server.simulation.culling import touching
from usarsim_server.simulation.rays import RayFan

Array = NDArray[np.float64]


def unit(vectors: Array) -> Array:
    """Vectors (n, 3) of length one."""
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def nearest(origins: Array, directions: Array, centres: Array) -> Array:
    """Distances (n, t) of centres from rays, by looking for the least along each ray."""
    gaps = np.full((len(directions), len(centres)), np.inf)
    for way in np.linspace(0.0, 12.0, 2401):
        points = origins + way * directions
        gaps = np.minimum(gaps, np.linalg.norm(centres[None] - points[:, None], axis=2))
    return gaps


class TestTouching:
    @pytest.mark.parametrize("apart", [False, True])
    @pytest.mark.parametrize("seed", range(3))
    def test_is_where_a_ray_comes_nearer_than_a_radius(self, seed: int, apart: bool) -> None:
        """With one start for all rays, or one for each, exactly those rays are found."""
        dice = np.random.default_rng(seed)
        directions = unit(dice.normal(size=(60, 3)))
        origins = dice.uniform(-2.0, 2.0, (60, 3) if apart else 3)
        centres, radii = dice.uniform(-3.0, 3.0, (8, 3)), dice.uniform(0.3, 1.2, 8)
        gaps = nearest(np.broadcast_to(origins, (60, 3)), directions, centres)
        sure = (np.abs(gaps - radii) > 0.005).all(axis=1)
        expected = (gaps <= radii).any(axis=1)
        found = touching(RayFan(origins, directions, 20.0), centres, radii)
        np.testing.assert_array_equal(found[sure], expected[sure])
        assert 3 < expected[sure].sum() < 55

    def test_a_ray_that_begins_inside_counts_whatever_its_direction(self) -> None:
        """Whoever stands in a sphere may meet what is in it on any way."""
        directions = unit(np.random.default_rng(1).normal(size=(20, 3)))
        fan = RayFan(np.array([0.3, 0.0, 0.0]), directions, 1.0)
        assert touching(fan, np.zeros((1, 3)), np.array([0.5])).all()

    def test_what_lies_behind_does_not_count(self) -> None:
        """A ray is no line: it has a beginning."""
        fan = RayFan(np.zeros(3), np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]), 10.0)
        found = touching(fan, np.array([[3.0, 0.0, 0.0]]), np.array([1.0]))
        assert found.tolist() == [True, False]

    def test_spheres_without_end(self) -> None:
        """What may be anywhere is in the way of every ray."""
        fan = RayFan(np.zeros((2, 3)), unit(np.array([[1.0, 0, 0], [0, 1.0, 0]])), 10.0)
        assert touching(fan, np.array([[5.0, 5.0, 5.0]]), np.array([np.inf])).all()

    def test_nothing_there(self) -> None:
        """Without spheres no ray touches any."""
        fan = RayFan(np.zeros(3), np.array([[1.0, 0.0, 0.0]]), 10.0)
        assert not touching(fan, np.zeros((0, 3)), np.zeros(0)).any()

    @given(
        seed=st.integers(0, 10_000),
        away=st.floats(0.0, 1e5),
        radius=st.floats(0.05, 3.0),
        share=st.floats(0.0, 1.0),
    )
    def test_no_ray_through_a_point_of_a_sphere_is_lost(
        self, seed: int, away: float, radius: float, share: float
    ) -> None:
        """Not even one that grazes a sphere far away."""
        dice = np.random.default_rng(seed)
        ahead, side = unit(dice.normal(size=(2, 3)))
        side = unit(np.cross(ahead, side)[None])[0]
        centre = dice.uniform(-50.0, 50.0, 3)
        origin = centre + share * radius * side - away * ahead
        fan = RayFan(origin, unit(ahead[None]), 1e6)
        assert touching(fan, centre[None], np.array([radius])).all()
