"""Doors and lifts: courses, whom they serve, how they close, what they do not crush."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_stage import Stage

from usarsim_server.worlds.machinery.courses import Course

places = st.floats(-20.0, 20.0)
limits = st.floats(0.05, 5.0)


@given(places, places, limits, limits)
def test_a_course_from_rest_arrives_within_its_limits(
    start: float, target: float, speed: float, acceleration: float
) -> None:
    """It begins where it is, ends at the target at rest, and is never faster than it may be."""
    course = Course(3.0, start, 0.0, target, speed, acceleration)
    assert course.at(3.0) == (start, 0.0)
    place, velocity = course.at(course.end + 1e-6)
    assert place == pytest.approx(target, abs=1e-6)
    assert velocity == pytest.approx(0.0, abs=1e-6)
    for share in range(11):
        now, moving = course.at(3.0 + (course.end - 3.0) * share / 10.0)
        assert abs(moving) <= speed + 1e-9
        assert min(start, target) - 1e-9 <= now <= max(start, target) + 1e-9


@given(places, places, places, limits, limits, st.floats(0.0, 1.0))
def test_redirecting_makes_no_jump(
    start: float, first: float, second: float, speed: float, acceleration: float, share: float
) -> None:
    """Place and velocity go on as they were at the moment of the change of mind."""
    course = Course(0.0, start, 0.0, first, speed, acceleration)
    moment = course.end * share
    other = course.redirected(moment, second)
    assert other.at(moment) == course.at(moment)
    assert other.at(other.end + 1e-6)[0] == pytest.approx(second, abs=1e-6)
    before = course.at(moment)
    after = other.at(moment + 1e-4)
    assert abs(after[1] - before[1]) <= acceleration * 1e-4 + 1e-9
    assert abs(after[0] - before[0]) <= (speed + acceleration * 1e-4) * 1e-4 + 1e-9


@given(places, places, limits, limits, st.floats(0.0, 1.0))
def test_stopping_takes_the_braking_distance(
    start: float, target: float, speed: float, acceleration: float, share: float
) -> None:
    """Told to stop, it comes to rest v^2 / 2a further on, after v / a."""
    course = Course(0.0, start, 0.0, target, speed, acceleration)
    moment = course.end * share
    place, velocity = course.at(moment)
    stopped = course.redirected(moment, None)
    assert stopped.end - moment == pytest.approx(abs(velocity) / acceleration, abs=1e-6)
    way = abs(stopped.at(stopped.end + 1.0)[0] - place)
    assert way == pytest.approx(velocity**2 / (2.0 * acceleration), abs=1e-6)


def test_the_textbook_example() -> None:
    """10 m at 2 m/s with 1 m/s^2: 2 s up, 3 s even, 2 s down."""
    course = Course(0.0, 0.0, 0.0, 10.0, 2.0, 1.0)
    assert course.end == pytest.approx(7.0)
    assert course.at(2.0) == pytest.approx((2.0, 2.0))
    assert course.at(5.0) == pytest.approx((8.0, 2.0))
    assert course.at(6.0) == pytest.approx((9.5, 1.0))


def test_too_fast_to_stop_in_time() -> None:
    """At 2 m/s, 1 m before the target and with 1 m/s^2, it overshoots by 1 m and returns."""
    course = Course(0.0, 0.0, 2.0, 1.0, 2.0, 1.0)
    assert course.at(2.0) == pytest.approx((2.0, 0.0))
    assert course.at(course.end) == pytest.approx((1.0, 0.0), abs=1e-9)


SLIDING = '[[door]]\nname = "gate"\nkind = "sliding"\nposition = [0.0, 0.0, 0.0]\n'
HINGED = '[[door]]\nname = "flap"\nkind = "hinged"\nposition = [0.0, 0.0, 0.0]\n'
CART = (
    '[[obstacle]]\nname = "cart"\nsize = [0.4, 0.4, 0.4]\nway = "once"\n'
    "points = [[-6.0, 0.0, 0.0], [6.0, 0.0, 0.0]]\nspeed = 1.0\n"
)


class TestApproach:
    """Doors that open for whoever comes."""

    def test_it_opens_in_time_and_closes_behind(self, tmp_path: Path) -> None:
        """A cart that goes by itself at 1 m/s gets through; 2 s after it has gone it is shut."""
        stage = Stage(tmp_path, SLIDING + CART)
        stage.run(3.0)
        assert stage.place("gate")[1] == 0.0
        stage.run(2.7)  # the cart is 0.3 m before the door
        assert stage.place("gate")[1] == pytest.approx(1.0, abs=0.1)
        stage.run(0.6)
        assert stage.place("gate")[1] == pytest.approx(1.0)
        stage.run(2.0)  # 2.1 m behind the middle: it has left at 8.2 s
        assert stage.place("gate")[1] == pytest.approx(1.0)
        stage.run(4.0)
        assert stage.place("gate")[1] == pytest.approx(0.0)

    def test_it_keeps_its_speed(self, tmp_path: Path) -> None:
        """The leaf goes at 0.7 m/s, and takes the time that 1.5 m/s^2 asks for."""
        stage = Stage(tmp_path, SLIDING + CART)
        stage.run(3.8)
        places = []
        for _ in range(150):
            stage.run(0.02)
            places.append(float(stage.place("gate")[1]))
        fastest = max(b - a for a, b in itertools.pairwise(places)) / 0.02
        assert fastest == pytest.approx(0.7, abs=0.01)
        moving = sum(0.001 < place < 0.999 for place in places) * 0.02
        assert moving == pytest.approx(1.0 / 0.7 + 0.7 / 1.5, abs=0.1)

    def test_two_leaves_slide_apart(self, tmp_path: Path) -> None:
        """Of two leaves each goes to its own side by its own width."""
        stage = Stage(tmp_path, SLIDING + "leaves = 2\nwidth = 1.6\n" + CART)
        left, right = stage.place("gate_left")[1], stage.place("gate_right")[1]
        stage.run(5.9)
        assert stage.place("gate_left")[1] - left == pytest.approx(0.8)
        assert stage.place("gate_right")[1] - right == pytest.approx(-0.8)

    @pytest.mark.parametrize(("angle", "side"), [(90.0, "left"), (90.0, "right"), (-80.0, "left")])
    def test_hinged_leaves_turn_to_their_side(
        self, tmp_path: Path, angle: float, side: str
    ) -> None:
        """The free edge swings toward x for a positive angle, wherever the hinge is."""
        sheet = HINGED + f'angle_degrees = {angle}\nside = "{side}"\n'
        stage = Stage(tmp_path, sheet + CART.replace("6.0, 0.0, 0.0]]", "-1.6, 0.0, 0.0]]"))
        stage.run(7.0)
        sign = 1.0 if side == "left" else -1.0
        assert stage.yaw("flap") == pytest.approx(math.radians(angle) * sign, abs=1e-6)
        assert stage.place("flap")[1] == pytest.approx(0.5 * sign)

    def test_a_crate_opens_nothing(self, tmp_path: Path) -> None:
        """What only lies about is nobody who comes."""
        stage = Stage(tmp_path, SLIDING, (0.6, 0.0, 0.15))
        stage.run(2.0)
        assert stage.place("gate")[1] == 0.0

    def test_a_turned_door_looks_where_it_stands(self, tmp_path: Path) -> None:
        """A door across another way opens only for those who go that way."""
        turned = SLIDING.replace("[0.0, 0.0", "[0.0, 8.0") + "yaw_degrees = 90.0\n"
        stage = Stage(tmp_path, turned + CART)
        stage.run(7.0)
        assert stage.place("gate").tolist() == pytest.approx([0.0, 8.0, 0.0])
        along = Stage(tmp_path, turned + CART.replace("[6.0, 0.0", "[0.0, 6.7"))
        along.run(10.0)
        assert along.place("gate").tolist() == pytest.approx([-1.0, 8.0, 0.0])


class TestMercy:
    """Doors crush nobody."""

    TIMED = SLIDING + 'opens = "timetable"\nduration = 2.0\nhold = 1.0\n'

    def test_a_sliding_door_waits_for_what_is_between(self, tmp_path: Path) -> None:
        """It stays open as long as a crate is in the doorway, which is not touched."""
        stage = Stage(tmp_path, self.TIMED, (0.0, 0.2, 0.15))
        stage.put("crate0", (3.0, 0.0, 0.15))
        stage.run(1.9)
        stage.put("crate0", (0.0, 0.2, 0.15))
        stage.run(4.0)
        assert stage.place("gate")[1] == pytest.approx(1.0)
        assert stage.place("crate0")[:2] == pytest.approx([0.0, 0.2], abs=1e-3)
        stage.put("crate0", (3.0, 0.0, 0.15))
        stage.run(4.0)
        assert stage.place("gate")[1] == pytest.approx(0.0)

    def test_it_opens_again_for_who_comes_late(self, tmp_path: Path) -> None:
        """Something that gets between while it closes makes it open again."""
        stage = Stage(tmp_path, self.TIMED, (3.0, 0.0, 0.15))
        stage.run(2.6)
        closing = stage.place("gate")[1]
        assert 0.5 < closing < 0.95
        stage.put("crate0", (0.0, -0.3, 0.15))
        stage.run(2.0)
        assert stage.place("gate")[1] == pytest.approx(1.0)
        assert stage.place("crate0")[1] == pytest.approx(-0.3, abs=1e-3)

    def test_a_hinged_leaf_stops_before_what_it_would_hit(self, tmp_path: Path) -> None:
        """A crate in the swing is not touched; when it is gone the leaf goes on."""
        sheet = HINGED + 'opens = "timetable"\nduration = 60.0\n'
        stage = Stage(tmp_path, sheet, (0.45, 0.1, 0.15))
        stage.run(4.0)
        assert 0.0 < stage.yaw("flap") < math.radians(40.0)
        assert stage.place("crate0")[:2] == pytest.approx([0.45, 0.1], abs=1e-3)
        stage.put("crate0", (3.0, 0.0, 0.15))
        stage.run(3.0)
        assert stage.yaw("flap") == pytest.approx(math.radians(90.0))


class TestTimetable:
    """Doors that open by the clock."""

    def test_it_opens_again_and_again(self, tmp_path: Path) -> None:
        """Open from 1 s for 2 s, every 6 s; nobody needs to come."""
        times = 'opens = "timetable"\ndelay = 1.0\nduration = 2.0\nperiod = 6.0\n'
        stage = Stage(tmp_path, SLIDING + times)
        seen = []
        for _ in range(14):
            stage.run(1.0)
            seen.append(bool(stage.place("gate")[1] > 0.2))
        # It takes about 1.9 s to shut.
        assert seen == [n % 6 in (1, 2, 3) for n in range(14)]


class TestPush:
    """Doors that are pushed open."""

    def test_it_gives_way_and_shuts(self, tmp_path: Path) -> None:
        """A cart pushes it open to where the cart leaves it; then it falls shut, and stays."""
        push = 'opens = "push"\nboth_ways = true\n'
        stage = Stage(tmp_path, HINGED + push + CART)
        stage.run(4.0)
        assert abs(stage.yaw("flap")) < 1e-3
        stage.run(2.4)
        assert stage.yaw("flap") > math.radians(40.0)
        stage.run(8.0)
        assert abs(stage.yaw("flap")) < math.radians(5.0)

    def test_it_does_not_fall_asleep_open(self, tmp_path: Path) -> None:
        """Held open against its stop for long, it still falls shut when it is let go."""
        way = CART.replace("[6.0, 0.0", "[0.3, 0.0").replace('"once"', '"back and forth"')
        sheet = HINGED + 'opens = "push"\nangle_degrees = 45.0\n' + way + "pause = 6.0\n"
        stage = Stage(tmp_path, sheet.replace("[0.4, 0.4, 0.4]", "[0.4, 0.9, 0.4]"))
        stage.run(11.0)
        assert stage.yaw("flap") > math.radians(40.0)
        stage.run(9.0)
        assert abs(stage.yaw("flap")) < math.radians(5.0)

    def test_it_opens_one_way_only(self, tmp_path: Path) -> None:
        """Unless it swings both ways, it is a wall to who comes from the other side."""
        back = '[[belt]]\nname = "line"\nposition = [0.9, 0.0, 0.05]\nsize = [1.6, 0.5, 0.05]\n'
        sheet = HINGED + 'opens = "push"\n' + back + "speed = -0.5\n"
        stage = Stage(tmp_path, sheet, (0.9, 0.0, 0.2))
        stage.run(4.0)
        assert stage.place("crate0")[0] == pytest.approx(0.15 + 0.025, abs=0.01)
        assert abs(stage.yaw("flap")) < 0.02

    def test_it_ends_at_its_stops(self, tmp_path: Path) -> None:
        """However hard it is pushed, it opens no farther than it may."""
        sheet = HINGED + 'opens = "push"\nangle_degrees = 60.0\nspring = 0.0\n'
        stage = Stage(tmp_path, sheet)
        engine = stage.engine
        dof = int(engine.world.model.joint("flap").dofadr[0])
        for _ in range(400):
            engine.data.qfrc_applied[dof] = 30.0
            stage.run(0.004)
        assert stage.yaw("flap") == pytest.approx(math.radians(60.0), abs=0.02)


def test_runs_repeat_whatever_the_batches(tmp_path: Path) -> None:
    """Doors decide at fixed times: batches of 1 and of 7 steps give the same world, bit for bit."""
    sheet = SLIDING + CART + HINGED.replace("[0.0", "[2.0") + 'opens = "push"\n'
    one, other = (Stage(tmp_path, sheet, (0.3, 0.6, 0.15)) for _ in range(2))
    one.run(9.0, batch=1)
    other.run(9.0, batch=7)
    assert one.state() == other.state()
    assert one.place("gate")[1] > 0.5


HOIST = (
    '[[lift]]\nname = "hoist"\nsize = [1.6, 1.6, 0.1]\nstops = [[0.0, 0.0, 0.1], [0.0, 0.0, 1.1]]\n'
)
CALLED = HOIST + 'runs = "load"\n'
LIFTS_CART = (
    '[[obstacle]]\nname = "cart"\nsize = [0.4, 0.4, 0.4]\nway = "once"\ndelay = 1.0\n'
    "points = [[-4.0, 0.0, 0.0], [-1.2, 0.0, 0.0]]\nspeed = 1.0\n"
)


class TestCarrying:
    """What stands on a platform goes where it goes."""

    def test_up_and_down_at_its_speed(self, tmp_path: Path) -> None:
        """A crate rises by 1 m at 0.3 m/s, neither pressed in nor thrown up, and comes down."""
        stage = Stage(tmp_path, HOIST, (0.3, 0.2, 0.25))
        stage.run(4.9)
        assert stage.place("crate0")[2] == pytest.approx(0.25, abs=2e-3)
        fastest = 0.0
        for _ in range(50):
            stage.run(0.1)
            fastest = max(fastest, float(stage.velocity("crate0")[2]))
            assert stage.place("crate0")[2] - stage.place("hoist")[2] == pytest.approx(
                0.15, abs=2e-3
            )
        assert fastest == pytest.approx(0.3, abs=0.01)
        assert stage.place("crate0")[2] == pytest.approx(1.25, abs=2e-3)
        stage.run(9.0)
        assert stage.place("crate0") == pytest.approx([0.3, 0.2, 0.25], abs=3e-3)

    def test_sideways_by_friction(self, tmp_path: Path) -> None:
        """A platform that shuttles takes a crate along without losing it."""
        sheet = HOIST.replace("[0.0, 0.0, 1.1]", "[3.0, 0.0, 0.1]") + "speed = 0.8\n"
        stage = Stage(tmp_path, sheet, (0.0, 0.0, 0.25))
        stage.run(5.0 + 3.0 / 0.8 + 0.8 / 0.5 + 0.3)
        assert stage.place("hoist")[0] == pytest.approx(3.0)
        assert stage.place("crate0")[:2] == pytest.approx([3.0, 0.0], abs=0.02)

    def test_all_stops_there_and_back(self, tmp_path: Path) -> None:
        """By the clock it calls at every stop, turns round at the last and comes back."""
        sheet = HOIST.replace("1.1]]", "1.1], [0.0, 0.0, 2.1]]") + "pause = 1.0\nspeed = 1.0\n"
        stage = Stage(tmp_path, sheet + "acceleration = 5.0\n")
        heights: list[float] = []
        for _ in range(130):
            stage.run(0.1)
            height = round(float(stage.place("hoist")[2]), 6)
            if math.isclose(height % 1.0, 0.1, abs_tol=1e-5) and height not in heights[-1:]:
                heights.append(height)
        assert heights[:6] == pytest.approx([0.1, 1.1, 2.1, 1.1, 0.1, 1.1])


class TestCalls:
    """Lifts that go when somebody wants to go."""

    def test_it_waits_for_nobody_in_particular(self, tmp_path: Path) -> None:
        """Without anybody near it stays."""
        stage = Stage(tmp_path, CALLED, (0.0, 4.0, 0.15))
        stage.run(6.0)
        assert stage.place("hoist")[2] == pytest.approx(0.1)

    def test_it_goes_with_its_load_once(self, tmp_path: Path) -> None:
        """2 s after something has come onto it, it goes, and stays there until that is off."""
        stage = Stage(tmp_path, CALLED, (0.0, 4.0, 0.15))
        stage.run(1.0)
        stage.put("crate0", (0.0, 0.0, 0.26))
        stage.run(1.9)
        assert stage.place("hoist")[2] == pytest.approx(0.1)
        stage.run(6.0)
        assert stage.place("hoist")[2] == pytest.approx(1.1)
        stage.run(4.0)
        assert stage.place("hoist")[2] == pytest.approx(1.1)
        stage.put("crate0", (0.0, 4.0, 0.15))
        stage.run(0.5)
        stage.put("crate0", (0.0, 0.0, 1.26))
        stage.run(7.0)
        assert stage.place("hoist")[2] == pytest.approx(0.1)
        assert stage.place("crate0")[2] == pytest.approx(0.25, abs=3e-3)

    def test_it_waits_for_who_stands_on_the_edge(self, tmp_path: Path) -> None:
        """With something half on it, it does not leave."""
        stage = Stage(tmp_path, CALLED, (0.75, 0.0, 0.26))
        stage.run(8.0)
        assert stage.place("hoist")[2] == pytest.approx(0.1)

    def test_it_comes_to_who_waits(self, tmp_path: Path) -> None:
        """Somebody who stops beside the lower stop has it come down."""
        sheet = CALLED.replace("[[0.0, 0.0, 0.1], [0.0, 0.0, 1.1]]", "[[0, 0, 1.1], [0, 0, 0.1]]")
        stage = Stage(tmp_path, sheet + LIFTS_CART)
        stage.run(1.5)
        assert stage.place("hoist")[2] == pytest.approx(1.1)
        stage.run(8.0)
        assert stage.place("hoist")[2] == pytest.approx(0.1)


class TestMercyOfLifts:
    """Lifts crush nobody."""

    def test_it_stops_above_what_is_below(self, tmp_path: Path) -> None:
        """A crate under a platform that comes down is not touched; when it is gone it goes on."""
        sheet = HOIST.replace("[[0.0, 0.0, 0.1], [0.0, 0.0, 1.1]]", "[[0, 0, 1.1], [0, 0, 0.1]]")
        stage = Stage(tmp_path, sheet + "pause = 1.0\n", (0.3, 0.0, 0.15))
        stage.run(8.0)
        underside = float(stage.place("hoist")[2]) - 0.1
        assert 0.3 < underside < 0.5
        assert stage.place("crate0") == pytest.approx([0.3, 0.0, 0.15], abs=1e-3)
        stage.put("crate0", (3.0, 0.0, 0.15))
        stage.run(2.5)
        assert stage.place("hoist")[2] == pytest.approx(0.1)

    def test_what_rides_is_not_in_the_way(self, tmp_path: Path) -> None:
        """The load of a platform that rises does not stop it, whatever else moves."""
        stage = Stage(tmp_path, HOIST + LIFTS_CART, (0.0, 0.3, 0.25), (0.0, -0.3, 0.25))
        stage.run(10.0)
        assert stage.place("hoist")[2] == pytest.approx(1.1)


def test_runs_repeat_whatever_the_batches_lifts(tmp_path: Path) -> None:
    """Batches of 1 and of 9 steps give the same world, bit for bit."""
    one, other = (Stage(tmp_path, CALLED + LIFTS_CART, (0.2, 0.1, 0.26)) for _ in range(2))
    one.run(7.0, batch=1)
    other.run(7.0, batch=9)
    assert one.state() == other.state()
    assert np.isclose(one.place("hoist")[2], 1.1)
