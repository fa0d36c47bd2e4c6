"""SEN, GEO and CONF of sensors (protocol reference 4.5, 4.7, 4.8, 6.7 and 6.8)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usarsim_server.protocol.dialects import range_digits
from usarsim_server.protocol.messages import (
    SensorMount,
    configuration,
    encode,
    reading_line,
    sensor_geometry,
    sensor_line,
)
from usarsim_server.protocol.numbers import fixed, ranges
from usarsim_server.protocol.values import Dialect, Item

UT2004, UDK = Dialect.UT2004, Dialect.UDK
HALF_PI = math.pi / 2


def sonar(name: str, distance: float) -> Item:
    return Item(name, (("Range", fixed(distance, 4)),))


def scan(dialect: Dialect, beams: int, distance: float) -> Item:
    text = ranges(np.full(beams, distance), range_digits(dialect, beams))
    return Item("Scanner1", (("Resolution", "0.0174"), ("FOV", "3.1415"), ("Range", text)))


@pytest.mark.parametrize("time", [None, 63.4021])
@pytest.mark.parametrize("item", [sonar("F1", 1.5), Item("", (("Status", "{no}"), ("Empty", "")))])
def test_a_reading_alone_is_a_line_of_one_item(item: Item, time: float | None) -> None:
    """Whichever way it is written; an item without name has no Name segment."""
    for digits in (2, 4):
        told = reading_line("Sonar", item, time, digits)
        assert told == sensor_line(UDK, "Sonar", [item], time, digits)


def test_a_single_sensor_with_time() -> None:
    """Protocol 94, 95, 98: Time first, then Type, Name and one segment per datum."""
    assert sensor_line(UDK, "Sonar", [sonar("LeftSonar", 1.982)], 63.4021) == (
        "SEN {Time 63.4021} {Type Sonar} {Name LeftSonar} {Range 1.9820}"
    )


def test_a_single_sensor_without_time() -> None:
    """Protocol 96, 113: types without Time begin with Type."""
    item = Item("Odometry", (("Pose", "1.2044,-0.0310,6.2518"),))
    assert sensor_line(UT2004, "Odometry", [item]) == (
        "SEN {Type Odometry} {Name Odometry} {Pose 1.2044,-0.0310,6.2518}"
    )


@pytest.mark.parametrize(("digits", "text"), [(2, "63.40"), (4, "63.4000")])
def test_time_digits(digits: int, text: str) -> None:
    """Protocol 66: the caller chooses the digits of Time by protocol table 2.2."""
    line = sensor_line(UT2004, "Sonar", [sonar("F1", 1)], 63.4, digits)
    assert line.startswith(f"SEN {{Time {text}}} {{Type Sonar}} ")


def test_batched_sensors() -> None:
    """Protocol 97: all sonars in one line, in the order given, each one multi-pair segment."""
    items = [sonar("F1", 1.982), sonar("F2", 5.0)]
    assert sensor_line(UT2004, "Sonar", items, 63.4, 4, True) == (
        "SEN {Time 63.4000} {Type Sonar} {Name F1 Range 1.9820} {Name F2 Range 5.0000}"
    )


@pytest.mark.parametrize(
    ("wire_type", "key", "value"),
    [("IR", "Range", "0.4411"), ("Encoder", "Tick", "412"), ("Touch", "Touch", "False")],
)
def test_other_batched_types(wire_type: str, key: str, value: str) -> None:
    """Protocol 99: IR, Encoder and Touch follow the same pair of rules."""
    items = [Item("A", ((key, value),)), Item("B", ((key, value),))]
    assert sensor_line(UT2004, wire_type, items, multi_pair=True) == (
        f"SEN {{Type {wire_type}}} {{Name A {key} {value}}} {{Name B {key} {value}}}"
    )
    assert sensor_line(UDK, wire_type, items[:1], multi_pair=True) == (
        f"SEN {{Type {wire_type}}} {{Name A}} {{{key} {value}}}"
    )


def test_sixteen_sonars_of_p2at() -> None:
    """Protocol 100: F1..F8, then R1..R8, in sixteen segments that the strictest client counts."""
    names = [f"{row}{number}" for row in "FR" for number in range(1, 9)]
    line = sensor_line(UT2004, "Sonar", [sonar(name, 5.0) for name in names], 1, 4, True)
    data = line.partition("{Type Sonar} ")[2].strip("{}").split("} {")
    assert data == [f"Name {name} Range 5.0000" for name in names]


def test_multi_pair_with_several_pairs_and_a_lone_key() -> None:
    """Protocol 4.5: `{Name n key value key value}`, a datum without value contributes its key."""
    item = Item("n", (("A", "1"), ("None", ""), ("B", "2")))
    assert sensor_line(UT2004, "X", [item], multi_pair=True) == "SEN {Type X} {Name n A 1 None B 2}"


def test_a_datum_without_value() -> None:
    """Protocol 4.6 Acoustic: an empty value prints the key alone."""
    item = Item("Array_0", (("None", ""),))
    assert sensor_line(UDK, "Acoustic", [item], 63.4021) == (
        "SEN {Time 63.4021} {Type Acoustic} {Name Array_0} {None}"
    )


def test_repeated_keys_keep_their_order() -> None:
    """Protocol 116: RFID repeats ID, Location, Mem."""
    data = tuple(
        pair
        for tag in ("118", "131")
        for pair in (("ID", tag), ("Location", "0.44,-0.20,0.04"), ("Mem", "0"))
    )
    assert sensor_line(UT2004, "RFID", [Item("RFID", data)]) == (
        "SEN {Type RFID} {Name RFID} {ID 118} {Location 0.44,-0.20,0.04} {Mem 0} "
        "{ID 131} {Location 0.44,-0.20,0.04} {Mem 0}"
    )


def test_nothing_to_report_gives_no_line() -> None:
    """Protocol 7: an empty batch is no line."""
    assert sensor_line(UT2004, "Sonar", [], 1.0, 4, True) == ""
    assert encode(sensor_line(UDK, "Sonar", [])) == b""


def test_range_is_the_last_segment() -> None:
    """Protocol 102: Name, Resolution, FOV, Range."""
    line = sensor_line(UT2004, "RangeScanner", [scan(UT2004, 5, 2.0)], 63.4, 2)
    assert line == (
        "SEN {Time 63.40} {Type RangeScanner} {Name Scanner1} {Resolution 0.0174} {FOV 3.1415} "
        "{Range 2.0000,2.0000,2.0000,2.0000,2.0000}"
    )


@pytest.mark.parametrize("dialect", list(Dialect))
def test_a_scan_of_181_beams_fits_every_client(dialect: Dialect) -> None:
    """Protocol 106: a 181-beam line is shorter than 2000 bytes at the longest two digit
    distance."""
    line = sensor_line(dialect, "RangeScanner", [scan(dialect, 181, 79.9999)], 99999.99, 2)
    assert len(encode(line)) < 2000


@pytest.mark.parametrize("dialect", list(Dialect))
@pytest.mark.parametrize("beams", [181, 240, 241, 271])
def test_scans_fit_the_smallest_line_buffer(dialect: Dialect, beams: int) -> None:
    """Protocol 5.2 no. 14 and addendum: scan lines stay below 2048 bytes by printing fewer
    digits."""
    line = sensor_line(dialect, "RangeScanner", [scan(dialect, beams, 20.0)], 9999.99, 2)
    assert len(encode(line)) < 2048


def test_sensor_geometry_ut2004() -> None:
    """Protocol 134: one multi-pair segment per item, four digits, Mount last."""
    mounts = [
        ("F1", (0.115, -0.13, 0.0), (0.0, 0.0, -HALF_PI), "HARD"),
        ("F2", (0.155, -0.115, 0.0), (0.0, 0.0, -0.8727), "CameraTilt"),
    ]
    assert sensor_geometry(UT2004, "Sonar", mounts) == (
        "GEO {Type Sonar} {Name F1 Location 0.1150,-0.1300,0.0000 Orientation "
        "0.0000,0.0000,-1.5707 Mount HARD} {Name F2 Location 0.1550,-0.1150,0.0000 Orientation "
        "0.0000,0.0000,-0.8727 Mount CameraTilt}"
    )


def test_sensor_geometry_udk() -> None:
    """Protocol 134, 9: separate segments, two digits, one blank also before Mount."""
    mounts = [("lms200", (0.18, 0.0, -0.25), (0.0, 0.0, 0.0), "P3AT")]
    assert sensor_geometry(UDK, "RangeScanner", mounts) == (
        "GEO {Type RangeScanner} {Name lms200} {Location 0.18,0.00,-0.25} "
        "{Orientation 0.00,0.00,0.00} {Mount P3AT}"
    )


def test_sensor_geometry_on_a_link() -> None:
    """Protocol 4.7: a sensor on a moving link names actuator and link, in `udk`."""
    mount = SensorMount("Eye", (0.05, 0, -0.1), (0, 0, 0), "KR60Arm", 6)
    assert sensor_geometry(UDK, "ObjectSensor", [mount]).endswith("{Mount KR60Arm} {MountLink 6}")
    assert sensor_geometry(UT2004, "ObjectSensor", [mount]).endswith(" Mount KR60Arm}")


def test_sensor_geometry_lists_all_items() -> None:
    """Protocol 127: one line holds all items of the type, in order."""
    mounts = [(name, (0.0, 0, 0), (0.0, 0, 0), "HARD") for name in ("A", "B", "C")]
    for dialect in Dialect:
        text = sensor_geometry(dialect, "Sonar", mounts)
        places = [text.index(f"{{Name {name}") for name in ("A", "B", "C")]
        assert places == sorted(places)
        assert text.count("Location") == 3


def test_no_match_gives_no_line() -> None:
    """Protocol 126: nothing asked for exists, nothing is sent."""
    assert sensor_geometry(UT2004, "Sonar", []) == ""
    assert configuration("Sonar", []) == ""


def test_configuration() -> None:
    """Protocol 136, 137: the segments of each item behind its Name, items in a row."""
    data = (("MaxRange", "5.0000"), ("MinRange", "0.1000"), ("BeamAngle", "0.3491"))
    assert configuration("Sonar", [Item("F1", data), Item("F2", data)]) == (
        "CONF {Type Sonar} {Name F1} {MaxRange 5.0000} {MinRange 0.1000} {BeamAngle 0.3491} "
        "{Name F2} {MaxRange 5.0000} {MinRange 0.1000} {BeamAngle 0.3491}"
    )


def test_configuration_of_an_item_that_has_nothing_but_a_name() -> None:
    """Protocol 125: every item answers, if only with its name."""
    assert configuration("Camera", [Item("Camera")]) == "CONF {Type Camera} {Name Camera}"
