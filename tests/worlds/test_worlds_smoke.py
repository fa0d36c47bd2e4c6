"""What light meets in smoke, against lengths worked out by hand and by sampling."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import Smoke, SmokePuff, SmokeVolume
from usarsim_server.worlds.smoke import SmokeField, smoke_field

Array = NDArray[np.float64]

ORIGIN = np.zeros(3)
AHEAD = np.array([[1.0, 0.0, 0.0]])
FAR = np.array([100.0])


def volume(
    *place: float,
    shape: str = "box",
    size: tuple[float, float, float] = (2.0, 4.0, 2.0),
    density: float = 0.5,
    yaw: float = 0.0,
) -> SmokeVolume:
    """Smoke with its middle at a place (default: the origin); yaw in degrees."""
    x, y, z = place or (0.0, 0.0, 0.0)
    turn = quaternion_from_rpy(0.0, 0.0, math.radians(yaw))
    return SmokeVolume("smoke", shape, Pose((x, y, z), turn), size, density)


def puff(**changes: Any) -> SmokePuff:
    """A cloud of 40 particles around (5, 0, 0)."""
    return replace(SmokePuff("puff", (5.0, 0.0, 0.0), (1.0, 2.0, 3.0), 40, 0.1, 3), **changes)


def depth(smoke: Smoke, direction: Array = AHEAD, length: float = 100.0) -> float:
    """Optical depth of one ray from the origin."""
    field = SmokeField(smoke)
    return float(field.optical_depth(ORIGIN, direction, np.array([length]))[0])


def unit(*vector: float) -> Array:
    """One direction, (1, 3)."""
    array = np.array([vector])
    return array / np.linalg.norm(array)


# -- along rays ------------------------------------------------------------------------------


def test_clear_air_has_no_field() -> None:
    """Where there is no smoke nobody has anything to compute."""
    assert smoke_field(Smoke()) is None
    assert smoke_field(Smoke(haze=0.1)) is not None
    assert smoke_field(Smoke(volumes=(volume(),))) is not None
    assert smoke_field(Smoke(puffs=(puff(),))) is not None


def test_the_depth_of_a_box_is_density_times_way() -> None:
    """Straight through 2 m of 0.5 per metre: 1.0; from the middle: half of it."""
    assert depth(Smoke((volume(5.0, 0.0, 0.0),))) == pytest.approx(1.0)
    assert depth(Smoke((volume(),))) == pytest.approx(0.5)


def test_an_oblique_way_through_a_box_is_longer() -> None:
    """At 30 degrees to the side 2 m of smoke are 2 / cos 30 degrees, and a miss is a miss."""
    slanting = unit(math.cos(math.radians(30)), math.sin(math.radians(30)), 0.0)
    wide = volume(5.0, 0.0, 0.0, size=(2.0, 40.0, 2.0))
    assert depth(Smoke((wide,)), slanting) == pytest.approx(1.0 / math.cos(math.radians(30)))
    assert depth(Smoke((volume(5.0, 0.0, 0.0),)), unit(1.0, 1.0, 0.0)) == 0.0
    assert depth(Smoke((wide,)), -AHEAD) == 0.0


def test_a_turned_box() -> None:
    """By 45 degrees a square of 2 m shows its diagonal."""
    turned = volume(5.0, 0.0, 0.0, size=(2.0, 2.0, 2.0), yaw=45.0)
    assert depth(Smoke((turned,))) == pytest.approx(0.5 * 2.0 * math.sqrt(2.0))


def test_an_ellipsoid() -> None:
    """Along an axis: its full extent; beside it: the chord of the ellipse."""
    ball = volume(5.0, 0.0, 0.0, shape="ellipsoid", size=(2.0, 4.0, 6.0), density=1.0)
    field = SmokeField(Smoke((ball,)))
    starts = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.5], [0.0, 2.1, 0.0]])
    ways = np.repeat(AHEAD, 4, axis=0)
    found = field.optical_depth(starts, ways, np.full(4, 100.0))
    chord = 2.0 * math.sqrt(1.0 - 0.25)
    assert found == pytest.approx([2.0, chord, chord, 0.0])


def test_a_ray_ends_where_it_hits() -> None:
    """Smoke behind the target does not count, and half of it counts if the target is inside."""
    smoke = Smoke((volume(5.0, 0.0, 0.0),))
    assert depth(smoke, length=3.9) == 0.0
    assert depth(smoke, length=5.0) == pytest.approx(0.5)


def test_overlapping_smoke_adds_up() -> None:
    """Two boxes and the haze over one way: the sum of the three."""
    smoke = Smoke((volume(5.0, 0.0, 0.0), volume(6.0, 0.0, 0.0, density=0.25)), haze=0.01)
    assert depth(smoke, length=10.0) == pytest.approx(1.0 + 0.5 + 0.1)


@pytest.mark.parametrize(
    ("direction", "metres"),
    [((1, 0, 0), 10.0), ((0, 0, -1), 10.0), ((0, 0, 1), 2.0), ((1, 0, 1), 2.0 * math.sqrt(2.0))],
)
def test_haze_lies_below_its_top(direction: tuple[float, ...], metres: float) -> None:
    """From 2 m below the top: level and downward rays stay in it, others leave it."""
    smoke = Smoke(haze=0.3, haze_top=2.0)
    assert depth(smoke, unit(*direction), 10.0) == pytest.approx(0.3 * metres)


@pytest.mark.parametrize(
    ("direction", "metres"), [((1, 0, 0), 0.0), ((0, 0, 1), 0.0), ((0, 0, -1), 8.0)]
)
def test_above_the_haze(direction: tuple[float, ...], metres: float) -> None:
    """From 2 m above it only rays that look down get into it."""
    smoke = Smoke(haze=0.3, haze_top=-2.0)
    assert depth(smoke, unit(*direction), 10.0) == pytest.approx(0.3 * metres)


directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: math.hypot(*v) > 0.1)
places = st.tuples(*[st.floats(-6.0, 6.0)] * 3)
volumes = st.builds(
    lambda place, shape, size, density, yaw: volume(
        *place, shape=shape, size=size, density=density, yaw=yaw
    ),
    places,
    st.sampled_from(["box", "ellipsoid"]),
    st.tuples(*[st.floats(0.5, 8.0)] * 3),
    st.floats(0.01, 2.0),
    st.floats(-180.0, 180.0),
)


def inside(smoke: Smoke, points: Array) -> Array:
    """Density at points (n, 3), one volume after the other."""
    total = np.where(points[:, 2] < smoke.haze_top, smoke.haze, 0.0)
    for part in smoke.volumes:
        back = part.pose.inverse()
        own = np.array([back @ Pose(tuple(p)) for p in points.tolist()], dtype=object)
        local = np.array([pose.position for pose in own]) / (np.array(part.size) / 2.0)
        reach = np.abs(local).max(axis=1) if part.shape == "box" else (local**2).sum(axis=1)
        total = total + np.where(reach < 1.0, part.density, 0.0)
    return total


@given(st.lists(volumes, max_size=3), directions, st.floats(0.5, 12.0), st.floats(0.0, 0.5))
def test_depth_is_the_integral_of_the_density(
    parts: list[SmokeVolume], direction: tuple[float, ...], length: float, haze: float
) -> None:
    """For any volumes: what sampling the density along the ray gives, to the width of a sample."""
    smoke = Smoke(tuple(parts), haze=haze, haze_top=1.0)
    way = unit(*direction)
    count = 400
    samples = (np.arange(count) + 0.5) / count * length
    expected = inside(smoke, samples[:, None] * way).sum() * length / count
    jumps = sum(2.0 * part.density for part in parts) + haze
    assert depth(smoke, way, length) == pytest.approx(expected, abs=jumps * length / count + 1e-9)


@given(
    st.lists(volumes, min_size=1, max_size=3),
    directions,
    st.floats(0.001, 0.999),
    st.floats(0, 0.5),
)
def test_the_distance_at_a_depth_has_that_depth_behind_it(
    parts: list[SmokeVolume], direction: tuple[float, ...], share: float, haze: float
) -> None:
    """distance_at is the inverse of optical_depth; a depth that is not there is infinitely far."""
    field = SmokeField(Smoke(tuple(parts), haze=haze))
    way, length = unit(*direction), np.array([10.0])
    total = field.optical_depth(ORIGIN, way, length)
    if total[0] > 1e-6:
        distance = field.distance_at(ORIGIN, way, length, share * total)
        assert 0.0 <= distance[0] <= 10.0
        again = field.optical_depth(ORIGIN, way, distance)
        assert again == pytest.approx(share * total, rel=1e-6, abs=1e-9)
    assert field.distance_at(ORIGIN, way, length, total * 1.001 + 1e-9)[0] == math.inf


# -- particles -------------------------------------------------------------------------------


def test_a_particle_stops_a_ray_at_its_near_side() -> None:
    """One particle of 0.1 m straight ahead at 5 m: 4.9 m; a ray 0.11 m beside it passes."""
    cloud = puff(particles=1, size=(1e-9, 1e-9, 1e-9))
    field = SmokeField(Smoke(puffs=(cloud,)))
    starts = np.array([[0.0, 0.0, 0.0], [0.0, 0.06, 0.0], [0.0, 0.11, 0.0], [6.0, 0.0, 0.0]])
    found = field.blocked_at(starts, np.repeat(AHEAD, 4, axis=0), 0.0)
    assert found == pytest.approx([4.9, 5.0 - 0.08, math.inf, math.inf])


def test_inside_a_particle_nothing_gets_out() -> None:
    """From inside the distance is 0, whatever the direction."""
    cloud = puff(position=(0.02, 0.0, 0.0), particles=1, size=(1e-9, 1e-9, 1e-9))
    field = SmokeField(Smoke(puffs=(cloud,)))
    assert field.blocked_at(ORIGIN, np.vstack((AHEAD, -AHEAD)), 0.0).tolist() == [0.0, 0.0]


def test_the_nearest_of_all_particles_counts() -> None:
    """Against a plain loop over particles and rays."""
    field = SmokeField(Smoke(puffs=(puff(), puff(position=(3.0, 1.0, 0.0), seed=4))))
    centres, radii = field.particles(0.0)
    assert len(centres) == len(radii) == 80
    angles = np.linspace(-0.6, 0.6, 50)
    ways = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(50)))
    expected = []
    for way in ways:
        nearest = math.inf
        for centre, radius in zip(centres, radii, strict=True):
            along = float(way @ centre)
            gap = float(centre @ centre) - along**2
            if gap <= radius**2 and along > 0.0:
                nearest = min(nearest, along - math.sqrt(radius**2 - gap))
        expected.append(nearest)
    assert field.blocked_at(ORIGIN, ways, 0.0) == pytest.approx(expected)
    assert 5 < np.isfinite(expected).sum() < 45


def test_particles_fill_their_cloud_and_stay_in_it() -> None:
    """2000 particles: all within the ellipsoid, an eighth of them within half its size."""
    centres, _ = SmokeField(Smoke(puffs=(puff(particles=2000),))).particles(0.0)
    reach = (((centres - [5.0, 0.0, 0.0]) / [0.5, 1.0, 1.5]) ** 2).sum(axis=1)
    assert reach.max() <= 1.0
    assert (reach < 0.25).mean() == pytest.approx(0.125, abs=0.03)


def test_places_follow_from_the_seed() -> None:
    """The same seed gives the same cloud, another seed another one; still smoke stands still."""
    one, same, other = (
        SmokeField(Smoke(puffs=(puff(seed=seed),))).particles(0.0)[0] for seed in (3, 3, 4)
    )
    assert (one == same).all()
    assert not np.allclose(one, other)
    assert (SmokeField(Smoke(puffs=(puff(),))).particles(77.0)[0] == one).all()


def test_particles_of_a_plume_rise() -> None:
    """Living 10 s in a plume of 3 m they climb 0.3 m/s, and none is ever outside of it."""
    field = SmokeField(Smoke(puffs=(puff(particles=200, lifetime=10.0),)))
    before, after = field.particles(12.0)[0], field.particles(12.5)[0]
    climb = after[:, 2] - before[:, 2]
    started_again = climb < 0.0
    assert climb[~started_again] == pytest.approx(0.15, abs=1e-9)
    assert started_again.sum() == 10
    for time in (0.0, 3.3, 12.5, 1e4):
        places = (field.particles(time)[0] - [5.0, 0.0, 0.0]) / [0.5, 1.0, 1.5]
        assert np.abs(places).max() <= 1.0 + 1e-9
        assert (places[:, 0] ** 2 + places[:, 1] ** 2).max() <= 1.0 + 1e-9


def test_a_plume_depends_on_time_alone() -> None:
    """Asking twice, or in another order, gives the same; another time gives another plume."""
    field = SmokeField(Smoke(puffs=(puff(lifetime=10.0),)))
    first = field.particles(4.0)[0]
    field.particles(9.0)
    assert (field.particles(4.0)[0] == first).all()
    assert not np.allclose(field.particles(14.0)[0], first)


def test_particles_do_not_weaken_what_passes_them() -> None:
    """A puff has no optical depth of its own."""
    assert depth(Smoke(puffs=(puff(),))) == 0.0


def test_one_start_point_or_one_for_each_ray() -> None:
    """A common start (3,) gives what the same start repeated (n, 3) gives."""
    smoke = Smoke((volume(5.0, 0.0, 0.0),), (puff(lifetime=5.0),), haze=0.1)
    field = SmokeField(smoke)
    ways = np.vstack([unit(1.0, y, 0.1) for y in (-0.2, 0.0, 0.1, 0.3)])
    start = np.array([0.5, -0.1, 0.0])
    many, lengths = np.repeat(start[None], 4, axis=0), np.full(4, 9.0)
    assert (
        field.optical_depth(start, ways, lengths) == field.optical_depth(many, ways, lengths)
    ).all()
    assert (field.blocked_at(start, ways, 1.0) == field.blocked_at(many, ways, 1.0)).all()
    depths = np.full(4, 0.4)
    one = field.distance_at(start, ways, lengths, depths)
    assert (one == field.distance_at(many, ways, lengths, depths)).all()


def test_rays_along_the_faces_of_a_box_do_not_upset_it() -> None:
    """Exactly on a face or parallel to it the answer is a number between nothing and all."""
    field = SmokeField(Smoke((volume(5.0, 2.0, 0.0),)))
    found = field.optical_depth(ORIGIN, AHEAD, FAR)
    assert np.isfinite(found).all()
    assert 0.0 <= found[0] <= 1.0
