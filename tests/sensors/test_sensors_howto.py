"""The page that shows how to add a sensor works as written."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from sensor_fakes import UDK, FakeRobot, describe_robot, describe_world

from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors import base as registry
from usarsim_server.sensors.base import SensorContext, create_sensor, sensor_types
from usarsim_server.sensors.report import sen_lines
from usarsim_server.simulation.frames import pose_from_wire

PAGE = (Path(__file__).parents[2] / "docs" / "sensors-howto.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Code blocks of the page."""
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def thermometer(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The example's class, registered for the length of a test."""
    sensor_types()
    monkeypatch.setattr(registry.TYPES, "_types", dict(registry.TYPES._types))
    page = ModuleType("thermometer_of_the_page")
    monkeypatch.setitem(sys.modules, page.__name__, page)
    exec(blocks("python")[0], vars(page))
    return page.Thermometer


@pytest.mark.usefixtures("thermometer")
def test_the_example_test_passes() -> None:
    """The test shown on the page runs and holds."""
    names: dict[str, Any] = {}
    exec(blocks("python")[1], names)
    names["test_it_is_colder_above"]()


def test_the_example_item_gives_the_example_line(thermometer: Any) -> None:
    """The table of the robot file makes the sensor, and it says what the page says."""
    (table,) = tomllib.loads(blocks("toml")[0])["sensor"]
    kind, name, position = table.pop("type"), table.pop("name"), table.pop("position")
    item = ItemDescription(kind, name, None, pose_from_wire(tuple(position)), table)
    context = SensorContext(describe_robot(), describe_world(), np.random.default_rng(0))
    sensor = create_sensor(item, context)
    assert type(sensor) is thermometer
    assert sensor.interval(UDK) == 0.5
    assert sensor.measure(FakeRobot(), ())
    (line,) = sen_lines([sensor], 12.0, UDK)
    assert line in PAGE


def test_the_entry_point_group_is_the_one_that_is_read() -> None:
    """The table for outside packages names the group of the registry."""
    points = tomllib.loads(blocks("toml")[1])["project"]["entry-points"]
    assert list(points) == [registry.GROUP]
