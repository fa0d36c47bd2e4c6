"""Inertial navigation unit (protocol reference 4.5, 4.6: INU)."""

from __future__ import annotations

import math

import pytest
from sensor_fakes import UDK, UT2004, FakeRobot, make, numbers, read, values

from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import conf_line, sen_lines

TURN = math.radians(18.0)


def turned(sensor, steps: int) -> FakeRobot:
    """Stand still for two readings, then turn right on the spot."""
    robot = FakeRobot()
    robot.place((3.0, 4.0, 0.0), (0.0, 0.01, 1.57))
    read(sensor, robot)
    for step in range(steps + 1):
        robot.time += 0.2
        robot.place((3.0, 4.0, 0.0), (0.0, 0.01, 1.57 + step * TURN))
        read(sensor, robot)
    return robot


@pytest.mark.parametrize("dialect", [UT2004, UDK])
def test_sen_is_orientation_without_time(dialect) -> None:
    """The template of protocol reference 4.6."""
    sensor = make("INU", "INU")
    turned(sensor, 0)
    assert sen_lines([sensor], 5.0, dialect) == [
        "SEN {Type INU} {Name INU} {Orientation 0.00,0.01,1.57}"
    ]


def test_angles_are_whole_turns() -> None:
    """Like those of the INS they are within [0, 2 pi)."""
    sensor, robot = make("INU", sigma=0.0, drifting=False), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (-0.1, -0.2, -0.3))
    read(sensor, robot)
    expected = [math.tau - 0.1, math.tau - 0.2, math.tau - 0.3]
    assert numbers(values(sensor, UT2004)["Orientation"]) == pytest.approx(expected, abs=0.01)


def test_it_drifts_as_the_ins_does() -> None:
    """Equal seeds give the angles of an INS: about 4 degrees off after a turn (checklist 87)."""
    inu, ins = make("INU", seed=7), make("INS", seed=7)
    turned(inu, 20)
    turned(ins, 20)
    assert values(inu)["Orientation"] == values(ins)["Orientation"]
    yaw = numbers(values(inu)["Orientation"])[2]
    assert 0.001 < abs(yaw - 1.57) < 0.3


def test_there_is_nothing_to_set_and_nothing_to_configure() -> None:
    """POSE is unknown; CONF has the name only (protocol reference 4.8, all others)."""
    sensor = make("INU", "INU")
    turned(sensor, 0)
    before = sensor.data(UT2004)
    assert sensor.set("POSE", "0,0,0,1,1,1", FakeRobot()) is SetResult.UNKNOWN
    assert sensor.data(UT2004) == before
    assert conf_line([sensor], "INU", None, UT2004) == "CONF {Type INU} {Name INU}"
