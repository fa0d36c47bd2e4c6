"""Laser range finders in a plane and in rows (robots reference 2.3, 69 to 75; protocol
102 to 106; protocol reference 4.6: RangeScanner3D and 3DRangeScanner).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_fakes import (
    UDK,
    UT2004,
    Box,
    FakeRobot,
    Pole,
    Scene,
    make,
    numbers,
    read,
    text_of,
    values,
    wall_ahead,
)

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import conf_line, find_sensors, sen_lines
from usarsim_server.sensors.scanners import beam_count
from usarsim_server.sensors.sonar import Sonar

ROOM = Scene(Box((-50, -3, -50), (50, -2, 50)), Box((-50, 4, -50), (50, 5, 50)), wall_ahead(6.0))


@pytest.mark.parametrize(
    ("kind", "beams"), [("SICK", 181), ("Hokuyo", 228), ("RangeScanner", 21), ("IRScanner", 37)]
)
def test_the_number_of_readings(kind: str, beams: int) -> None:
    """Robots 69 and protocol 103, in both dialects."""
    sensor = make(kind)
    read(sensor, scene=ROOM)
    for dialect in (UT2004, UDK):
        assert len(numbers(values(sensor, dialect)["Range"])) == beams


@given(st.floats(0.1, 7.0), st.floats(1e-4, 0.5))
def test_the_count_never_exceeds_what_clients_allocate(fov: float, resolution: float) -> None:
    """Protocol 103: at most round(printed FOV / printed Resolution) + 1."""
    if resolution > fov:
        return
    scanner = make("RangeScanner", fov=fov, resolution=resolution)
    count = beam_count(fov, resolution)
    assert scanner.beams == count >= 1
    for dialect in (UT2004, UDK):
        head = dict(scanner.data(dialect)[:2])
        if float(head["Resolution"]) > 0.0:
            assert count <= round(float(head["FOV"]) / float(head["Resolution"])) + 1


@given(st.integers(1, 720), st.floats(0.25, 2.0))
def test_whole_steps_include_both_ends(steps: int, degrees: float) -> None:
    """A field of view of n resolutions has n + 1 beams, whatever binary fractions do."""
    resolution = round(math.radians(degrees), 4)
    if steps * resolution <= 7.0:
        assert beam_count(steps * resolution, resolution) == steps + 1
        assert beam_count(steps * resolution, resolution, last_beam=False) == steps


def test_the_scan_runs_from_right_to_left() -> None:
    """Robots 70: the first value is the right-hand beam, the last the left-hand one."""
    sensor = make("SICK")
    read(sensor, scene=ROOM)
    ranges = numbers(values(sensor)["Range"])
    assert ranges[0] == 2.0
    assert ranges[-1] == 4.0
    assert ranges[90] == 6.0


def test_an_obstacle_on_the_right_is_in_the_first_half() -> None:
    """Protocol 104."""
    sensor = make("SICK")
    read(sensor, scene=Scene(Pole(3.0, -1.0, 0.1)))
    ranges = numbers(values(sensor, UT2004)["Range"])
    nearest = min(range(len(ranges)), key=ranges.__getitem__)
    assert ranges[nearest] == pytest.approx(math.hypot(3.0, 1.0) - 0.1, abs=0.01)
    assert nearest == 90 - 18


def test_beam_angles_follow_the_announced_resolution() -> None:
    """Beam i points to FOV/2 - i x Resolution of wire yaw (robots reference 2.3)."""
    sensor = make("Hokuyo")
    (fan,) = sensor.rays(FakeRobot())
    yaw = np.arctan2(-fan.directions[:, 1], fan.directions[:, 0])
    expected = 4.189 / 2 - 0.0184086914 * np.arange(228)
    assert np.allclose(yaw, expected)
    assert np.allclose(fan.directions[:, 2], 0.0)


@pytest.mark.parametrize(
    ("kind", "udk", "ut2004"),
    [
        ("SICK", "20.00", "20.0000"),
        ("RangeScanner3D", "20.00", "20.00"),
        ("Hokuyo", "4.00", "4.0000"),
        ("RangeScanner", "4.00", "4.0000"),
    ],
)
def test_a_miss_prints_the_maximum_range(kind: str, udk: str, ut2004: str) -> None:
    """Robots 71 and protocol 105."""
    sensor = make(kind)
    read(sensor, scene=Scene())
    assert set(values(sensor, UDK)["Range"].split(",")) == {udk}
    assert set(values(sensor, UT2004)["Range"].split(",")) == {ut2004}


def test_the_minimum_range_is_applied_only_on_request() -> None:
    """Robots 72: 0.03 m reads 0.03, and is a miss with the strict option."""
    plain, strict = make("SICK"), make("SICK", strict_min_range=True)
    scene = Scene(wall_ahead(0.03))
    read(plain, scene=scene)
    read(strict, scene=scene)
    assert values(plain)["Range"].split(",")[90] == "0.03"
    assert values(strict)["Range"].split(",")[90] == "20.00"


@pytest.mark.parametrize(
    ("distance", "text"), [(1.999, "1.99"), (2.0, "2.00"), (0.0099, "0.00"), (19.9951, "19.99")]
)
def test_values_have_two_truncated_digits(distance: float, text: str) -> None:
    """Robots 74: 1.999 prints 1.99."""
    sensor = make("SICK")
    read(sensor, scene=Scene(wall_ahead(distance)))
    assert values(sensor)["Range"].split(",")[90] == text


def test_conf_of_both_dialects() -> None:
    """Robots 75, protocol 136: exact case, UT2004's spelling of Paning."""
    sick = make("SICK")
    assert text_of(sick.configuration(UT2004)) == (
        "{MaxRange 20.0000} {MinRange 0.1000} {Resolution 0.0174} {Fov 3.1415} "
        "{Paning True} {Tilting False}"
    )
    assert text_of(sick.configuration(UDK)) == (
        "{MaxRange 20.0000} {MinRange 0.1000} {Resolution 0.0174} {Fov 3.1414} "
        "{Panning True} {Tilting False}"
    )


