"""Smoke and headlights against their formulas."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from camera_fakes import darken, scenery
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.cameras.looks import BEAM_REACH, Air, brightness, reaching, shine
from usarsim_server.cameras.view import Eye, looking
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import Smoke, SmokePuff, SmokeVolume
from usarsim_server.worlds.smoke import SmokeField

EYE = Eye(looking((0.0, 0.0, 1.0), (5.0, 1.0, 0.5)), 1.2, 40, 30)

coordinate = st.floats(-6.0, 6.0)
place = st.tuples(coordinate, coordinate, st.floats(-1.0, 3.0))
edge = st.floats(0.3, 6.0)
volumes = st.builds(
    SmokeVolume,
    name=st.just("v"),
    shape=st.sampled_from(["box", "ellipsoid"]),
    pose=st.builds(
        Pose, place, st.floats(-3.0, 3.0).map(lambda yaw: quaternion_from_rpy(0.0, 0.0, yaw))
    ),
    size=st.tuples(edge, edge, edge),
    density=st.floats(0.01, 2.0),
)


@given(
    st.lists(volumes, max_size=3),
    st.floats(0.0, 0.3),
    st.one_of(st.just(math.inf), st.floats(-1.0, 3.0)),
    place,
    st.floats(0.5, 20.0),
)
def test_thickness_is_that_of_the_sensors_smoke(
    some: list[SmokeVolume],
    haze: float,
    top: float,
    position: tuple[float, float, float],
    far: float,
) -> None:
    """Pictures and lasers meet the same smoke: optical depths agree for any volumes and eyes."""
    smoke = Smoke(tuple(some), haze=haze, haze_top=top)
    target = (position[0] + 1.0, position[1] + 0.4, position[2] - 0.2)
    eye = Eye(looking(position, target), 1.2, 12, 9)
    rays = eye.rays()
    lengths = rays.lengths()
    depth = np.full((9, 12), far, np.float32)
    directions = rays.directions(eye.pose.matrix()) / lengths[..., None]
    expected = SmokeField(smoke).optical_depth(
        np.array(position),
        directions.reshape(-1, 3).astype(float),
        (depth * lengths).reshape(-1).astype(float),
    )
    got = Air(smoke).thickness(depth, eye, 0.0).reshape(-1)
    assert got == pytest.approx(expected, abs=0.01 + 0.001 * expected.max())


def test_the_sky_is_hazy_to_a_limit() -> None:
    """Behind the last thing there is air, but not infinitely much."""
    sky = np.full((30, 40), np.inf, np.float32)
    thickness = Air(Smoke(haze=0.01)).thickness(sky, EYE, 0.0)
    assert np.isfinite(thickness).all()
    assert thickness.min() > 1.0


class TestParticles:
    """Local smoke."""

    PUFF = SmokePuff("fire", (4.0, 0.8, 0.6), (0.8, 0.8, 0.8), 60, 0.128, seed=1, lifetime=5.0)

    def test_a_cloud_hides_what_is_behind_it(self) -> None:
        """In the middle of a dense cloud nearly no light comes through, beside it all."""
        air = Air(Smoke(puffs=(self.PUFF,)))
        thickness = air.thickness(np.full((30, 40), 20.0, np.float32), EYE, 2.0)
        assert thickness.max() > 3.0
        assert (thickness == 0.0).mean() > 0.5
        before = air.thickness(np.full((30, 40), 2.0, np.float32), EYE, 2.0)
        assert not before.any()

    def test_particles_are_where_lasers_meet_them(self) -> None:
        """A ray through the middle of a particle is dimmed, a ray that misses all is not."""
        field = SmokeField(Smoke(puffs=(self.PUFF,)))
        air = Air(Smoke(puffs=(self.PUFF,)))
        eye = Eye(EYE.pose, 1.2, 120, 90)
        rays = eye.rays()
        lengths = rays.lengths()
        directions = (rays.directions(eye.pose.matrix()) / lengths[..., None]).reshape(-1, 3)
        blocked = field.blocked_at(np.array(eye.pose.position), directions.astype(float), 2.0)
        thick = air.thickness(np.full((90, 120), 20.0, np.float32), eye, 2.0).reshape(-1)
        missed = np.isinf(blocked)
        # Spheres off the axis are drawn as circles, not as ellipses: a few pixels at rims differ.
        assert (thick[missed] > 0.3).mean() < 0.01
        assert (thick[~missed] > 0.0).mean() > 0.95

    def test_they_rise(self) -> None:
        """Pictures at different simulated times differ, at equal times they do not."""
        air = Air(Smoke(puffs=(self.PUFF,)))
        depth = np.full((30, 40), 20.0, np.float32)
        one, again, other = (air.thickness(depth, EYE, time) for time in (1.0, 1.0, 2.0))
        assert np.array_equal(one, again)
        assert (one != other).any()

    def test_close_ones_and_ones_behind(self) -> None:
        """Particles around the eye neither crash nor cover what is clear."""
        around = SmokePuff("p", (0.0, 0.0, 1.0), (3.0, 3.0, 3.0), 400, 0.2, seed=3)
        thickness = Air(Smoke(puffs=(around,))).thickness(
            np.full((30, 40), 20.0, np.float32), EYE, 0.0
        )
        assert np.isfinite(thickness).all()
        assert (thickness >= 0.0).all()


class TestShine:
    """Headlights."""

    WALL = np.full((61, 81), 4.0, np.float32)
    AHEAD = Eye(Pose((0.0, 0.0, 1.0)), 1.2, 81, 61)
    WHITE = np.full((61, 81, 3), 255, np.uint8)
    DARK = np.zeros((61, 81, 3), np.uint8)

    def light(self, lamp: Pose) -> np.ndarray[tuple[int, ...], np.dtype[np.int_]]:
        """Brightness of a white wall 4 m ahead."""
        lit = shine(self.DARK, self.WHITE, self.WALL, self.AHEAD, (lamp,))
        return lit[..., 0].astype(int)

    def test_brightest_ahead_and_dark_outside(self) -> None:
        """The spot is round the axis of the lamp and falls off to nothing."""
        spot = self.light(self.AHEAD.pose)
        assert spot[30, 40] == spot.max() > 50
        assert spot[30, 0] < spot[30, 20] < spot[30, 40]
        assert spot[30].tolist() == pytest.approx(spot[30, ::-1].tolist(), abs=1)

    def test_distance_dims(self) -> None:
        """From farther behind the same wall gets less light."""
        near, far = (self.light(Pose((x, 0.0, 1.0)))[30, 40] for x in (0.0, -8.0))
        assert 0 < far < 0.5 * near

    def test_the_angle_counts(self) -> None:
        """A lamp that shines along the wall brightens it less than one that shines onto it."""
        aslant = looking((3.0, 2.5, 1.0), (4.0, 0.0, 1.0))
        onto = looking((1.3, 0.0, 1.0), (4.0, 0.0, 1.0))
        assert self.light(aslant)[30, 40] < 0.7 * self.light(onto)[30, 40]

    def test_light_does_not_go_through_the_wall(self) -> None:
        """A lamp behind the surface does not lighten its front."""
        behind = looking((8.0, 0.0, 1.0), (4.0, 0.0, 1.0))
        assert not self.light(behind).any()

    def test_black_stays_black_and_the_sky_too(self) -> None:
        """Light shows surfaces by their own colour, and nothing where there is nothing."""
        lamps = (self.AHEAD.pose,)
        assert not shine(self.DARK, self.DARK, self.WALL, self.AHEAD, lamps).any()
        nothing = np.full_like(self.WALL, np.inf)
        assert not shine(self.DARK, self.WHITE, nothing, self.AHEAD, lamps).any()

    def test_lamps_far_behind_are_left_out(self) -> None:
        """What cannot be seen costs nothing."""
        lamps = [Pose((x, 0.0, 1.0)) for x in (-BEAM_REACH - 1.0, -1.0, 10.0)]
        assert reaching(lamps, self.AHEAD) == tuple(lamps[1:])


def test_brightness_follows_the_lights() -> None:
    """Smoke is dark in a dark world, bright in a bright one, never more than white."""
    spec = scenery()
    day = brightness(spec.compile())
    darken(spec)
    assert brightness(spec.compile()) == 0.0
    assert 0.4 < day < 0.8
    for _ in range(5):
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, diffuse=(1.0, 1.0, 1.0)
        )
    assert brightness(spec.compile()) == 1.0
