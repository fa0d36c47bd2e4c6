"""Paths, rotation and falling as functions of time (protocol reference 3.14)."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.simulation.frames import Pose, Vector, wire_from_pose
from usarsim_server.worlds.objects.world_object import GRAVITY, Fall, Path, Spin, motion

HOME: Vector = (0.0, 0.0, 0.0)
SQUARE: tuple[Vector, ...] = ((2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0), HOME)


def path(*points: Vector, time: float = 0.0, **parameters: object) -> Path:
    """A path from the origin."""
    return Path(**parameters).extended(time, HOME, points)  # type: ignore[arg-type]


def test_without_way_points_there_is_no_place() -> None:
    """A path that leads nowhere leaves the object alone, and time does not count."""
    still = Path(speed=3.0)
    assert still.position(5.0) is None
    assert still.travelled(5.0) == 0.0


def test_progress_is_speed_times_time() -> None:
    """The object is as far along as its speed takes it, and stops at the end."""
    there = path((2.0, 0.0, 0.0), (2.0, 1.0, 0.0), speed=0.5)
    assert there.position(0.0) == HOME
    assert there.position(2.0) == (1.0, 0.0, 0.0)
    assert there.position(5.0) == (2.0, 0.5, 0.0)
    assert there.position(100.0) == (2.0, 1.0, 0.0)


def test_a_loop_goes_round_by_the_way_points() -> None:
    """The approach is gone once; then it is first, ..., last, first, for ever."""
    around = path((1.0, 0.0, 0.0), (1.0, 2.0, 0.0), loop=True)
    assert around.position(1.0) == (1.0, 0.0, 0.0)
    assert around.position(3.0) == (1.0, 2.0, 0.0)
    assert around.position(4.0) == pytest.approx((1.0, 1.0, 0.0))
    assert around.position(1.0 + 4.0 * 1000 + 0.5) == pytest.approx((1.0, 0.5, 0.0))


@pytest.mark.parametrize("loop", [False, True])
def test_one_way_point_and_points_in_one_place(loop: bool) -> None:
    """Legs of no length do no harm; the object gets there and stays."""
    for points in ([(1.0, 0.0, 0.0)], [(1.0, 0.0, 0.0)] * 3, [HOME], [HOME, HOME]):
        there = path(*points, loop=loop)
        assert there.position(0.5) in ((0.5, 0.0, 0.0), HOME)
        assert there.position(50.0) == points[-1]


def test_standing_and_going_on() -> None:
    """Moving false stops on the spot, true goes on from there."""
    there = path((4.0, 0.0, 0.0))
    stopped = there.changed(1.0, moving=False)
    assert stopped.position(9.0) == (1.0, 0.0, 0.0)
    again = stopped.changed(9.0, moving=True, speed=2.0)
    assert again.position(10.0) == (3.0, 0.0, 0.0)


def test_the_clock_sets_the_progress() -> None:
    """Time x Speed is the way along the path, from its very start."""
    there = path((10.0, 0.0, 0.0), speed=2.0)
    assert there.changed(1.0, clock=3.0).position(1.0) == (6.0, 0.0, 0.0)
    assert there.changed(1.0, clock=0.0).position(2.0) == (2.0, 0.0, 0.0)
    assert there.changed(1.0, clock=-5.0).position(1.0) == HOME
    assert there.changed(1.0, clock=3.0, speed=1.0).position(1.0) == (3.0, 0.0, 0.0)


def test_a_clock_set_before_the_way_points_counts() -> None:
    """SetWP may come before AddWP."""
    early = Path(speed=2.0).changed(0.0, clock=1.5)
    assert early.extended(4.0, HOME, [(10.0, 0.0, 0.0)]).position(4.0) == (3.0, 0.0, 0.0)


def test_more_way_points_are_appended() -> None:
    """On the way or at the end, the object goes on to them."""
    there = path((1.0, 0.0, 0.0))
    longer = there.extended(0.5, (0.5, 0.0, 0.0), [(1.0, 1.0, 0.0)])
    assert longer.position(1.5) == (1.0, 0.5, 0.0)
    later = there.extended(7.0, (1.0, 0.0, 0.0), [(1.0, 1.0, 0.0)])
    assert later.position(7.5) == (1.0, 0.5, 0.0)


def test_put_elsewhere_it_goes_on_to_its_next_way_point() -> None:
    """A teleport in the middle of a path changes the place, not the errand."""
    around = path(*SQUARE, loop=True)
    moved = around.moved(2.5, (5.0, 1.0, 0.0))
    assert moved.position(2.5) == (5.0, 1.0, 0.0)
    assert moved.position(5.5) == (2.0, 1.0, 0.0)
    assert moved.position(7.5) == pytest.approx((0.0, 1.0, 0.0))
    assert moved.position(8.5) == pytest.approx(HOME)
    ended = path((1.0, 0.0, 0.0)).moved(9.0, (3.0, 3.0, 0.0))
    assert ended.position(99.0) == (3.0, 3.0, 0.0)


def test_clearing_keeps_the_parameters() -> None:
    """Speed and the rest stay; way points and progress are gone."""
    empty = path((1.0, 0.0, 0.0), speed=0.3, loop=True).cleared()
    assert (empty.speed, empty.loop, empty.points, empty.home) == (0.3, True, (), None)
    assert empty.position(3.0) is None


points = st.tuples(*[st.floats(-50.0, 50.0)] * 3)


@given(
    st.lists(points, min_size=1, max_size=6),
    st.booleans(),
    st.floats(0.0, 300.0),
    st.lists(points, min_size=1, max_size=3),
    st.booleans(),
)
@settings(max_examples=200, derandomize=True, deadline=None)
def test_no_change_makes_an_object_jump(
    corners: list[Vector], loop: bool, time: float, more: list[Vector], other: bool
) -> None:
    """At the moment of any change but the clock the object is where it was."""
    there = Path(speed=1.3, loop=loop).extended(0.0, HOME, corners)
    here = there.position(time)
    assert here is not None
    for changed in (
        there.changed(time, loop=other),
        there.changed(time, moving=False),
        there.changed(time, speed=0.0),
        there.extended(time, here, more),
        there.moved(time, here),
    ):
        assert changed.position(time) == pytest.approx(here, abs=1e-6)


@given(st.lists(points, min_size=1, max_size=6), st.booleans(), st.floats(0.0, 1e4))
@settings(max_examples=200, derandomize=True, deadline=None)
def test_an_object_never_goes_faster_than_told(
    corners: list[Vector], loop: bool, time: float
) -> None:
    """Between two moments it covers no more than speed times time, and stays finite."""
    there = Path(speed=2.0, loop=loop).extended(0.0, HOME, corners)
    one, other = there.position(time), there.position(time + 0.01)
    assert one is not None
    assert other is not None
    assert math.dist(one, other) <= 0.02 * (1 + 1e-6) + 1e-9


def test_rotation_about_each_axis() -> None:
    """Rates are in the wire frame: a positive yaw rate turns to the right, seen from above."""
    for axis in range(3):
        rates = tuple(0.5 if n == axis else 0.0 for n in range(3))
        spin = Spin.begin(rates, Pose().quaternion, 2.0)  # type: ignore[arg-type]
        _, angles = wire_from_pose(Pose(HOME, spin.orientation(4.0)))
        assert angles == pytest.approx([1.0 if n == axis else 0.0 for n in range(3)], abs=1e-12)
    ahead = Pose(HOME, Spin((0.0, 0.0, 0.5), HOME, 0.0).orientation(1.0)).rotate((1.0, 0.0, 0.0))
    assert ahead[1] < 0.0, "the right is -y in the simulation frame"


def test_rotation_begins_with_the_orientation_it_finds() -> None:
    """Nothing turns at the moment when the rotation begins."""
    turned = Pose(HOME, (0.5, 0.5, -0.5, 0.5)).quaternion
    begun = Spin.begin((1.0, -2.0, 0.3), turned, 7.0).orientation(7.0)
    assert abs(sum(a * b for a, b in zip(begun, turned, strict=True))) == pytest.approx(1.0)


def test_falling() -> None:
    """It falls as Galileo says, and not farther than there is room."""
    fall = Fall(drop=2.0, since=1.0)
    assert fall.fallen(0.5) == 0.0
    assert fall.fallen(1.4) == pytest.approx(0.5 * GRAVITY * 0.16)
    assert fall.fallen(30.0) == 2.0


def test_motion_puts_them_together() -> None:
    """A path decides the place, falling counts without a path, rotation goes with both."""
    pose = Pose((1.0, 2.0, 3.0))
    fall, spin = Fall(1.0, 0.0), Spin((0.0, 0.0, 1.0), HOME, 0.0)
    assert motion(pose, Path(), None, None, 9.0) == pose
    assert motion(pose, Path(), None, fall, 9.0).position == (1.0, 2.0, 2.0)
    there = path((9.0, 0.0, 0.0))
    both = motion(pose, there, spin, fall, 2.0)
    assert both.position == (2.0, 0.0, 0.0)
    assert wire_from_pose(both)[1][2] == pytest.approx(2.0)