def test_sen_of_both_dialects() -> None:
    """The templates of protocol reference 4.6: five beams, four digits and two."""
    sensor = make("RangeScanner", "Scanner1", fov=3.14159, resolution=0.7853975, max_range=20.0)
    read(sensor, scene=Scene(wall_ahead(2.0), Box((-9, -3, -9), (9, -2.5, 9))))
    assert sen_lines([sensor], 63.4021, UT2004) == [
        "SEN {Time 63.40} {Type RangeScanner} {Name Scanner1} {Resolution 0.7853} {FOV 3.1415} "
        "{Range 2.5000,2.8284,2.0000,2.8284,20.0000}"
    ]
    assert sen_lines([sensor], 63.4021, UDK) == [
        "SEN {Time 63.4021} {Type RangeScanner} {Name Scanner1} {Resolution 0.7853} {FOV 3.1414} "
        "{Range 2.50,2.82,2.00,2.82,20.00}"
    ]


def test_range_is_the_last_segment() -> None:
    """Protocol 102: Resolution, FOV, Range."""
    for dialect in (UT2004, UDK):
        keys = [key for key, _ in make("SICK").data(dialect)]
        assert keys == ["Resolution", "FOV", "Range"]


@pytest.mark.parametrize(
    "options",
    [
        {"kind": "SICK"},
        {"kind": "SICK", "max_range": 80.0},
        {"kind": "Hokuyo"},
        {"kind": "RangeScanner", "fov": 2.39, "resolution": 0.01, "max_range": 500.0},
    ],
)
def test_ut2004_lines_fit_old_line_buffers(options: dict[str, object]) -> None:
    """Protocol 106 and 5.2 number 14: below 2000 bytes, even when nothing is near."""
    sensor = make(name="AScannerWithALongName", **options)
    read(sensor, scene=Scene())
    (line,) = sen_lines([sensor], 123456.78, UT2004)
    assert len(line) < 2000


def test_more_than_240_beams_print_two_digits_in_both_dialects() -> None:
    """Protocol reference 5.2 number 14."""
    sensor = make("RangeScanner", fov=3.0, resolution=0.0125)
    read(sensor, scene=Scene())
    assert sensor.beams == 241
    assert values(sensor, UT2004)["Range"].startswith("4.00,")


def test_a_nodding_scanner_sweeps_from_up_to_down() -> None:
    """In pitch the first beam looks up; CONF says Tilting."""
    sensor = make("RangeScanner", sweep="pitch")
    (fan,) = sensor.rays(FakeRobot())
    assert fan.directions[0, 2] > 0.99
    assert fan.directions[-1, 2] < -0.99
    assert np.allclose(fan.directions[:, 1], 0.0)
    assert text_of(sensor.configuration(UDK)[-2:]) == "{Panning False} {Tilting True}"


@pytest.mark.parametrize("kind", ["SICK", "RangeScanner3D"])
def test_scan_asks_for_an_immediate_report(kind: str) -> None:
    """SET SCAN measures now; other opcodes are unknown."""
    sensor = make(kind)
    assert sensor.set("SCAN", "", FakeRobot()) is SetResult.SCAN
    assert sensor.set("RESET", "", FakeRobot()) is SetResult.UNKNOWN


