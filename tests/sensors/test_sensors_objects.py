"""Object recognition and the helper of the soccer robots (robots reference 2.9; protocol reference
4.5, 4.6: ObjectSensor; protocol 55).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import UDK, UT2004, Box, FakeRobot, Pole, Scene, make, numbers, read, wall_ahead

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import conf_line, sen_lines
from usarsim_server.simulation.frames import Pose, pose_from_wire
from usarsim_server.simulation.objects import ObjectFacts

BOX = ObjectFacts(
    "Box3", pose_from_wire((3.1, 0.2, -0.15), (0.0, 0.0, 0.785)), "M_Wood", (0.4, 0.4, 0.3)
)
WALL = ObjectFacts("Wall", pose_from_wire((5.0, 0.0, 0.0)), None, (1.0, 9.0, 9.0))
ROBOT = ObjectFacts("Rover", Pose(), None, (1.0, 1.0, 1.0), robot=4)
KNOWN = {"box:1": BOX, "box:2": BOX, "wall": WALL, "robot0:base": ROBOT}


class Register:
    """Facts by name, and what was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, Any]] = []

    def __call__(self, name: str, snapshot: Any) -> ObjectFacts | None:
        self.asked.append((name, snapshot))
        return KNOWN.get(name)


def eye(**options: Any) -> Any:
    return make("ObjectSensor", "Vision1", objects=Register(), **options)


def seen(sensor: Any) -> list[dict[str, str]]:
    """Segments of the last reading, one entry per object."""
    segments = sensor.data(UDK)
    assert [key for key, _ in segments[:5]] in (
        [],
        ["Object", "Location", "Orientation", "HitLoc", "Material"],
    )
    return [dict(segments[i : i + 5]) for i in range(0, len(segments), 5)]


SCENE = Scene(
    Box((2.9, -0.11, -1.0), (3.3, 0.09, 1.0), name="box:1"),
    Box((4.98, -9.0, -9.0), (6.0, 9.0, 9.0), name="wall"),
)


def test_sen_of_both_dialects() -> None:
    """The template of protocol 4.6: no Time, one blank between segments, five segments per
    object."""
    sensor = eye(location=(0.0, 0.0, -0.2), rotation=(0.0, 0.0, 0.03))
    read(sensor, scene=SCENE)
    # Beam 0 meets the wall 4.98 tan 0.117 = 0.585 to the right, beam 5 the box 0.093 m.
    for dialect in (UT2004, UDK):
        assert sen_lines([sensor], 5.0, dialect) == [
            "SEN {Type ObjectSensor} {Name Vision1} "
            "{Object Wall} {Location 5.00,0.00,0.00} {Orientation 0.00,0.00,0.00} "
            "{HitLoc 4.98,0.58,-0.20} {Material None} "
            "{Object Box3} {Location 3.10,0.20,-0.15} {Orientation 0.00,0.00,0.78} "
            "{HitLoc 2.90,0.09,-0.20} {Material M_Wood}"
        ]


def test_every_object_is_listed_once_in_the_order_from_right_to_left() -> None:
    """A wall left and right of a box is one wall; the first beam that met it gives HitLoc."""
    sensor = eye(fov=0.6)
    read(sensor, scene=SCENE)
    assert [entry["Object"] for entry in seen(sensor)] == ["Wall", "Box3"]
    x, y, _ = numbers(seen(sensor)[0]["HitLoc"])
    assert (x, y) == pytest.approx((4.98, 4.98 * math.tan(0.3)), abs=0.02)


def test_pieces_of_one_body_are_one_object() -> None:
    """Two geoms with facts of one name are listed as one."""
    sensor = eye()
    left, right = Pole(3.0, 0.1, 0.1, name="box:1"), Pole(3.0, -0.1, 0.1, name="box:2")
    read(sensor, scene=Scene(left, right))
    assert [entry["Object"] for entry in seen(sensor)] == ["Box3"]


def test_a_robot_and_a_thing_of_the_same_name_are_two() -> None:
    """Names of robots are the users' own."""
    register = {"a": ROBOT, "b": ObjectFacts("Rover", Pose(), None, (1.0, 1.0, 1.0))}
    sensor = make("ObjectSensor", objects=lambda name, snapshot: register[name])
    read(sensor, scene=Scene(Pole(3.0, -0.2, 0.1, name="a"), Pole(3.0, 0.2, 0.1, name="b")))
    assert len(seen(sensor)) == 2


