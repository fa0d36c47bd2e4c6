"""The helper of the soccer robots (protocol reference 4.5, protocol checklist 55)."""

from __future__ import annotations

from typing import Any

import pytest
from sensor_fakes import UDK, UT2004, FakeRobot, Scene, make, read, wall_ahead

from usarsim_server.errors import RobotDescriptionError
from usarsim_server.sensors.report import sen_lines
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.objects import ObjectFacts


def helper(x: float = 3.0, y: float = -1.0, **rest: Any) -> Any:
    """A helper in a world with a ball 0.1 m above the ground."""

    def find(name: str, snapshot: object) -> ObjectFacts | None:
        pose = Pose((x, y, 0.1))
        return ObjectFacts("ball", pose, None, (0.2, 0.2, 0.2)) if name == "ball" else None

    return make("Helper", "Helper", objects=find, **rest)


def test_the_form_of_the_line() -> None:
    """Pos3D in the world, two digits; Visible in lower case; no Time in ut2004."""
    sensor = helper()
    assert read(sensor)
    data = "{Type Helper} {Name Helper} {Pos3D 3.00,1.00,-0.10} {Visible true}"
    assert sen_lines([sensor], 5.0, UT2004) == [f"SEN {data}"]
    assert sen_lines([sensor], 5.0, UDK) == [f"SEN {{Time 5.0000}} {data}"]


def test_the_place_does_not_depend_on_the_robot() -> None:
    """Wherever the robot is and looks, the ball lies at the same place of the field."""
    sensor, robot = helper(), FakeRobot()
    robot.place((-7.0, 2.0, 0.0), (0.0, 0.0, 2.0))
    read(sensor, robot)
    assert dict(sensor.data(UT2004))["Pos3D"] == "3.00,1.00,-0.10"


@pytest.mark.parametrize(
    ("rest", "scene", "visible"),
    [
        ({}, Scene(wall_ahead(5.0)), "true"),
        ({}, Scene(wall_ahead(2.0)), "false"),
        ({}, Scene(wall_ahead(2.9)), "true"),
        ({"max_range": 3.0}, Scene(), "false"),
        ({"fov": 0.5}, Scene(), "false"),
        ({"fov": 0.8}, Scene(), "true"),
    ],
)
def test_walls_range_and_view_hide_the_ball(rest: Any, scene: Scene, visible: str) -> None:
    """The ball is visible only in range, in the field of view and in plain sight."""
    sensor = helper(**rest)
    assert read(sensor, scene=scene)
    assert dict(sensor.data(UT2004))["Visible"] == visible


def test_a_world_without_a_ball_is_silent() -> None:
    """No line, also if the ball that the robot file names does not exist."""
    assert not read(make("Helper"))
    assert not read(helper(object="football"))
    assert read(helper(object="ball"))


def test_the_object_has_to_be_a_name() -> None:
    """A number is refused with the cure."""
    with pytest.raises(RobotDescriptionError, match="object: 3 is not text"):
        helper(object=3)
