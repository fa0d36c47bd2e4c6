"""The conformance checklist of the protocol reference, over everything that every robot says.

All shipped robots speak both dialects; each of their lines is held against the rules.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import pytest
from robot_files import DIALECTS, values
from robot_files import kind as kind_of
from sharing import shipped_robots

from usarsim_server.testing import Rehearsal

pytestmark = pytest.mark.slow

CLASSES = shipped_robots().names()
ITEM_TYPES = ("Actuator", "MisPkg", "Gripper", "ToolChanger", "VacuumGripper", "Camera")
SPACING = 9.0
"""m between robots, so that none stands in another's way; they see each other all the same."""
LISTEN = 1.6
"""s of simulated time: three lines of the slowest ordinary sensor."""

PARTS = 6
"""Worlds for the robots of a dialect: each newcomer costs the more the more are there."""

LINE = re.compile(r"[A-Z]+( \{[^{}\s]+( [^{}\s]+)*\})+")
NUMBER = re.compile(r"-?\d+(\.\d+)?")
LONG = ("RangeScanner", "RangeScanner3D", "RangeImager", "PCL", "LineLaser", "ObjectSensor")


@dataclass(frozen=True)
class Heard:
    """What one robot said in one dialect."""

    robot: str
    dialect: str
    replies: tuple[str, ...]
    stream: tuple[str, ...]

    @property
    def lines(self) -> tuple[str, ...]:
        """Everything."""
        return self.replies + self.stream


