"""Robot files: every key, every error, inheritance."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from robot_files import ARM, CASTER, LEFT, RIGHT, SENSOR, SHAPE, table, write

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import BatteryDescription
from usarsim_server.robots.reading.limbs import MOST_CAMERAS
from usarsim_server.robots.reading.parts import MOST_ITEMS
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.frames import wire_from_pose


def load(folder: Path, **changes: Any):
    return load_robot(write(folder, "Test", table(**changes)))


def load_variant(folder: Path, child: dict[str, Any], **changes: Any):
    write(folder, "Parent", table(**changes))
    return load_robot(write(folder, "Child", {"extends": "Parent", **child}))


def test_small_file_loads_with_defaults(tmp_path: Path) -> None:
    """A file that says only what it must becomes a robot with the documented defaults."""
    robot = load(tmp_path)
    assert (robot.name, robot.model) == ("Test", "Test")
    assert robot.kind == "differential"
    assert robot.dialect is Dialect.UT2004
    assert robot.description == "a small test robot"
    assert robot.source == tmp_path / "Test.toml"
    assert robot.rest_height == pytest.approx(0.15)
    assert robot.battery is None
    assert robot.drive.max_wheel_speed == 5.0
    assert (robot.drive.wheel_torque, robot.drive.servo_gain) == (8.0, 800.0)
    assert (robot.drive.wheel_acceleration, robot.drive.parking_brake_delay) == (10.0, 0.3)
    assert robot.drive.wheel_deceleration == 40.0


def test_wire_frame_becomes_simulation_frame(tmp_path: Path) -> None:
    """y right and z down in the file are y left and z up inside (robots 15)."""
    robot = load(
        tmp_path,
        shape=[{**SHAPE, "position": [0.1, 0.2, -0.3], "rotation": [0.1, 0.2, 0.3]}],
        sensor=[{**SENSOR, "position": [0.1, -0.2, -0.3], "rotation": [0, 0, -math.pi / 2]}],
    )
    assert robot.shapes[0].pose.position == (0.1, -0.2, 0.3)
    location, rotation = wire_from_pose(robot.shapes[0].pose)
    assert location == pytest.approx((0.1, 0.2, -0.3))
    assert rotation == pytest.approx((0.1, 0.2, 0.3))
    left, right = robot.wheels
    assert left.position == (0.0, 0.15, -0.05)
    assert right.position == (0.0, -0.15, -0.05)
    assert robot.casters[0].position == (-0.15, 0.0, -0.12)
    pose = robot.items[0].pose
    assert pose.position == (0.1, 0.2, 0.3)
    # Facing left on the wire (yaw -90) is facing +y inside.
    assert pose.rotate((1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))


def test_side_follows_from_y(tmp_path: Path) -> None:
    """A wheel with positive y is on the right, whatever its name."""
    assert [wheel.side for wheel in load(tmp_path).wheels] == ["left", "right"]


def test_wheel_on_the_middle_line_needs_a_side(tmp_path: Path) -> None:
    """A wheel at y = 0 must say which side's speed it takes."""
    middle = {**LEFT, "name": "Middle", "position": [0.2, 0.0, 0.05], "driven": False}
    with pytest.raises(RobotDescriptionError, match=r"3 \(Middle\): side: is missing"):
        load(tmp_path, wheel=[LEFT, RIGHT, middle])
    robot = load(tmp_path, wheel=[LEFT, RIGHT, {**middle, "side": "left"}])
    assert robot.wheels[2].side == "left"
    assert [wheel.name for wheel in robot.driven_wheels] == ["LeftWheel", "RightWheel"]


def test_report_follows_from_wheels_and_masses(tmp_path: Path) -> None:
    """GEO and CONF geometry, radius and mass come from the body, not from keys (robots 19)."""
    report = load(tmp_path).report
    assert report.wheel_radius == 0.1
    assert report.track_width == 0.3
    # From the axle of the wheels to that of the caster.
    assert report.wheel_base == 0.15
    assert report.dimensions == (0.15, 0.3, 0.0)
    assert report.mass == 6.2
    assert report.max_speed == 5.0
    assert report.max_torque == 50000.0
    assert report.steering_type == "SkidSteered"
    assert (report.max_front_steer, report.max_rear_steer) == (0.0, 0.0)


