"""Which rays pass through spheres, against the nearest of many points along each ray."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from usarsim_server.simulation.rays import culling
from usarsim_server.simulation.rays.culling import Spheres, meetings
from usarsim_server.simulation.rays.query import RayFan, join

Array = NDArray[np.float64]
NOBODY = -1


def unit(vectors: Array) -> Array:
    """Vectors (n, 3) of length one."""
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def nearest(origins: Array, directions: Array, reach: float, centres: Array) -> Array:
    """Distances (n, t) of centres from rays, by looking for the least along each ray."""
    gaps = np.full((len(directions), len(centres)), np.inf)
    for way in np.linspace(0.0, reach, 2401):
        points = origins + way * directions
        gaps = np.minimum(gaps, np.linalg.norm(centres[None] - points[:, None], axis=2))
    return gaps


def touched(fans: list[RayFan], centres: Array, radii: Array, own: int = NOBODY) -> Array:
    """Which rays (n, t) of fans may meet which spheres."""
    batch = join(fans)
    owners = np.full(len(fans), own, dtype=np.intp)
    rays, found = meetings(batch, batch.ranges, Spheres(centres, radii), owners)
    answer = np.zeros((len(batch.directions), len(centres)), dtype=bool)
    answer[rays, found] = True
    assert answer.sum() == len(rays), "no pair comes twice"
    return answer


class TestMeetings:
    @pytest.mark.parametrize("apart", [False, True])
    @pytest.mark.parametrize("size", [5, 60])
    @pytest.mark.parametrize("seed", range(3))
    def test_are_where_a_ray_comes_nearer_than_a_radius(
        self, seed: int, size: int, apart: bool
    ) -> None:
        """In small and large fans, with one start or one for each ray, exactly those are found;
        but near the end of a ray, where a sphere ahead of it may be among them."""
        dice = np.random.default_rng(seed)
        centres, radii = dice.uniform(-3.0, 3.0, (8, 3)), dice.uniform(0.3, 1.2, 8)
        fans, expected, sure = [], [], []
        for reach in (12.0, 1.0, 12.0):
            directions = unit(dice.normal(size=(size, 3)))
            origins = dice.uniform(-2.0, 2.0, (size, 3) if apart else 3)
            fans.append(RayFan(origins, directions, reach))
            gaps = nearest(np.broadcast_to(origins, (size, 3)), directions, reach, centres)
            further = nearest(np.broadcast_to(origins, (size, 3)), directions, reach + 2.5, centres)
            expected.append(gaps <= radii)
            sure.append((np.abs(gaps - radii) > 0.005) & ((gaps <= radii) == (further <= radii)))
        found = touched(fans, centres, radii)
        checked = np.concatenate(sure)
        np.testing.assert_array_equal(found[checked], np.concatenate(expected)[checked])
        assert 0.01 < np.concatenate(expected).mean() < 0.9

    def test_a_ray_that_begins_inside_counts_whatever_its_direction(self) -> None:
        """Whoever stands in a sphere may meet what is in it on any way."""
        for count in (20, 50):
            directions = unit(np.random.default_rng(1).normal(size=(count, 3)))
            fan = RayFan(np.array([0.3, 0.0, 0.0]), directions, 1.0)
            assert touched([fan], np.zeros((1, 3)), np.array([0.5])).all()

    def test_what_lies_behind_or_beyond_does_not_count(self) -> None:
        """A ray is no line: it has a beginning and an end."""
        fan = RayFan(np.zeros(3), np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]), 10.0)
        found = touched([fan], np.array([[3.0, 0.0, 0.0], [12.0, 0.0, 0.0]]), np.ones(2))
        assert found.tolist() == [[True, False], [False, False]]

    def test_spheres_without_end(self) -> None:
        """What may be anywhere is in the way of every ray."""
        fan = RayFan(np.zeros((2, 3)), unit(np.array([[1.0, 0, 0], [0, 1.0, 0]])), 10.0)
        assert touched([fan], np.array([[5.0, 5.0, 5.0]]), np.array([np.inf])).all()

    def test_nothing_there(self) -> None:
        """Without spheres no ray touches any."""
        fan = RayFan(np.zeros(3), np.array([[1.0, 0.0, 0.0]]), 10.0)
        assert touched([fan], np.zeros((0, 3)), np.zeros(0)).size == 0

    @pytest.mark.parametrize("size", [1, 40])
    def test_nobody_meets_himself(self, size: int) -> None:
        """The sphere that a fan belongs to is left out, the others stay."""
        fan = RayFan(np.zeros(3), np.tile([[1.0, 0.0, 0.0]], (size, 1)), 10.0)
        centres = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
        assert touched([fan], centres, np.ones(2), own=0).tolist() == [[False, True]] * size

    @pytest.mark.parametrize("limit", [1, 7, 100])
    def test_the_size_of_the_portions_does_not_matter(
        self, limit: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Looked at in large or small portions, the same pairs are found."""
        dice = np.random.default_rng(5)
        fans = [
            RayFan(dice.normal(size=3), unit(dice.normal(size=(size, 3))), 5.0)
            for size in (3, 40, 12, 70, 1)
        ]
        centres, radii = dice.uniform(-3.0, 3.0, (9, 3)), np.full(9, 0.7)
        whole = touched(fans, centres, radii)
        monkeypatch.setattr(culling, "PAIRS_AT_ONCE", limit)
        np.testing.assert_array_equal(touched(fans, centres, radii), whole)

    @given(
        seed=st.integers(0, 10_000),
        away=st.floats(0.0, 1e5),
        radius=st.floats(0.05, 3.0),
        share=st.floats(0.0, 1.0),
        size=st.sampled_from([1, 40]),
    )
    def test_no_ray_through_a_point_of_a_sphere_is_lost(
        self, seed: int, away: float, radius: float, share: float, size: int
    ) -> None:
        """Not even one that grazes a sphere far away."""
        dice = np.random.default_rng(seed)
        ahead, side = unit(dice.normal(size=(2, 3)))
        side = unit(np.cross(ahead, side)[None])[0]
        centre = dice.uniform(-50.0, 50.0, 3)
        origin = centre + share * radius * side - away * ahead
        fan = RayFan(origin, np.tile(unit(ahead[None]), (size, 1)), 1e6)
        assert touched([fan], centre[None], np.array([radius])).all()
