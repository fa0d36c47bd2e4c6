"""Scanners with rows of beams (protocol reference 4.6: RangeScanner3D and 3DRangeScanner)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import (
    UDK,
    UT2004,
    Box,
    FakeRobot,
    Scene,
    make,
    numbers,
    read,
    text_of,
    values,
    wall_ahead,
)

from usarsim_server.errors import RobotDescriptionError
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import conf_line, find_sensors, sen_lines

SMALL = {"fov": 0.2, "resolution": 0.1, "vertical_fov": 0.1, "vertical_resolution": 0.1}


def grid(sensor) -> np.ndarray:
    """The last scan, one row per line."""
    return np.array(numbers(values(sensor, UT2004)["Range"])).reshape(sensor.rows, sensor.columns)


def test_the_default_is_a_published_configuration() -> None:
    """31 rows of 51 beams every 0.4 s, which is what Player's loops over the fields come to."""
    sensor = make("RangeScanner3D")
    assert (sensor.rows, sensor.columns) == (31, 51)
    assert sensor.interval(UT2004) == sensor.interval(UDK) == 0.4
    read(sensor)
    assert len(numbers(values(sensor, UT2004)["Range"])) == 31 * 51


@given(st.integers(1, 40), st.integers(1, 40))
def test_both_end_beams_of_both_axes_are_there(columns: int, rows: int) -> None:
    """A field of n steps has n + 1 beams along either axis."""
    sensor = make(
        "RangeScanner3D",
        fov=0.02 * columns,
        resolution=0.02,
        vertical_fov=0.015 * rows,
        vertical_resolution=0.015,
    )
    (fan,) = sensor.rays(FakeRobot())
    assert (sensor.columns, sensor.rows) == (columns + 1, rows + 1)
    yaw = np.arctan2(-fan.directions[:, 1], fan.directions[:, 0])
    pitch = np.arcsin(fan.directions[:, 2])
    assert yaw.max() == pytest.approx(0.01 * columns)
    assert yaw.min() == pytest.approx(-0.01 * columns)
    assert pitch.max() == pytest.approx(0.0075 * rows)
    assert pitch.min() == pytest.approx(-0.0075 * rows)


def test_rows_run_from_up_to_down_and_from_right_to_left() -> None:
    """A box on the right below is in the last row, at its beginning."""
    sensor = make("RangeScanner3D", **SMALL)
    box = Box((1.0, -0.2, -0.2), (1.1, -0.05, -0.01))
    read(sensor, scene=Scene(box, wall_ahead(3.0)))
    scan = grid(sensor)
    assert scan.shape == (2, 3)
    assert scan[1, 0] == pytest.approx(1.0 / math.cos(0.1) / math.cos(0.05), abs=1e-3)
    assert (np.delete(scan.ravel(), 3) > 2.9).all()


def test_sen_of_both_names_and_both_dialects() -> None:
    """Vertical before horizontal; Time has two digits in ut2004, ranges four or two."""
    line = (
        "SEN {{Time {time}}} {{Type {kind}}} {{Name S}} {{Resolution {res},{res}}} "
        "{{FOV {low},{high}}} {{Range {ranges}}}"
    )
    for kind in ("RangeScanner3D", "3DRangeScanner"):
        sensor = make(kind, "S", **SMALL, max_range=5.0)
        read(sensor, scene=Scene(Box((2.0, -1.0, -1.0), (3.0, 0.1, 1.0))))
        assert sen_lines([sensor], 63.4021, UT2004) == [
            line.format(
                time="63.40",
                kind=kind,
                res="0.1000",
                low="0.1000",
                high="0.2000",
                ranges="2.0125,2.0025,5.0000,2.0125,2.0025,5.0000",
            )
        ]
        assert sen_lines([sensor], 63.4021, UDK) == [
            line.format(
                time="63.4021",
                kind=kind,
                res="0.0999",
                low="0.0999",
                high="0.1999",
                ranges="2.01,2.00,5.00,2.01,2.00,5.00",
            )
        ]


def test_conf_has_the_keys_that_player_reads() -> None:
    """Resolution and FOV in capitals, each vertical before horizontal."""
    sensor = make("RangeScanner3D", "S", **SMALL)
    assert conf_line([sensor], "RangeScanner3d", "S", UT2004) == (
        "CONF {Type RangeScanner3D} {Name S} {MaxRange 20.0000} {MinRange 0.1000} "
        "{Resolution 0.1000,0.1000} {FOV 0.1000,0.2000}"
    )


@pytest.mark.parametrize("kind", ["RangeScanner3D", "3DRangeScanner"])
def test_requests_may_spell_either_name(kind: str) -> None:
    """Player asks for RangeScanner3d whatever the lines of the scanner say."""
    sensor = make(kind, "S")
    for asked in ("RangeScanner3d", "3DRangeScanner", "3drangescanner"):
        assert find_sensors([sensor], asked, "S") == [sensor]
    assert find_sensors([sensor], "RangeScanner", "S") == []


def test_a_miss_prints_the_maximum_range() -> None:
    """As every range sensor does (protocol checklist 105)."""
    sensor = make("RangeScanner3D", **SMALL, max_range=8.0)
    read(sensor)
    assert set(values(sensor, UT2004)["Range"].split(",")) == {"8.0000"}


def test_scan_asks_for_an_immediate_report() -> None:
    """SET SCAN measures now."""
    sensor = make("RangeScanner3D")
    assert sensor.set("SCAN", "", FakeRobot()) is SetResult.SCAN
    assert sensor.set("RESET", "", FakeRobot()) is SetResult.UNKNOWN


def test_large_scans_print_two_digits() -> None:
    """Protocol reference 5.2 number 14: more than 240 beams."""
    sensor = make("RangeScanner3D")
    read(sensor, scene=Scene(wall_ahead(3.0)))
    assert values(sensor, UT2004)["Range"].startswith("3.5")
    assert len(values(sensor, UT2004)["Range"].split(",")[0]) == 4


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"resolution": 0.0001, "vertical_resolution": 0.0001}, "resolution"),
        ({"vertical_fov": 25}, "vertical_fov"),
        ({"vertical_resolution": 1.0}, "vertical_resolution"),
    ],
)
def test_impossible_scans_are_refused(options: dict[str, object], key: str) -> None:
    """Degrees, steps wider than the field, and scans that nobody can take."""
    with pytest.raises(RobotDescriptionError, match=f"{key}: "):
        make("RangeScanner3D", **options)


def test_the_text_has_no_more_beams_than_the_printed_numbers_say() -> None:
    """Protocol reference 5.2 number 15, for both axes."""
    sensor = make("RangeScanner3D")
    for dialect in (UT2004, UDK):
        head = dict(sensor.configuration(dialect))
        steps = [
            float(field) / float(step)
            for field, step in zip(
                head["FOV"].split(","), head["Resolution"].split(","), strict=True
            )
        ]
        assert sensor.rows <= math.floor(steps[0] + 1e-6) + 1
        assert sensor.columns <= math.floor(steps[1] + 1e-6) + 1
    assert "{MaxRange" in text_of(sensor.configuration(UDK))
