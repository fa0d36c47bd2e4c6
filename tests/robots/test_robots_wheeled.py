"""DRIVE for skid-steered and differential robots, and for wheels driven and steered one by one
(protocol reference 3.4.3, 3.4.6).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_fakes import ROBOTS, UDK, UT, Driver, wild_drives

from usarsim_server.protocol.requests import Drive, WheelTarget
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.families.wheeled import WheelDrive
from usarsim_server.testing import Rehearsal

P2AT, P3AT, P2DX = ROBOTS["P2AT"], ROBOTS["P3AT"], ROBOTS["P2DX"]
LIMIT = 5.385


def drive(law: WheelDrive, dialect: Dialect = UT, **segments: object) -> tuple[float, ...] | None:
    """Targets after a command, None if it does not move."""
    targets = law.command(Drive(**segments), dialect)  # type: ignore[arg-type]
    return None if targets is None else tuple(targets.tolist())


@pytest.mark.parametrize("dialect", Dialect)
def test_sides_go_to_their_wheels_in_part_order(dialect: Dialect) -> None:
    """Left and Right reach the wheels of their side, in the part order of the robot file."""
    assert drive(WheelDrive(P2AT), dialect, left=1.0, right=2.0) == (1.0, 2.0, 1.0, 2.0)
    assert drive(WheelDrive(P3AT), dialect, left=-1.0, right=0.5) == (0.5, -1.0, 0.5, -1.0)
    assert drive(WheelDrive(P2DX), dialect, left=1.0, right=2.0) == (1.0, 2.0)


@pytest.mark.parametrize("dialect", Dialect)
def test_a_wheel_is_driven_by_its_name(dialect: Dialect) -> None:
    """The single joint form with order 1 turns one wheel, in any case (protocol 3.4.6)."""
    law = WheelDrive(P2AT)
    names = [wheel.name for wheel in P2AT.driven_wheels]
    assert drive(law, dialect, name=names[2].upper(), value=1.5, order=1) == (0.0, 0.0, 1.5, 0.0)
    assert drive(law, dialect, name=names[0], value=99.0, order=1) == (LIMIT, 0.0, 1.5, 0.0)
    for other in ({"order": 0}, {"order": 2}, {"order": 1, "steer": 1}, {"order": 11}):
        assert drive(law, dialect, name=names[1], value=1.0, **other) is None
    assert drive(law, dialect, name=names[1], order=1) is None
    assert drive(law, dialect, name="robot_0", value=1.0, order=1) is None


def test_free_wheels_get_no_target(tmp_path) -> None:
    """Only driven wheels are told a speed."""
    from robot_files import LEFT, RIGHT, table, write

    from usarsim_server.robots.catalog import load_robot

    free = {**LEFT, "name": "Rear", "position": [-0.2, 0, 0.05], "side": "left", "driven": False}
    robot = load_robot(write(tmp_path, "Test", table(wheel=[free, LEFT, RIGHT])))
    assert drive(WheelDrive(robot), left=1.0, right=2.0) == (1.0, 2.0)


def test_one_side_alone_keeps_the_other_in_ut2004() -> None:
    """In `ut2004` a missing side keeps its last value (robots 35, protocol reference 3.4.1)."""
    law = WheelDrive(P2DX)
    assert drive(law, left=1.0) == (1.0, 0.0)
    assert drive(law, right=2.0) == (1.0, 2.0)
    assert drive(law, left=0.0) == (0.0, 2.0)


def test_one_side_alone_is_ignored_in_udk() -> None:
    """In `udk` an incomplete pair changes nothing (robots 35, protocol reference 3.4.1)."""
    law = WheelDrive(P2DX)
    assert drive(law, UDK, left=1.0) is None
    assert drive(law, UDK, right=1.0) is None
    assert drive(law, UDK, left=1.0, right=2.0) == (1.0, 2.0)
    assert drive(law, UDK, left=0.5) is None
    assert law.targets.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("dialect", Dialect)
@pytest.mark.parametrize(
    ("percent", "speed"),
    [(100, LIMIT), (50, LIMIT / 2), (0, 0), (-100, -LIMIT), (200, LIMIT), (-200, -LIMIT)],
)
def test_normalized_is_percent_of_the_limit(dialect: Dialect, percent: int, speed: float) -> None:
    """Normalized 100 is the wheel limit, 50 half of it, 200 is clamped (robots 36)."""
    targets = drive(WheelDrive(P2AT), dialect, left=percent, right=percent, normalized=True)
    assert targets == pytest.approx((speed,) * 4)


@pytest.mark.parametrize("dialect", Dialect)
@pytest.mark.parametrize("value", [6.0, 1e9, math.inf])
def test_speeds_are_clamped_to_the_limit(dialect: Dialect, value: float) -> None:
    """A DRIVE beyond the limit runs at the limit, also backward (robots 37)."""
    assert drive(WheelDrive(P2DX), dialect, left=value, right=-value) == (5.4, -5.4)


def test_limit_of_p3at_is_the_full_one() -> None:
    """P3AT runs up to 1.3 rad/s although 1.2999 is announced."""
    assert drive(WheelDrive(P3AT), UDK, left=2.0, right=2.0) == (1.3,) * 4


def test_normalized_holds_for_one_command_in_ut2004() -> None:
    """In `ut2004` the next command without the flag is in rad/s (protocol reference 3.4)."""
    law = WheelDrive(P2DX)
    assert drive(law, left=50, right=50, normalized=True) == pytest.approx((2.7, 2.7))
    assert drive(law, left=1.0, right=1.0) == (1.0, 1.0)


def test_normalized_sticks_in_udk() -> None:
    """In `udk` the flag stays until it is sent again (protocol reference 3.4)."""
    law = WheelDrive(P2DX)
    assert drive(law, UDK, left=1.0, right=1.0) == (1.0, 1.0)
    assert drive(law, UDK, left=50, right=50, normalized=True) == pytest.approx((2.7, 2.7))
    assert drive(law, UDK, left=10, right=10) == pytest.approx((0.54, 0.54))
    assert drive(law, UDK, left=1.0, right=1.0, normalized=False) == (1.0, 1.0)
    assert drive(law, UDK, left=2.0, right=2.0) == (2.0, 2.0)


def test_normalized_alone_is_remembered_in_udk() -> None:
    """In `udk` the flag may come without speeds and holds for those that follow."""
    law = WheelDrive(P2DX)
    assert drive(law, UDK, normalized=True) is None
    assert drive(law, UDK, left=50, right=50) == pytest.approx((2.7, 2.7))


def test_flag_of_a_ut2004_command_does_not_stick_after_a_change_of_dialect() -> None:
    """A connection that turns from `ut2004` to `udk` starts without a remembered flag."""
    law = WheelDrive(P2DX)
    drive(law, UT, left=50, right=50, normalized=True)
    assert drive(law, UDK, left=1.0, right=1.0) == (1.0, 1.0)


def test_kept_side_stays_in_rad_per_second() -> None:
    """A side that is kept is not scaled again by a normalized command for the other side."""
    law = WheelDrive(P2DX)
    drive(law, left=2.0, right=2.0)
    assert drive(law, left=100, normalized=True) == pytest.approx((5.4, 2.0))


@pytest.mark.parametrize("dialect", Dialect)
def test_light_alone_does_not_move(dialect: Dialect) -> None:
    """The headlight can be switched without touching the wheels (protocol reference 3.4)."""
    law = WheelDrive(P2DX)
    assert law.light is False
    drive(law, dialect, left=1.0, right=2.0)
    assert drive(law, dialect, light=True) is None
    assert law.light is True
    assert law.targets.tolist() == [1.0, 2.0]
    assert drive(law, dialect, left=3.0, right=3.0) == (3.0, 3.0)
    assert law.light is True
    assert drive(law, dialect, light=False, left=0.0, right=0.0) == (0.0, 0.0)
    assert law.light is False


@pytest.mark.parametrize("dialect", Dialect)
def test_other_families_and_flip_do_not_move(dialect: Dialect) -> None:
    """Aerial, Ackerman and joint members, Flip and an empty DRIVE leave the wheels alone."""
    law = WheelDrive(P2DX)
    drive(law, dialect, left=1.0, right=2.0)
    for segments in (
        {},
        {"flip": True},
        {"speed": 3.0, "front_steer": 0.1, "rear_steer": 0.1},
        {"altitude_velocity": 1.0, "linear_velocity": 1.0},
        {"name": "j", "value": 0.5},
    ):
        assert drive(law, dialect, **segments) is None
    assert law.targets.tolist() == [1.0, 2.0]


def test_robot_name_on_a_wheel_command_is_ignored() -> None:
    """`DRIVE {Name robot_0} {Left f} {Right f}` is a wheel command (addendum)."""
    assert drive(WheelDrive(P2DX), left=1.0, right=1.0, name="robot_0") == (1.0, 1.0)


@pytest.mark.parametrize("dialect", Dialect)
def test_wheel_by_wheel_form(dialect: Dialect) -> None:
    """WheelNumber groups drive the wheels they name and no others (protocol reference 6.9 #150)."""
    law = WheelDrive(P2AT)
    wheels = (WheelTarget(0, 1.0), WheelTarget(1, 9.0), WheelTarget(7, 1.0), WheelTarget(2))
    assert drive(law, dialect, wheels=wheels) == (1.0, LIMIT, 0.0, 0.0)
    assert drive(law, dialect, wheels=(WheelTarget(3, 50),), normalized=True) == pytest.approx(
        (1.0, LIMIT, 0.0, LIMIT / 2)
    )
    assert drive(law, dialect, wheels=(WheelTarget(-1, 1.0),)) is None


@pytest.mark.parametrize("dialect", Dialect)
def test_not_a_number_counts_as_not_sent(dialect: Dialect) -> None:
    """Not-a-number never reaches a wheel."""
    law = WheelDrive(P2DX)
    assert drive(law, dialect, left=math.nan, right=math.nan) is None
    assert drive(law, dialect, left=math.nan, right=1.0) == ((0.0, 1.0) if dialect is UT else None)


def test_stop_stops() -> None:
    """Stopping sets every wheel to zero and leaves the headlight as it is."""
    law = WheelDrive(P2AT)
    drive(law, left=1.0, right=1.0, light=True)
    assert law.stop().tolist() == [0.0] * 4
    assert law.targets.tolist() == [0.0] * 4
    assert law.light is True


def test_targets_are_copies() -> None:
    """What a caller does to the targets it was given does not change the law's memory."""
    law = WheelDrive(P2DX)
    targets = law.command(Drive(left=1.0, right=1.0), UT)
    assert targets is not None
    targets[:] = 9.0
    assert law.targets.tolist() == [1.0, 1.0]


speeds = st.none() | st.floats()
commands = st.builds(
    Drive,
    left=speeds,
    right=speeds,
    normalized=st.none() | st.booleans(),
    light=st.none() | st.booleans(),
    wheels=st.lists(st.builds(WheelTarget, st.integers(-2, 9), speeds), max_size=3).map(tuple),
)


@given(st.lists(st.tuples(commands, st.sampled_from(Dialect)), max_size=8))
def test_no_sequence_of_commands_leaves_the_limits(
    sequence: list[tuple[Drive, Dialect]],
) -> None:
    """Whatever is sent, targets are finite and within the limit, and None means no change."""
    law = WheelDrive(P2AT)
    before = law.targets
    for command, dialect in sequence:
        targets = law.command(command, dialect)
        if targets is None:
            assert np.array_equal(before, law.targets)
        else:
            assert np.array_equal(targets, law.targets)
        assert np.all(np.abs(law.targets) <= LIMIT)
        before = law.targets


LISA = ROBOTS["Lisa"]
OMNI_LIMIT = 8.33
ROLLS = math.nan
"""Speed of a wheel that has not been named yet."""


def wheels(*groups: tuple[int, float | None, float | None]) -> dict[str, object]:
    """Members of a wheel by wheel command."""
    return {"wheels": tuple(WheelTarget(*group) for group in groups)}


@pytest.mark.parametrize("dialect", Dialect)
def test_named_wheels_only(dialect: Dialect) -> None:
    """A group drives and steers the wheel that it names, the others keep what they had
    (protocol 150)."""
    driver = Driver(LISA, dialect)
    assert driver.send(**wheels((0, 1.0, 0.5), (2, 2.0, None)))
    assert driver.machine.wheels == pytest.approx([1.0, ROLLS, 2.0, ROLLS], nan_ok=True)
    assert driver.machine.positions == pytest.approx({"LeftFSteer": 0.5})
    assert driver.send(**wheels((2, None, -0.3)))
    assert driver.machine.wheels == pytest.approx([1.0, ROLLS, 2.0, ROLLS], nan_ok=True)
    assert driver.machine.positions == pytest.approx({"LeftFSteer": 0.5, "LeftRSteer": -0.3})
    assert driver.send(**wheels((3, -1.0, None)))
    assert driver.machine.wheels == pytest.approx([1.0, ROLLS, 2.0, -1.0], nan_ok=True)


def test_numbers_out_of_range_are_ignored() -> None:
    """Groups of wheels that do not exist change nothing, and do not disturb the others."""
    driver = Driver(LISA)
    assert not driver.send(**wheels((4, 1.0, 1.0), (-1, 1.0, 1.0), (10**9, 1.0, 1.0)))
    assert driver.send(**wheels((99, 1.0, 1.0), (1, 1.5, None)))
    assert driver.machine.wheels == pytest.approx([ROLLS, 1.5, ROLLS, ROLLS], nan_ok=True)


def test_percent_and_limits() -> None:
    """Normalized scales speeds, not angles; both stop at their limits; nonsense is not sent."""
    driver = Driver(LISA)
    driver.send(
        **wheels((0, 50.0, 0.5), (1, 1e9, 99.0), (2, -math.inf, -math.inf)), normalized=True
    )
    expected = [OMNI_LIMIT / 2, OMNI_LIMIT, -OMNI_LIMIT, ROLLS]
    assert driver.machine.wheels == pytest.approx(expected, nan_ok=True)
    assert driver.machine.positions["LeftFSteer"] == pytest.approx(0.5)
    assert driver.machine.positions["RightFSteer"] == pytest.approx(3.1416)
    assert driver.machine.positions["LeftRSteer"] == pytest.approx(-3.1416)
    assert not driver.send(**wheels((0, math.nan, math.nan)))


def test_percent_sticks_in_udk_only() -> None:
    """As for other ground vehicles (protocol reference 3.4)."""
    for dialect, speed in ((UDK, OMNI_LIMIT / 10), (UT, 10.0 if OMNI_LIMIT > 10 else OMNI_LIMIT)):
        driver = Driver(LISA, dialect)
        driver.send(**wheels((0, 50.0, None)), normalized=True)
        driver.send(**wheels((0, 10.0, None)))
        assert driver.machine.wheels is not None
        assert driver.machine.wheels[0] == pytest.approx(speed)


def test_single_joint_form() -> None:
    """DRIVE {Name wheel}: Steer 1 is its steering axis, order 1 its spin (protocol 3.4.6)."""
    driver = Driver(LISA)
    assert driver.send(name="rightfwheel", value=0.4, steer=1)
    assert driver.machine.positions == pytest.approx({"RightFSteer": 0.4})
    assert driver.send(name="RightFWheel", value=2.0, order=1)
    assert driver.machine.wheels == pytest.approx([ROLLS, 2.0, ROLLS, ROLLS], nan_ok=True)
    assert not driver.send(name="RightFWheel", value=2.0)  # a wheel takes no angle
    assert not driver.send(name="Nobody", value=2.0, order=1)


@pytest.mark.parametrize("dialect", Dialect)
def test_other_families_do_nothing(dialect: Dialect) -> None:
    """Sides, cars and aircraft are not meant."""
    driver = Driver(LISA, dialect)
    assert not driver.send(left=1.0, right=1.0, speed=1.0, front_steer=0.1, rear_steer=0.1)
    assert not driver.send(light=True)
    assert driver.drive_controller.light


def test_stop() -> None:
    """Without power all wheels stand."""
    driver = Driver(LISA)
    driver.send(**wheels((0, 1.0, 0.5)))
    driver.drive_controller.stop()
    assert driver.machine.wheels == pytest.approx([0.0] * 4)


@settings(max_examples=100)
@given(st.lists(wild_drives, max_size=5), st.sampled_from(Dialect))
def test_no_command_leaves_the_limits(drives: list[Drive], dialect: Dialect) -> None:
    """Whatever is sent, speeds and angles are within the limits."""
    driver = Driver(LISA, dialect)
    for drive in drives:
        driver.obey(drive)
    if driver.machine.wheels is not None:
        assert not np.any(np.abs(driver.machine.wheels) > OMNI_LIMIT)
    assert all(abs(position) <= 3.1416 for position in driver.machine.positions.values())


def test_reports() -> None:
    """CONF says OmniDrive; STA has no steering of its own."""
    assert "{SteeringType OmniDrive}" in LISA.family.configuration(LISA, UT)
    line = Driver(LISA).status({"LeftFSteer": 0.5})
    assert "{FrontSteer 0.0000} {RearSteer 0.0000}" in line
    assert "LeftFSteer" not in line


@pytest.mark.parametrize("driven", [(0, 1), (2, 3), (0, 3), (0,)])
def test_some_wheels_are_enough(driven: tuple[int, ...]) -> None:
    """Protocol 150: clients drive wheels 0 and 1 only; the others roll along instead of holding it
    back.

    A stop, and a speed of zero, brake the wheels that are told so.
    """
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.Lisa} {Location 0,0,-0.1}")
        client.send("DRIVE " + "".join(f"{{WheelNumber {n}}} {{WheelSpeed 4}} " for n in driven))
        stage.run(2.0)
        state = stage.robot_state()
        assert state.linear_velocity[0] == pytest.approx(4.0 * 0.06, rel=0.01)
        assert state.wheel_speeds == pytest.approx([4.0] * 4, rel=0.01)
        client.send("DRIVE " + "".join(f"{{WheelNumber {n}}} {{WheelSpeed 0}} " for n in range(4)))
        stage.run(1.0)
        state = stage.robot_state()
        assert abs(state.linear_velocity[0]) < 1e-3


def test_it_goes_sideways() -> None:
    """All wheels turned by a quarter and rolling, Lisa drives to the right without turning."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.Lisa} {Location 0,0,-0.1}")
        turned = "".join(f"{{WheelNumber {n}}} {{WheelSteer 1.5708}} " for n in range(4))
        client.send(f"DRIVE {turned}")
        stage.run(2.0)
        rolling = "".join(f"{{WheelNumber {n}}} {{WheelSpeed 4}} " for n in range(4))
        client.send(f"DRIVE {rolling}")
        stage.run(1.0)
        before = stage.robot_state()
        stage.run(1.0)
        after = stage.robot_state()
        (x0, y0, _), (x1, y1, _) = before.pose.position, after.pose.position
        assert y1 - y0 == pytest.approx(-4.0 * 0.06, rel=0.03)
        assert abs(x1 - x0) < 0.005
        assert abs(after.angular_velocity[2]) < 0.01