def test_an_interval_of_zero_reports_on_scan_only() -> None:
    """Protocol 121: the scheduler sees 0."""
    assert make("SICK", interval=0.0).interval(UDK) == 0.0


@pytest.mark.parametrize(
    ("kind", "ut2004", "udk"),
    [("SICK", 0.2, 0.2), ("RangeScanner", 0.2, 0.2), ("Hokuyo", 0.2, 0.3), ("IRScanner", 0.2, 0.1)],
)
def test_intervals_are_those_of_the_class(kind: str, ut2004: float, udk: float) -> None:
    """Protocol appendix C: 0.2 s in UT2004."""
    sensor = make(kind)
    assert (sensor.interval(UT2004), sensor.interval(UDK)) == (ut2004, udk)


def test_noise_is_optional_and_leaves_misses_alone() -> None:
    """The larger of an absolute and a relative deviation, echoes only."""
    sensor = make("SICK", noise=0.01, noise_ratio=0.01)
    near, far = [], []
    for _ in range(300):
        read(sensor, scene=Scene(Box((2.0, -1, -1), (3.0, 1, 1))))
        ranges = sensor._ranges
        near.append(ranges[90])
        far.append(ranges[0])
    assert set(far) == {20.0}
    assert np.std(near) == pytest.approx(0.02, rel=0.15)
    assert np.mean(near) == pytest.approx(2.0, abs=0.005)


def test_the_infrared_scanner_sees_through_glass_and_keeps_both_limits() -> None:
    """Robots reference 2.3: passes glass, 0.2 to 10 m; the form is the scanner's."""
    sensor = make("IRScanner")
    read(sensor, scene=Scene(wall_ahead(1.0, glass=True), wall_ahead(0.05)))
    ranges = numbers(values(sensor)["Range"])
    assert ranges[18] == 0.2
    assert ranges[0] == 10.0
    assert sensor.wire_type == "IRScanner"


@pytest.mark.parametrize(
    ("kind", "options", "key"),
    [
        ("SICK", {"resolution": 0.0}, "resolution"),
        ("SICK", {"resolution": 1e-320}, "resolution"),
        ("SICK", {"fov": 1.0, "resolution": 1.5}, "resolution"),
        ("SICK", {"fov": 180}, "fov"),
        ("SICK", {"sweep": "roll"}, "sweep"),
        ("RangeScanner3D", {"resolution": 1e-4, "vertical_resolution": 1e-4}, "resolution"),
        ("RangeScanner3D", {"vertical_fov": 25}, "vertical_fov"),
        ("RangeScanner3D", {"vertical_resolution": 1.0}, "vertical_resolution"),
    ],
)
def test_impossible_scans_are_refused(kind: str, options: dict[str, object], key: str) -> None:
    """Degrees instead of radians, steps of none or wider than the field, scans too large."""
    with pytest.raises(RobotDescriptionError, match=f"{key}: "):
        make(kind, **options)


@settings(max_examples=40)
@given(st.floats(0.05, 30.0), st.floats(-3.0, 3.0), st.floats(-0.3, 0.3))
def test_every_value_is_between_zero_and_the_maximum(
    distance: float, yaw: float, pitch: float
) -> None:
    """No infinity, no negative number reaches the wire, with noise and without."""
    robot = FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, pitch, yaw))
    sensor = make("SICK", noise=0.5)
    read(sensor, robot, Scene(wall_ahead(distance)))
    for dialect in (UT2004, UDK):
        assert all(0.0 <= value <= 20.0 for value in numbers(values(sensor, dialect)["Range"]))


def test_a_scanner_is_no_sonar() -> None:
    """Scanners report one line per instance in both dialects (protocol reference 4.5)."""
    assert not make("SICK").batched
    assert UT2004 in Sonar.batched


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
        assert find_sensors([sensor], asked, "S", Dialect.UDK) == [sensor]
    assert find_sensors([sensor], "RangeScanner", "S", Dialect.UDK) == []


def test_large_scans_print_two_digits() -> None:
    """Protocol reference 5.2 number 14: more than 240 beams."""
    sensor = make("RangeScanner3D")
    read(sensor, scene=Scene(wall_ahead(3.0)))
    assert values(sensor, UT2004)["Range"].startswith("3.5")
    assert len(values(sensor, UT2004)["Range"].split(",")[0]) == 4


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


def test_scanners_alike_share_their_directions() -> None:
    """So those of a team are kept once; those of others stay their own."""
    one, other, finer = make("SICK", "a"), make("SICK", "b"), make("SICK", "c", resolution=0.01)
    assert one._directions is other._directions
    assert len(finer._directions) > len(one._directions)