def test_what_is_nameless_or_gone_is_not_listed() -> None:
    """No name in the scene, no facts: nothing to say, and the line stays well-formed."""
    sensor = eye()
    for solid in (wall_ahead(2.0), wall_ahead(2.0, name="unheard of")):
        assert read(sensor, scene=Scene(solid))
        assert sen_lines([sensor], 5.0, UDK) == ["SEN {Type ObjectSensor} {Name Vision1}"]


def test_nothing_in_sight_is_a_line_with_the_name_only() -> None:
    """And what was seen before is forgotten."""
    sensor = eye()
    read(sensor, scene=SCENE)
    assert read(sensor)
    assert sensor.data(UDK) == ()


def test_facts_are_asked_for_the_instant_of_the_reading() -> None:
    """Objects move; the look-up gets the robot's snapshot."""
    register = Register()
    sensor = make("ObjectSensor", objects=register)
    robot = FakeRobot(snapshot="this instant")
    read(sensor, robot, SCENE)
    assert {asked for _, asked in register.asked} == {"this instant"}


def test_the_fan_is_that_of_the_original() -> None:
    """11 beams over 10 degrees to both sides of the axis, 1000 m, asked to be identified."""
    sensor = eye()
    (fan,) = sensor.rays(FakeRobot())
    yaw = np.arctan2(-fan.directions[:, 1], fan.directions[:, 0])
    assert np.allclose(yaw, 0.087 - 0.017 * np.arange(11))
    assert fan.identify
    assert fan.max_range == 1000.0
    assert sensor.interval(UT2004) == sensor.interval(UDK) == 0.5


@given(
    st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2)),
    st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
)
def test_hit_points_are_in_the_world_frame(place, turn) -> None:
    """Wherever the sensor is and looks, HitLoc lies on the wall it names."""
    sensor, robot = eye(location=(0.1, 0.0, -0.2)), FakeRobot()
    robot.place(place, turn)
    read(sensor, robot, Scene(wall_ahead(5.0, name="wall")))
    x, y, z = numbers(seen(sensor)[0]["HitLoc"])
    assert x == pytest.approx(5.0, abs=0.011)
    first = sensor.rays(robot)[0]
    way = first.directions[0] * (5.0 - first.origin[0]) / first.directions[0, 0]
    assert (y, z) == pytest.approx((-(first.origin + way)[1], -(first.origin + way)[2]), abs=0.011)


def test_names_and_materials_are_single_words() -> None:
    """Clients read up to the next blank, comma or brace."""
    odd = ObjectFacts("old {oak} door", Pose(), "very old wood", (1.0, 1.0, 1.0))
    sensor = make("ObjectSensor", objects=lambda name, snapshot: odd)
    read(sensor, scene=Scene(wall_ahead(2.0, name="door")))
    (entry,) = seen(sensor)
    assert (entry["Object"], entry["Material"]) == ("old_(oak)_door", "very_old_wood")


def test_without_a_world_around_it_nothing_is_known() -> None:
    """A context without a look-up gives an empty list, not an error."""
    sensor = make("ObjectSensor")
    assert read(sensor, scene=SCENE)
    assert sensor.data(UDK) == ()


def test_scan_and_conf() -> None:
    """SCAN reports at once; CONF has the name only (protocol reference 4.8, all others)."""
    sensor = eye()
    assert sensor.set("SCAN", "", FakeRobot()) is SetResult.SCAN
    assert sensor.set("OPEN", "", FakeRobot()) is SetResult.UNKNOWN
    assert conf_line([sensor], "objectsensor", None, UDK) == (
        "CONF {Type ObjectSensor} {Name Vision1}"
    )


@pytest.mark.parametrize(
    ("options", "key"),
    [({"fov": 10}, "fov"), ({"resolution": 0.5}, "resolution"), ({"max_range": 0}, "max_range")],
)
def test_impossible_fans_are_refused(options: dict[str, object], key: str) -> None:
    """The message names the key."""
    with pytest.raises(RobotDescriptionError, match=f"{key}: "):
        eye(**options)


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
