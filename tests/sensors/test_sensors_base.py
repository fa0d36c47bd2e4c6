"""Sensor types are found by themselves and through entry points; the how-to works as written."""

from __future__ import annotations

import logging
import pkgutil
import sys
from pathlib import Path

import numpy as np
import pytest
from sensor_fakes import UDK, FakeRobot, describe_item, describe_robot, describe_world, make

import usarsim_server.sensors as package
from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.sensors import base as registry
from usarsim_server.sensors.base import Sensor, SensorContext, create_sensor, register, sensor_types
from usarsim_server.sensors.report import conf_line, sen_lines
from usarsim_server.sensors.status import Battery

PLUGIN = '''
"""A thermometer, as an outside package would bring it."""

from usarsim_server.sensors.base import Sensor


class Thermometer(Sensor):
    wire_type = "Thermometer"

    def __init__(self, item, context):
        super().__init__(item, context)
        self.celsius = self.parameters.number("celsius", 21.0)

    def measure(self, robot, hits):
        return True

    def data(self, dialect):
        return (("Celsius", f"{self.celsius:.1f}"),)
'''


@pytest.fixture
def fresh_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """The registry before its first use, restored afterwards."""
    sensor_types()
    monkeypatch.setattr(registry.TYPES, "_types", dict(registry.TYPES._types))
    monkeypatch.setattr(registry.TYPES, "_broken", {})
    monkeypatch.setattr(registry.TYPES, "_discovered", False)


def install(folder: Path, monkeypatch: pytest.MonkeyPatch, entry_points: str) -> None:
    """Lay out an installed distribution with entry points on the import path."""
    info = folder / "thermo-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: thermo\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[usarsim_server.sensors]\n{entry_points}\n")
    monkeypatch.syspath_prepend(str(folder))


@pytest.mark.parametrize(
    "kind",
    [
        "Sonar",
        "IR",
        "RangeSensor",
        "RangeScanner",
        "SICK",
        "Hokuyo",
        "HokuyoURG04LX",
        "Odometry",
        "Encoder",
        "Tachometer",
        "INS",
        "IMU",
        "GroundTruth",
        "GroundTruthMovable",
        "GPS",
        "Touch",
        "Battery",
    ],
)
def test_the_types_of_both_generations_exist(kind: str) -> None:
    """Every type of robots reference 2.1 that is served can be made, in any letter case."""
    assert kind in sensor_types()
    for spelling in (kind, kind.lower(), kind.upper()):
        sensor = make(spelling, "W1")
        assert sensor.name == "W1"
        assert sensor.wire_type


def test_every_module_of_the_room_is_imported() -> None:
    """A built-in sensor needs no list: each file of the package is found by its presence."""
    sensor_types()
    for module in pkgutil.iter_modules(package.__path__):
        assert f"{package.__name__}.{module.name}" in sys.modules


def test_scanners_of_all_makes_are_range_scanners_on_the_wire() -> None:
    """SICK and Hokuyo are robot file types only."""
    for kind in ("RangeScanner", "SICK", "Hokuyo", "HokuyoURG04LX"):
        assert make(kind).wire_type == "RangeScanner"


def test_an_unknown_type_is_refused_with_the_nearest_one() -> None:
    """The message names the place, the type, the one probably meant and all others."""
    with pytest.raises(RobotDescriptionError) as error:
        make("RangeScaner", "lms200")
    text = str(error.value)
    assert text.startswith("robots/p3at.toml: [[sensor]] number 1 (lms200): type: ")
    assert "unknown sensor type 'RangeScaner'" in text
    assert "did you mean RangeScanner?" in text
    for kind in sensor_types():
        assert kind in text


def test_a_type_like_no_other_is_refused_without_a_guess() -> None:
    """No suggestion is made where none is near."""
    with pytest.raises(RobotDescriptionError, match=r"\(known types: 3DRangeScanner, Accel, "):
        make("Zzzzzz")


def test_an_unknown_parameter_names_the_key_and_the_cure() -> None:
    """create_sensor refuses keys that the type does not have."""
    with pytest.raises(RobotDescriptionError, match=r"\(lms200\): fow: unknown .*did you mean fov"):
        make("SICK", "lms200", fow=3.0)


def test_an_ill_typed_parameter_names_the_key_and_the_cure() -> None:
    """create_sensor refuses values of the wrong kind."""
    with pytest.raises(RobotDescriptionError, match=r"fov: 'wide' is not a number .* fov = 3\.14"):
        make("SICK", "lms200", fov="wide")


