"""Robot files of cars: how wheels find their steering joints, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from machine_fakes import Driver, angles_of
from robot_files import write

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.steered import SteeredFamily

KNUCKLE: dict[str, Any] = {
    "parent": 0,
    "axis": [0, 0, 1],
    "limits": [-0.5, 0.5],
    "shape": [{"kind": "sphere", "size": [0.02], "mass": 0.2}],
}


def cart(folder: Path, joint: str = "FrontSteer", **changes: Any) -> RobotDescription:
    """A small car whose front wheels sit on knuckles."""
    wheel = {"radius": 0.1, "width": 0.04, "mass": 0.5, "position": [0, 0, 0]}
    links = [
        {**KNUCKLE, "name": f"{side}{joint}", "position": [0.2, y, 0]}
        for side, y in (("L", -0.15), ("R", 0.15))
    ]
    robot: dict[str, Any] = {
        "kind": "ackerman",
        "dialect": "ut2004",
        "shape": [{"kind": "box", "size": [0.4, 0.2, 0.1], "mass": 5.0}],
        "actuator": [{"name": "Axle", "package": False, "link": links}],
        "wheel": [
            {**wheel, "name": "FL", "link": f"L{joint}", "side": "left"},
            {**wheel, "name": "FR", "link": f"R{joint}", "side": "right"},
            {**wheel, "name": "BL", "position": [-0.2, -0.15, 0]},
            {**wheel, "name": "BR", "position": [-0.2, 0.15, 0]},
        ],
        "drive": {"max_wheel_speed": 5.0},
    }
    robot.update(changes)
    return load_robot(write(folder, "Cart", robot))


def test_a_car_is_read(tmp_path: Path) -> None:
    """Which joint steers which wheel, and which way, follows from names and axes."""
    robot = cart(tmp_path)
    family = robot.family
    assert isinstance(family, SteeredFamily)
    assert not family.literal
    assert [wheel.joint for wheel in family.wheels] == ["LFrontSteer", "RFrontSteer", None, None]
    assert {wheel.front for wheel in family.wheels[:2]} == {True}
    # An axis downwards: positive positions turn to the right.
    assert {wheel.sense for wheel in family.wheels[:2]} == {-1.0}
    assert robot.report.wheel_base == pytest.approx(0.4)
    assert robot.report.max_front_steer == 1.0
    assert not robot.family.wheel_sensors


def test_axes_may_point_up_or_down(tmp_path: Path) -> None:
    """The wire's positive angle is to the right whichever way the axis points."""
    up = [
        {**KNUCKLE, "axis": [0, 0, -1], "name": f"{side}RearSteer", "position": [-0.2, y, 0]}
        for side, y in (("L", -0.15), ("R", 0.15))
    ]
    wheel = {"radius": 0.1, "width": 0.04, "mass": 0.5, "position": [0, 0, 0]}
    wheels = [
        {**wheel, "name": "BL", "link": "LRearSteer", "side": "left"},
        {**wheel, "name": "BR", "link": "RRearSteer", "side": "right"},
        {**wheel, "name": "FL", "position": [0.2, -0.15, 0]},
        {**wheel, "name": "FR", "position": [0.2, 0.15, 0]},
    ]
    robot = cart(tmp_path, actuator=[{"name": "Axle", "package": False, "link": up}], wheel=wheels)
    driver = Driver(robot)
    driver.send(rear_steer=0.2)
    assert all(position < 0.0 for position in driver.machine.positions.values())
    assert all(angle > 0.0 for angle in angles_of(driver).values())


def test_literal_is_inherited(tmp_path: Path) -> None:
    """`[steering] literal = true` brings back the original's rule, also for variants."""
    cart(tmp_path, steering={"literal": True})
    robot = load_robot(write(tmp_path, "Variant", {"extends": "Cart"}))
    assert isinstance(robot.family, SteeredFamily)
    assert robot.family.literal
    assert robot.model == "Cart"
    back = load_robot(write(tmp_path, "Back", {"extends": "Cart", "steering": {"literal": False}}))
    assert isinstance(back.family, SteeredFamily)
    assert not back.family.literal
    assert back.model == "Back"


@pytest.mark.parametrize(
    ("joint", "changes", "error"),
    [
        ("Turn", {}, "the joint 'LTurn' steers neither axle"),
        ("FrontSteer", {"steering": {"literally": True}}, "literally: unknown key"),
        ("FrontSteer", {"steering": {"literal": 1}}, "literal: 1 is not true or false"),
        ("FrontSteer", {"kind": "skid_steer", "steering": {}}, "steering: unknown key"),
    ],
)
def test_mistakes(tmp_path: Path, joint: str, changes: dict[str, Any], error: str) -> None:
    """Joints of other names and unknown keys are one clear error."""
    with pytest.raises(RobotDescriptionError, match=error) as caught:
        cart(tmp_path, joint, **changes)
    assert "Cart.toml" in str(caught.value)


def test_a_car_without_steering_is_refused(tmp_path: Path) -> None:
    """A car whose wheels all sit on the chassis says so at once."""
    wheel = {"radius": 0.1, "width": 0.04, "mass": 0.5}
    wheels = [
        {**wheel, "name": "L", "position": [0, -0.2, 0]},
        {**wheel, "name": "R", "position": [0, 0.2, 0]},
    ]
    with pytest.raises(RobotDescriptionError, match="no wheel is steered"):
        cart(tmp_path, wheel=wheels)