def test_report_can_be_set_where_it_is_free(tmp_path: Path) -> None:
    """Announced figures that nothing here depends on can be written down."""
    report = load(
        tmp_path,
        report={
            "dimensions": [0.5, 0.4, 0.3],
            "center_of_gravity": [0, 0, -0.1],
            "max_speed": 4.9,
            "max_torque": 60,
            "max_front_steer": 0.1,
            "max_rear_steer": 0.2,
            "steering_type": "Unknown",
        },
    ).report
    assert report.dimensions == (0.5, 0.4, 0.3)
    assert report.center_of_gravity == (0.0, 0.0, -0.1)
    assert (report.max_speed, report.max_torque) == (4.9, 60.0)
    assert (report.max_front_steer, report.max_rear_steer) == (0.1, 0.2)
    assert report.steering_type == "Unknown"


def test_shapes_take_sizes_colors_and_flags(tmp_path: Path) -> None:
    """Every kind of shape loads with its own number of sizes; colours may leave out alpha."""
    shapes = [
        {"kind": "box", "size": [1, 2, 3], "mass": 1, "color": [0.1, 0.2, 0.3]},
        {"kind": "cylinder", "size": [1, 2], "color": [0.1, 0.2, 0.3, 0.4], "collides": False},
        {"kind": "sphere", "size": [1]},
        {"kind": "ellipsoid", "size": [1, 2, 3]},
        {"kind": "capsule", "size": [1, 2]},
    ]
    loaded = load(tmp_path, shape=shapes).shapes
    assert [shape.kind for shape in loaded] == [shape["kind"] for shape in shapes]
    assert [len(shape.size) for shape in loaded] == [3, 2, 1, 3, 2]
    assert loaded[0].color == (0.1, 0.2, 0.3, 1.0)
    assert loaded[1].color == (0.1, 0.2, 0.3, 0.4)
    assert [shape.collides for shape in loaded] == [True, False, True, True, True]
    assert [shape.mass for shape in loaded] == [1.0, 0.0, 0.0, 0.0, 0.0]


def test_items_keep_order_link_parameters_and_place(tmp_path: Path) -> None:
    """Sensors keep mount order, link, free parameters, and know where they stand."""
    robot = load(
        tmp_path,
        sensor=[
            {"type": "SICK", "name": "lms200", "max_range": 10.0, "interval": 0.1},
            {"type": "Encoder", "name": "ECRight", "link": "rightwheel", "wheel": 1},
        ],
    )
    laser, encoder = robot.items
    assert (laser.type, laser.name, laser.link) == ("SICK", "lms200", None)
    assert laser.parameters == {"max_range": 10.0, "interval": 0.1}
    assert laser.where == f"{tmp_path / 'Test.toml'}: [[sensor]] 1 (lms200)"
    assert encoder.link == "RightWheel"
    assert encoder.parameters == {"wheel": 1}


def test_battery_table_and_its_absence(tmp_path: Path) -> None:
    """A battery table with or without keys is a battery; false and nothing are none."""
    assert load(tmp_path, battery={}).battery == BatteryDescription(1200.0, 1.0e6)
    assert load(tmp_path, battery={"life": 60, "energy": 10}).battery == BatteryDescription(60, 10)
    assert load(tmp_path, battery=False).battery is None