@pytest.mark.parametrize("value", ["fast", -0.1, True])
def test_the_interval_of_every_sensor_is_checked(value: object) -> None:
    """A common key is checked for all types; zero is allowed."""
    with pytest.raises(RobotDescriptionError, match="interval"):
        make("GroundTruth", interval=value)
    assert make("GroundTruth", interval=0).interval(UDK) == 0.0
    assert make("GroundTruth", interval=0.3).interval(UDK) == 0.3


def test_a_name_belongs_to_one_class() -> None:
    """Registering a taken name for another class is a programming error."""

    class Impostor(Battery):
        pass

    with pytest.raises(ValueError, match=r"already registered by usarsim_server\.sensors\.status"):
        register("BATTERY")(Impostor)
    assert type(make("Battery")) is Battery


def test_registering_the_same_class_again_is_harmless() -> None:
    """A module that is imported twice under one name does not fail."""
    assert register("Battery")(Battery) is Battery


@pytest.mark.usefixtures("fresh_registry")
def test_a_new_sensor_is_one_file_with_a_decorator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module dropped into the package is found, made from a robot file and put on the wire."""
    text = PLUGIN.replace(
        "class Thermometer",
        "from usarsim_server.sensors.base import register\n\n\n"
        '@register("Thermometer")\nclass Thermometer',
    )
    (tmp_path / "thermometer_for_test.py").write_text(text)
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    name = "usarsim_server.sensors.thermometer_for_test"
    try:
        assert "Thermometer" in sensor_types()
        sensor = make("thermometer", "Engine", celsius=88)
        assert sensor.measure(FakeRobot(), [])
        assert sen_lines([sensor], 1.0, UDK) == [
            "SEN {Time 1.0000} {Type Thermometer} {Name Engine} {Celsius 88.0}"
        ]
        assert conf_line([sensor], "thermometer", None, UDK) == (
            "CONF {Type Thermometer} {Name Engine}"
        )
    finally:
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("fresh_registry")
@pytest.mark.parametrize("target", ["thermo_plugin:Thermometer", "thermo_module"])
def test_another_package_brings_a_sensor_by_an_entry_point(
    target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A class, or a module that registers its classes, is loaded from the entry point group."""
    (tmp_path / "thermo_plugin.py").write_text(PLUGIN)
    (tmp_path / "thermo_module.py").write_text(
        "from thermo_plugin import Thermometer\n"
        "from usarsim_server.sensors.base import register\n"
        'register("Thermometer")(Thermometer)\n'
    )
    install(tmp_path, monkeypatch, f"Thermometer = {target}")
    try:
        assert "Thermometer" in sensor_types()
        assert make("Thermometer", "Engine", celsius=88).celsius == 88.0
        with pytest.raises(RobotDescriptionError, match="celsios: unknown key"):
            make("Thermometer", "Engine", celsios=88)
    finally:
        sys.modules.pop("thermo_plugin", None)
        sys.modules.pop("thermo_module", None)


@pytest.mark.usefixtures("fresh_registry")
def test_a_broken_package_does_not_stop_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Its failure is logged, told to who asks for its type, and everything else works."""
    install(tmp_path, monkeypatch, "Geiger = no_such_module_for_test:Geiger")
    with caplog.at_level(logging.WARNING, logger="usarsim.plugins"):
        assert "Sonar" in sensor_types()
    assert "Geiger" in caplog.text
    with pytest.raises(RobotDescriptionError, match=r"'Geiger' failed to load .*no_such_module"):
        make("Geiger")


def test_each_sensor_draws_from_its_own_stream() -> None:
    """Equal seeds give equal readings, different seeds different ones (robots 113)."""

    def ticks(seed: int) -> list[str]:
        sensor, robot, result = make("Encoder", "W0", seed=seed), FakeRobot(), []
        for _ in range(50):
            robot.roll_wheels(3.0, 3.0)
            sensor.measure(robot, [])
            result.append(sensor.data(UDK)[0][1])
        return result

    assert ticks(5) == ticks(5)
    assert ticks(5) != ticks(6)


def test_making_a_sensor_leaves_the_item_alone() -> None:
    """Descriptions are shared by all robots of a class and never change."""
    item = describe_item("SICK", "lms200", fov=1.0)
    before = dict(item.parameters)
    context = SensorContext(describe_robot(), describe_world(), np.random.default_rng(0))
    first, second = create_sensor(item, context), create_sensor(item, context)
    assert first is not second
    assert isinstance(first, Sensor)
    assert dict(item.parameters) == before
