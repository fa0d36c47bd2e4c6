"""The page that shows how to add a family of vehicles works as written."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.families import base
from usarsim_server.robots.families import base as registry

PAGE = (Path(__file__).parents[2] / "docs" / "families-howto.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Code blocks of the page."""
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def twist(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The example's family, registered for the length of a test."""
    registry.families()
    monkeypatch.setattr(registry.TYPES, "_types", dict(registry.TYPES._types))
    names: dict[str, Any] = {"__name__": "twist_of_the_page"}
    exec(blocks("python")[0], names)
    return names["Twist"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of the example's robot file."""
    (tmp_path / "TwistP2DX.toml").write_text(blocks("toml")[0], encoding="utf-8")
    return tmp_path


@pytest.mark.usefixtures("twist")
def test_the_example_test_passes(folder: Path) -> None:
    """The test shown on the page runs and holds."""
    names: dict[str, Any] = {}
    exec(blocks("python")[1], names)
    names["test_it_drives_at_its_speed"](folder)


def test_a_new_family_is_a_kind_of_robot_files(twist: Any, folder: Path) -> None:
    """One file is enough: robot files may name the family, and inherit the rest."""
    robot = load_robot(folder / "TwistP2DX.toml")
    assert "twist" in registry.families()
    assert type(robot.family) is twist
    assert robot.kind == "twist"
    assert robot.report.steering_type == "SkidSteered"
    # Another law, so other slots than those of P2DX.
    assert robot.model == "TwistP2DX"


@pytest.mark.usefixtures("twist")
def test_the_example_stands_nonsense(folder: Path) -> None:
    """Absent members keep their value, nonsense counts as absent, wheels keep their limit."""
    from machine_fakes import Driver

    driver = Driver(load_robot(folder / "TwistP2DX.toml"))
    assert driver.send(linear_velocity=0.195)
    assert driver.machine.wheels == pytest.approx([2.0, 2.0])
    driver.obey(Drive(linear_velocity=float("nan"), rotational_velocity=1e9))
    assert driver.machine.wheels == pytest.approx([5.4, -5.4])
    assert not driver.send(left=1.0, right=1.0)
    assert "{Type GroundVehicle}" in driver.machine.description.family.configuration(
        driver.machine.description, Dialect.UT2004
    )


def test_the_table_names_what_a_family_may_say() -> None:
    """Every public member of a family is in the table of the page, and nothing else."""
    said = set()
    for row in re.findall(r"^\| (`[^|]*`) \|", PAGE, re.MULTILINE):
        said |= set(re.findall(r"`(\w+)", row))
    members = {name for name in vars(base.Family) if not name.startswith("_")}
    assert said == members


def test_the_entry_point_group_is_the_one_that_is_read() -> None:
    """The table for outside packages names the group of the registry."""
    points = tomllib.loads(blocks("toml")[1])["project"]["entry-points"]
    assert list(points) == [registry.GROUP]