def test_two_items_of_one_type_and_name_only_warn(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """AirRobot's two GPS: the same type and name twice is a warning, not an error (robots 16)."""
    gps = {"type": "GPS", "name": "GPS"}
    with caplog.at_level(logging.WARNING, logger="usarsim"):
        robot = load(tmp_path, sensor=[gps, gps])
    assert [item.name for item in robot.items] == ["GPS", "GPS"]
    assert "second item of this type and name" in caplog.text


def test_one_name_for_items_of_different_types_is_fine(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A sonar and a touch sensor may share a name without a word (robots 16)."""
    with caplog.at_level(logging.WARNING, logger="usarsim"):
        robot = load(
            tmp_path, sensor=[{"type": "GPS", "name": "X"}, {"type": "Touch", "name": "X"}]
        )
    assert len(robot.items) == 2
    assert caplog.text == ""


NAMELESS = {key: value for key, value in SENSOR.items() if key != "name"}
ERRORS: list[tuple[dict[str, Any], str]] = [
    ({"kind": "walker"}, "kind: 'walker'"),
    ({"kind": None}, "kind: is missing"),
    ({"kind": 3}, "kind: 3 is not text"),
    ({"dialect": "auto"}, "dialect: 'auto'"),
    ({"dialect": None}, "dialect: is missing"),
    ({"name": "Other"}, "call the file Other.toml"),
    ({"name": "a b"}, "letters, digits"),
    ({"description": 1}, "description: 1 is not text"),
    ({"aliases": ["x y"]}, "aliases: has 'x y'"),
    ({"aliases": "x"}, "aliases: 'x' is not a list of texts"),
    ({"alias_patterns": [1]}, "alias_patterns: 1 is not text"),
    ({"extends": "Nothing"}, "no robot class 'Nothing'"),
    ({"extends": "Test"}, "no robot class 'Test'"),
    ({"wheels": []}, "wheels: unknown key (did you mean wheel?"),
    ({"sensors": []}, "did you mean sensor?"),
    # Body
    ({"shape": None}, "shape: is missing"),
    ({"shape": {}}, "shape: {} is not a list of tables"),
    ({"shape": [{**SHAPE, "mass": 0}], "caster": []}, "all pieces are weightless"),
    ({"shape": [{**SHAPE, "mass": -1}]}, "mass: -1"),
    ({"shape": [{**SHAPE, "mass": math.nan}]}, "mass: nan is not a finite number"),
    ({"shape": [{**SHAPE, "kind": "cone"}]}, "kind: 'cone'"),
    ({"shape": [{**SHAPE, "kind": "sphere"}]}, "is not 1 numbers"),
    ({"shape": [{**SHAPE, "size": [1, 2, 0]}]}, "size: 0"),
    ({"shape": [{**SHAPE, "color": [1, 1]}]}, "color: [1, 1] is not 3 or 4 numbers"),
    ({"shape": [{**SHAPE, "color": [1, 1, 2]}]}, "color: 2"),
    ({"shape": [{**SHAPE, "colour": [1, 1, 1]}]}, "did you mean color?"),
    ({"shape": [{**SHAPE, "position": [0, 0]}]}, "position: [0, 0] is not 3 numbers"),
    ({"shape": [{**SHAPE, "rotation": [0, 0, math.inf]}]}, "rotation: inf is not a finite"),
    ({"shape": [{**SHAPE, "collides": 1}]}, "collides: 1 is not true or false"),
    ({"wheel": None}, "no driven wheel on the left"),
    ({"wheel": [RIGHT]}, "no driven wheel on the left"),
    ({"wheel": [LEFT]}, "no driven wheel on the right"),
    ({"wheel": [LEFT, {**RIGHT, "driven": False}]}, "no driven wheel on the right"),
    ({"wheel": [LEFT, {**RIGHT, "name": "leftwheel"}]}, "two wheels are called 'leftwheel'"),
    ({"wheel": [LEFT, {**RIGHT, "name": "Base"}]}, "name: is 'Base'"),
    ({"wheel": [LEFT, {**RIGHT, "name": "free"}]}, "name: is 'free'"),
    ({"wheel": [LEFT, {**RIGHT, "name": "a:b"}]}, "name: is 'a:b'"),
    ({"wheel": [LEFT, {**RIGHT, "side": "left"}]}, "side: is 'left' but y is 0.15"),
    ({"wheel": [LEFT, {**RIGHT, "side": "up"}]}, "side: 'up'"),
    ({"wheel": [LEFT, {**RIGHT, "radius": 0}]}, "2 (RightWheel): radius: 0"),
    ({"wheel": [LEFT, {**RIGHT, "width": -1}]}, "width: -1"),
    ({"wheel": [LEFT, {**RIGHT, "mass": 0}]}, "mass: 0"),
    ({"wheel": [LEFT, {**RIGHT, "raduis": 1}]}, "did you mean radius?"),
    ({"caster": [{**CASTER, "mass": -1}]}, "[[caster]] 1: mass: -1"),
    ({"caster": [{**CASTER, "radius": 0}]}, "radius: 0"),
    ({"caster": [{**CASTER, "name": "x"}]}, "name: unknown key"),
    ({"rest_height": 0.3}, "wheels touch the floor at 0.15"),
    ({"rest_height": "high"}, "rest_height: 'high' is not a number"),
    # Drive, battery, report
    ({"drive": None}, "[drive]: max_wheel_speed: is missing"),
    ({"drive": 5}, "drive: 5 is not a table"),
    ({"drive": {"max_wheel_speed": 0}}, "[drive]: max_wheel_speed: 0"),
    ({"drive": {"max_wheel_speed": 5, "wheel_torque": -1}}, "wheel_torque: -1"),
    ({"drive": {"max_wheel_speed": 5, "servo_gain": 0}}, "servo_gain: 0"),
    ({"drive": {"max_wheel_speed": 5, "wheel_acceleration": 0}}, "wheel_acceleration: 0"),
    ({"drive": {"max_wheel_speed": 5, "parking_brake_delay": -1}}, "parking_brake_delay: -1"),
    ({"drive": {"max_speed": 5, "max_wheel_speed": 5}}, "did you mean max_wheel_speed?"),
    ({"battery": {"life": 0}}, "[battery]: life: 0"),
    ({"battery": {"energy": 0}}, "[battery]: energy: 0"),
    ({"battery": {"lives": 9}}, "did you mean life?"),
    ({"battery": True}, "battery: True is not a table"),
    ({"report": {"wheel_radius": 0.2}}, "it follows from the wheels"),
    ({"report": {"mass": 14}}, "it follows from the wheels and masses"),
    ({"report": {"max_speed": -1}}, "[report]: max_speed: -1"),
    ({"report": {"steering_type": "Crab"}}, "steering_type: 'Crab'"),
    ({"report": {"dimensions": [1, 2]}}, "dimensions: [1, 2] is not 3 numbers"),
    ({"report": {"maxspeed": 1}}, "did you mean max_speed?"),
    # Sensors
    ({"sensor": [NAMELESS]}, "[[sensor]] 1: name: is missing"),
    ({"sensor": [{**SENSOR, "name": "a b"}]}, "name: is 'a b'"),
    ({"sensor": [{**SENSOR, "name": ""}]}, "name: is empty"),
    ({"sensor": [{**SENSOR, "name": "a}"}]}, "name: is 'a}'"),
    ({"sensor": [{"name": "F1"}]}, "1 (F1): type: is missing"),
    ({"sensor": [{**SENSOR, "link": "LeftWeel"}]}, "no link 'LeftWeel' (did you mean 'LeftWheel'?"),
    ({"sensor": [{**SENSOR, "interval": -1}]}, "interval: -1"),
    ({"sensor": [{**SENSOR, "interval": "often"}]}, "interval: 'often' is not a number"),
    ({"sensor": [{**SENSOR, "noise": math.nan}]}, "noise: nan is not a finite number"),
    ({"sensor": SENSOR}, "is not a list of tables"),
    ({"without": ["F1"]}, "no inherited sensor 'F1'"),
]


@pytest.mark.parametrize(("changes", "problem"), ERRORS, ids=[problem for _, problem in ERRORS])
def test_each_mistake_is_one_error_with_its_place(
    tmp_path: Path, changes: dict[str, Any], problem: str
) -> None:
    """Every mistake raises one error that names the file and says what to write instead."""
    with pytest.raises(RobotDescriptionError) as caught:
        load(tmp_path, **changes)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'Test.toml'}: ")
    assert problem in message
    assert message.endswith(")")
    assert "\n" not in message


def test_name_may_spell_the_case_of_the_file(tmp_path: Path) -> None:
    """The file name may be in another case than the class; the key decides the spelling."""
    assert load_robot(write(tmp_path, "test", table(name="TeSt"))).name == "TeSt"


def test_variant_inherits_everything(tmp_path: Path) -> None:
    """A file that only extends is the same robot under its own name and shares its model."""
    variant = load_variant(tmp_path, {}, battery={"life": 60})
    parent = load_robot(tmp_path / "Parent.toml")
    assert (variant.name, variant.model) == ("Child", "Parent")
    assert variant.source == tmp_path / "Child.toml"
    assert replace(variant, name="Parent", source=parent.source) == parent


def test_variant_with_another_speed_limit_shares_the_model(tmp_path: Path) -> None:
    """The speed limit is kept outside the physics; it and its announcement change together."""
    variant = load_variant(
        tmp_path, {"drive": {"max_wheel_speed": 8.17}}, report={"max_speed": 4.99999}
    )
    assert variant.model == "Parent"
    assert variant.drive.max_wheel_speed == 8.17
    assert variant.report.max_speed == 8.17


@pytest.mark.parametrize(
    "change",
    [
        {"drive": {"wheel_torque": 3.0}},
        {"drive": {"wheel_acceleration": 3.0}},
        {"shape": [{**SHAPE, "mass": 6.0}]},
        {"wheel": [{**LEFT, "radius": 0.11}, {**RIGHT, "radius": 0.11}]},
        {"caster": []},
    ],
)
def test_variant_with_another_body_is_a_model_of_its_own(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    """Robots share parked bodies only if their bodies and servos are equal."""
    assert load_variant(tmp_path, change).model == "Child"


def test_variant_with_other_wheels_announces_them(tmp_path: Path) -> None:
    """New wheels change radius, track, dimensions and rest height of a variant (robots 19)."""
    wheels = [
        {**LEFT, "radius": 0.2, "position": [0.0, -0.25, 0.05]},
        {**RIGHT, "radius": 0.2, "position": [0.0, 0.25, 0.05]},
    ]
    variant = load_variant(tmp_path, {"wheel": wheels}, report={"dimensions": [1, 1, 1]})
    assert variant.report.wheel_radius == 0.2
    assert variant.report.track_width == 0.5
    assert variant.report.dimensions == (0.15, 0.5, 0.0)
    assert variant.rest_height == 0.25


def test_variant_adds_replaces_and_drops_sensors(tmp_path: Path) -> None:
    """A sensor of the same type and name replaces the inherited one, others are added."""
    touch = {"type": "Touch", "name": "Touch"}
    variant = load_variant(
        tmp_path,
        {"without": ["Touch"], "sensor": [{"type": "GPS", "name": "GPS"}, {**SENSOR, "cones": 3}]},
        sensor=[SENSOR, touch],
    )
    assert [(item.type, item.name) for item in variant.items] == [("Sonar", "F1"), ("GPS", "GPS")]
    assert variant.items[0].parameters == {"cones": 3}


def test_variant_drops_only_what_is_there(tmp_path: Path) -> None:
    """Dropping a sensor that is not inherited names the nearest one."""
    with pytest.raises(
        RobotDescriptionError, match=r"no inherited sensor 'F1x' \(did you mean 'F1'"
    ):
        load_variant(tmp_path, {"without": ["F1x"]})


def test_variant_may_drop_the_battery(tmp_path: Path) -> None:
    """`battery = false` takes the inherited battery away; a table changes part of it."""
    assert load_variant(tmp_path, {"battery": False}, battery={}).battery is None
    changed = load_variant(tmp_path, {"battery": {"energy": 5}}, battery={"life": 60})
    assert changed.battery == BatteryDescription(60.0, 5.0)


def test_variant_must_keep_the_wheels_that_sensors_sit_on(tmp_path: Path) -> None:
    """Renaming a wheel that carries an inherited sensor is an error, not a dangling link."""
    wheels = [LEFT, {**RIGHT, "name": "R"}]
    encoder = {"type": "Encoder", "name": "ECRight", "link": "RightWheel"}
    with pytest.raises(
        RobotDescriptionError, match="'ECRight' sits on 'RightWheel', which is gone"
    ):
        load_variant(tmp_path, {"wheel": wheels}, sensor=[encoder])
    assert load_variant(tmp_path, {"wheel": wheels, "without": ["ECRight"]}, sensor=[encoder])


def test_mistake_in_the_parent_is_reported_in_the_parent(tmp_path: Path) -> None:
    """The error of an inherited file names that file."""
    with pytest.raises(RobotDescriptionError, match=r"Parent\.toml: kind: 'x'"):
        load_variant(tmp_path, {}, kind="x")


def test_circle_of_variants_is_an_error(tmp_path: Path) -> None:
    """Two files that extend each other are refused instead of recursing."""
    write(tmp_path, "A", {"extends": "B"})
    write(tmp_path, "B", {"extends": "A"})
    with pytest.raises(RobotDescriptionError, match="circle"):
        load_robot(tmp_path / "A.toml")


def test_variant_of_a_shipped_class(tmp_path: Path) -> None:
    """A file outside may extend a shipped class, also the one that it replaces, in any case."""
    path = write(tmp_path, "P3AT", {"extends": "p3at", "drive": {"max_wheel_speed": 8.17}})
    robot = load_robot(path)
    assert (robot.name, robot.model, robot.drive.max_wheel_speed) == ("P3AT", "P3AT", 8.17)
    assert robot.report.wheel_radius == 0.098


def test_missing_file_and_folder(tmp_path: Path) -> None:
    """A path that does not exist is an ordinary error."""
    with pytest.raises(RobotDescriptionError, match="cannot be read"):
        load_robot(tmp_path / "Absent.toml")
    with pytest.raises(RobotDescriptionError, match="no such folder"):
        load_robot(tmp_path / "absent" / "Absent.toml")


PLATFORM: dict[str, Any] = {
    "kind": "static",
    "dialect": "udk",
    "shape": [{**SHAPE, "mass": 100.0}],
    "actuator": [ARM],
}


def test_a_platform_has_neither_wheels_nor_drive(tmp_path: Path) -> None:
    """`static` needs no wheels and stands on its reference point; CONF tells no limits."""
    robot = load_robot(write(tmp_path, "Desk", PLATFORM))
    assert robot.kind == "static"
    assert (robot.wheels, robot.casters, robot.battery, robot.rest_height) == ((), (), None, 0.0)
    assert robot.report.steering_type == "None"
    assert robot.report.mass == pytest.approx(100.4)
    assert robot_model(robot).anchored
    assert not robot_model(load(tmp_path)).anchored


@pytest.mark.parametrize(
    ("key", "value"), [("wheel", [LEFT]), ("caster", []), ("drive", {"max_wheel_speed": 1.0})]
)
def test_a_platform_refuses_wheels(tmp_path: Path, key: str, value: Any) -> None:
    """Wheels of a platform are a mistake, not a decoration."""
    with pytest.raises(RobotDescriptionError, match=f"{key}: stands on a robot without wheels"):
        load_robot(write(tmp_path, "Desk", {**PLATFORM, key: value}))


def test_a_platform_does_not_become_a_vehicle(tmp_path: Path) -> None:
    """Neither may a variant turn a vehicle into a platform."""
    write(tmp_path, "Desk", PLATFORM)
    with pytest.raises(RobotDescriptionError, match="kind: is differential, Desk is static"):
        load_robot(write(tmp_path, "Cart", {"extends": "Desk", "kind": "differential"}))
    low = load_robot(write(tmp_path, "Low", {"extends": "Desk", "rest_height": 0.2}))
    assert low.rest_height == 0.2


def test_costly_lists_are_refused_by_their_entry(tmp_path: Path) -> None:
    """A sensor that reports more often than any world steps (the physics died of the shortest ones,
    dividing by them), more sensors or cameras than any robot has: each is one error with a cure."""
    for interval in (1e-6, 5e-324):
        told = (
            r"\[\[sensor\]\] 1 \(Odo\): interval: .* shorter than any step .*write at least 0\.0005"
        )
        with pytest.raises(RobotDescriptionError, match=told):
            load(tmp_path, sensor=[{**SENSOR, "name": "Odo", "interval": interval}])
    load(tmp_path, sensor=[{**SENSOR, "interval": 0.0005}, {**SENSOR, "name": "B", "interval": 0}])
    many = [{**SENSOR, "name": f"S{number}"} for number in range(MOST_ITEMS + 1)]
    with pytest.raises(RobotDescriptionError, match=r"257 \(S256\): is one more than 256 \(mount"):
        load(tmp_path, sensor=many)
    assert len(load(tmp_path, sensor=many[:-1]).items) == MOST_ITEMS
    eyes = [{"name": f"C{number}"} for number in range(MOST_CAMERAS + 1)]
    with pytest.raises(RobotDescriptionError, match=r"33 \(C32\): is one more than 32 \(mount"):
        load(tmp_path, camera=eyes)
    assert len(load(tmp_path, camera=eyes[:-1]).cameras) == MOST_CAMERAS