def _listen(dialect: str, classes: Sequence[str]) -> Iterator[Heard]:
    with Rehearsal(world="empty", max_robots=64) as stage:
        clients = {name: stage.connect() for name in classes}
        for index, (name, client) in enumerate(clients.items()):
            x, y = SPACING * (index % 8), SPACING * (index // 8)
            client.send(
                f"INIT {{ClassName {name}}} {{Location {x},{y},-0.3}} {{Dialect {dialect}}}",
                "DRIVE {Left 0.6} {Right 0.4}",
            )
        stage.run(0.3 + LISTEN)
        for name, client in clients.items():
            stream = tuple(client.take())
            description = stage.assembly.robots.describe(name)
            assert description is not None
            types = {sensor.type for sensor in description.items} | {kind_of(s) for s in stream}
            for wire_type in ("Robot", *ITEM_TYPES, *sorted(types)):
                client.send(f"GETCONF {{Type {wire_type}}}", f"GETGEO {{Type {wire_type}}}")
            client.send("GETSTARTPOSES", "GETPATHNODES")
            yield Heard(name, dialect, tuple(client.take()), stream)


@pytest.fixture(scope="module")
def heard() -> list[Heard]:
    """Every robot in both dialects."""
    parts = [CLASSES[n::PARTS] for n in range(PARTS)]
    return [one for dialect in DIALECTS for part in parts for one in _listen(dialect, part)]


def _ground(heard: list[Heard], dialect: str) -> Iterator[tuple[Heard, str]]:
    for one in heard:
        if one.dialect == dialect:
            yield from ((one, line) for line in one.stream if line.startswith("STA"))


# -- every line ------------------------------------------------------------------------------------


def test_form_of_every_line(heard: list[Heard]) -> None:
    """One blank between segments and words, none at the ends, nothing empty (protocol 7, 8, 9)."""
    count = 0
    for one in heard:
        assert len(one.stream) > 5, f"{one.robot} hardly speaks"
        for line in one.lines:
            if one.dialect == "udk" and line.startswith("CONF {Type Camera} "):
                # Side channels reference 2.10: glued as in the original.
                line = line.replace("}{", "} {")
            assert LINE.fullmatch(line), f"{one.robot}: {line}"
            count += 1
    assert count > 2000


def test_numbers_of_every_line(heard: list[Heard]) -> None:
    """No exponent, nan, inf or decimal comma; vectors hold no blanks (protocol 53, 54)."""
    for one in heard:
        for line in one.lines:
            assert not re.search(r"\b(nan|inf)\b|\d\.?[eE][-+]?\d", line), line
            for word in re.split(r"[{} ]", line):
                if word.startswith(("-", ".")) or re.match(r"\d+[.,]", word):
                    parts = re.split(r"[,;]", word)
                    # GPS writes degrees, minutes and a letter.
                    parts = parts[:-1] if re.fullmatch("[NSEW]", parts[-1]) else parts
                    assert all(NUMBER.fullmatch(part) for part in parts), f"{word} in {line}"


def test_booleans_of_every_line(heard: list[Heard]) -> None:
    """Booleans are True and False (protocol 55, 118)."""
    words = {word for one in heard for line in one.lines for word in re.split(r"[{} ]", line)}
    assert {"True", "False"} <= words
    assert not {word for word in words if word.lower() in ("true", "false", "yes", "no")} - {
        "True",
        "False",
    }


def test_order_inside_sen(heard: list[Heard]) -> None:
    """Time if any, Type, Name, then data; only the Camera has no Name (protocol 94, 95)."""
    form = re.compile(r"SEN (\{Time [\d.]+\} )?\{Type \w+\} \{Name [^}]+\}( \{[^}]+\})*")
    for one in heard:
        for line in one.stream:
            if line.startswith("SEN") and kind_of(line) != "Camera":
                assert form.fullmatch(line), line
                assert "{Time " not in line.partition("{Type ")[2]


def test_time_or_no_time(heard: list[Heard]) -> None:
    """In ut2004 the types of protocol 96 have Time or not; INS never has it (protocol 96, 113)."""
    without = {"Odometry", "INS", "GPS", "Encoder", "Touch", "RFID", "HumanMotion", "Sound"}
    without |= {"CO2Sensor"}
    with_time = {"Sonar", "IR", "RangeScanner", "GroundTruth", "VictSensor"}
    seen: set[str] = set()
    for one in heard:
        for line in one.stream:
            kind, timed = kind_of(line), line.startswith("SEN {Time ")
            if line.startswith("SEN") and one.dialect == "ut2004":
                seen.add(kind)
                assert not (timed and kind in without), line
                assert timed or kind not in with_time, line
            assert not (timed and kind == "INS"), line
    # Nobody shipped carries an IR, and there is no tag in this world.
    assert seen >= (without | with_time) - {"IR", "RFID"}


DIGITS: list[tuple[str, str, str, int, int]] = [
    # head, type, key, digits in ut2004 and in udk
    ("STA", "GroundVehicle", "Time", 2, 4),
    ("STA", "GroundVehicle", "FrontSteer", 4, 4),
    ("STA", "GroundVehicle", "RearSteer", 4, 4),
    ("SEN", "Sonar", "Time", 4, 4),
    ("SEN", "GroundTruth", "Time", 4, 4),
    ("SEN", "VictSensor", "Time", 4, 4),
    ("SEN", "RangeScanner", "Time", 2, 4),
    ("SEN", "Sonar", "Range", 4, 4),
    ("SEN", "RangeScanner", "Range", 4, 2),
    ("SEN", "RangeScanner", "Resolution", 4, 4),
    ("SEN", "RangeScanner", "FOV", 4, 4),
    ("SEN", "Odometry", "Pose", 4, 4),
    ("SEN", "INS", "Location", 2, 2),
    ("SEN", "INS", "Orientation", 2, 2),
    ("SEN", "GroundTruth", "Location", 2, 3),
    ("SEN", "GroundTruth", "Orientation", 2, 3),
    ("SEN", "Tachometer", "Vel", 4, 4),
    ("CONF", "GroundVehicle", "Mass", 4, 4),
    ("CONF", "GroundVehicle", "MaxSpeed", 4, 4),
    ("CONF", "RangeScanner", "MaxRange", 4, 4),
    ("CONF", "Sonar", "MinRange", 4, 4),
    ("GEO", "GroundVehicle", "Dimensions", 4, 4),
    ("GEO", "GroundVehicle", "WheelSeparation", 4, 4),
    ("GEO", "Sonar", "Location", 4, 2),
    ("GEO", "Sonar", "Orientation", 4, 2),
]


@pytest.mark.parametrize(("head", "kind", "key", "ut2004", "udk"), DIGITS)
def test_digits(heard: list[Heard], head: str, kind: str, key: str, ut2004: int, udk: int) -> None:
    """Digits after the point follow protocol table 2.2 in every line of both dialects
    (protocol 66)."""
    for dialect, digits in (("ut2004", ut2004), ("udk", udk)):
        texts = [
            text
            for one in heard
            if one.dialect == dialect
            for line in one.lines
            if line.startswith(head + " ") and kind_of(line) == kind
            for value in values(line, key)
            for text in value.split(",")
        ]
        assert texts, f"nobody says {key} in {dialect}"
        for text in texts:
            assert re.fullmatch(rf"-?\d+\.\d{{{digits}}}", text), f"{dialect} {key} {text}"


@pytest.mark.parametrize(
    ("head", "dialect", "digits"), [("MISSTA", "ut2004", 2), ("ASTA", "udk", 4)]
)
def test_digits_of_links(heard: list[Heard], head: str, dialect: str, digits: int) -> None:
    """Links report Time by dialect and Value with four digits, counted from 1 (protocol 66, 5.2
    no. 22)."""
    lines = [
        line
        for one in heard
        if one.dialect == dialect
        for line in one.stream
        if line.startswith(head + " ")
    ]
    assert lines
    for line in lines:
        assert re.match(
            rf"{head} \{{Time \d+\.\d{{{digits}}}\}} \{{Name [^}}]+\}} \{{Link 1\}}", line
        )
        assert all(re.fullmatch(r"-?\d+\.\d{4}", text) for text in values(line, "Value"))
    other = "ASTA" if head == "MISSTA" else "MISSTA"
    assert not any(
        line.startswith(other) for one in heard if one.dialect == dialect for line in one.stream
    )


def test_length_of_lines(heard: list[Heard]) -> None:
    """Scans stay below 2000 bytes, other streamed lines below 1024 (protocol 106, 107)."""
    for one in heard:
        for line in one.stream:
            kind = kind_of(line)
            if kind == "RangeScanner":
                assert len(line) + 2 < 2000
            elif kind not in LONG:
                assert len(line) + 2 <= 1024, f"{one.robot}: {len(line)} bytes of {kind}"


# -- STA -------------------------------------------------------------------------------------------


def test_ut2004_status(heard: list[Heard]) -> None:
    """STA of every ground vehicle has the order that index-based clients need (protocol 85, 89)."""
    form = re.compile(
        r"STA \{Type GroundVehicle\} \{Time \d+\.\d\d\} \{FrontSteer -?\d+\.\d{4}\} "
        r"\{RearSteer -?\d+\.\d{4}\}( \{\w+ -?\d+\.\d{4}\})* \{LightToggle (True|False)\} "
        r"\{LightIntensity \d+\} \{Battery \d+\} \{View -?\d+\}"
    )
    lines = [line for _, line in _ground(heard, "ut2004") if "GroundVehicle" in line]
    assert len(lines) > 40
    for line in lines:
        assert form.fullmatch(line), line


def test_status_always_has_its_type(heard: list[Heard]) -> None:
    """Type is there in both dialects, so that nobody has to guess (protocol 5.2 no. 17)."""
    for dialect in DIALECTS:
        assert all(kind_of(line) for _, line in _ground(heard, dialect))


# -- GEO and CONF ----------------------------------------------------------------------------------


def _reply(one: Heard, head: str, kind: str) -> list[str]:
    return [
        line for line in one.replies if line.startswith(head + " ") and f"{{Type {kind}}}" in line
    ]


def test_robot_geometry_and_configuration(heard: list[Heard]) -> None:
    """One line each, members in their order, the class as Name (protocol 124, 129, 130, 133)."""
    geometry = ("Type", "Name", "Dimensions", "COG", "WheelRadius", "WheelSeparation", "WheelBase")
    drive = ("SteeringType", "Mass", "MaxSpeed", "MaxTorque", "MaxFrontSteer", "MaxRearSteer")
    wheeled = 0
    for one in heard:
        heads = [line.split(" ", 1)[0] for line in one.replies[:2]]
        assert heads == ["CONF", "GEO"], f"{one.robot}: {one.replies[:2]}"
        conf, geo = one.replies[:2]
        assert values(conf, "Name") == values(geo, "Name") == [one.robot]
        if kind_of(conf) != "GroundVehicle":
            continue
        wheeled += 1
        assert tuple(re.findall(r"\{(\w+) ", geo)) == geometry
        first = ("Type", "Name") if one.dialect == "ut2004" else ("Name", "Type")
        assert tuple(re.findall(r"\{(\w+) ", conf)) == (*first, *drive)
        literal = ["0.0000"] if one.dialect == "ut2004" else ["0"]
        if values(conf, "SteeringType") == ["SkidSteered"]:
            assert values(conf, "MaxFrontSteer") == values(conf, "MaxRearSteer") == literal
    assert wheeled >= 20


def test_sensor_geometry(heard: list[Heard]) -> None:
    """Multi-pair in ut2004, separate in udk, Name to Mount in order, all items (protocol 127,
    134)."""
    three = r"-?[\d.]+,-?[\d.]+,-?[\d.]+"
    forms = {
        "ut2004": rf"( \{{Name \S+ Location {three} Orientation {three} Mount \w+\}})+",
        "udk": rf"( \{{Name [^}}]+\}} \{{Location {three}\}} \{{Orientation {three}\}} "
        r"\{Mount \w+\}( \{MountLink \d+\})?)+",
    }
    for one in heard:
        for kind in ("Sonar", "RangeScanner", "Odometry", "INS", "Encoder"):
            for line in _reply(one, "GEO", kind):
                assert re.fullmatch(rf"GEO \{{Type {kind}\}}" + forms[one.dialect], line), line
    sonars = [line for one in heard for line in _reply(one, "GEO", "Sonar")]
    assert max(line.count("{Name ") for line in sonars) >= 16


def test_sensor_configuration(heard: list[Heard]) -> None:
    """RangeScanner: MaxRange, MinRange, Resolution, Fov; Sonar: the limits (protocol 136, 137)."""
    for one in heard:
        panning = "Paning" if one.dialect == "ut2004" else "Panning"
        for line in _reply(one, "CONF", "RangeScanner"):
            keys = re.findall(r"\{(\w+) ", line)[1:]
            assert keys[:7] == [
                "Name", "MaxRange", "MinRange", "Resolution", "Fov", panning, "Tilting"
            ]  # fmt: skip
        for line in _reply(one, "CONF", "Sonar"):
            number = line.count("{Name ")
            assert line.count("{MaxRange ") == line.count("{MinRange ") == number


def test_links_in_configuration_and_geometry(heard: list[Heard]) -> None:
    """Arms answer for Actuator and MisPkg in both dialects, links from 1 (protocol 139-141)."""
    arms = 0
    for one in heard:
        actuator, package = _reply(one, "CONF", "Actuator"), _reply(one, "CONF", "MisPkg")
        assert len(actuator) == len(package) <= 1
        if not actuator:
            continue
        arms += 1
        groups = re.findall(
            r"\{Link (\d+)\} \{JointType (\w+)\} \{MaxTorque [\d.]+\} "
            r"\{MinValue (-?[\d.]+)\} \{MaxValue (-?[\d.]+)\}",
            actuator[0],
        )
        assert len(groups) == actuator[0].count("{Link ")
        assert groups[0][0] == "1"
        assert {kind for _, kind, _, _ in groups} <= {"Revolute", "Prismatic"}
        assert all(float(low) <= float(high) for _, _, low, high in groups)
        assert "{Link 1} {Parent 0}" in _reply(one, "GEO", "Actuator")[0]
        assert "{Link 1} {ParentLink -1}" in _reply(one, "GEO", "MisPkg")[0]
    assert arms >= 2
