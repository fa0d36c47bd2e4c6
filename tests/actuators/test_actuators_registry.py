"""Effector types are found, also those of other packages and those of a new file."""

from __future__ import annotations

import logging
from importlib.metadata import EntryPoint
from typing import Any, ClassVar

import pytest
from actuator_fakes import HAND, Machine, effector, robot

from usarsim_server import plugins
from usarsim_server.actuators import effector as registry
from usarsim_server.actuators.effector import (
    GROUP,
    Effector,
    create_effector,
    create_effectors,
    effector_types,
    register_effector,
)
from usarsim_server.errors import RobotDescriptionError
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.articulation import Grip, HandModel


@pytest.fixture
def types(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The registry for the length of a test."""
    effector_types()
    table: dict[str, Any] = dict(registry.TYPES._types)
    monkeypatch.setattr(registry.TYPES, "_types", table)
    return table


class Magnet(Effector):
    """What somebody might add: one class in one file."""

    wire_type: ClassVar[str] = "Magnet"

    def __init__(self, description: EffectorDescription, robot: RobotDescription) -> None:
        super().__init__(description, robot)
        self.gap = self.parameters.number("gap", 1.0)

    def hand(self) -> HandModel:
        """A cup without limits."""
        return HandModel(self.name, Grip.SUCTION, self.name, reach=self.gap)

    def configuration(self) -> Item:
        """A name only."""
        return Item(self.name)


def test_built_in_types() -> None:
    """The types of the robots reference, and the names that the original's files have for them."""
    assert set(effector_types()) == {
        "Gripper",
        "GripperEffector",
        "ToolChanger",
        "Vacuum",
        "VacuumCup",
        "VacuumGripper",
    }


@pytest.mark.usefixtures("types")
def test_a_new_type_is_one_class() -> None:
    """A registered class can be mounted, commanded and configured under any case of its name."""
    register_effector("Magnet")(Magnet)
    arms = robot(effectors=(effector("MAGNET", "M", gap=0.3),))
    (magnet,) = create_effectors(arms)
    machine = Machine(arms)
    assert magnet.set("CLOSE", "", machine) is SetResult.OK
    assert machine.hands == [("M", True)]
    assert robot_model(arms).hands[0].reach == 0.3
    assert "Magnet" in effector_types()


@pytest.mark.usefixtures("types")
def test_two_classes_of_one_name_are_refused() -> None:
    """A name stands for one class; registering it again for the same class is no error."""
    register_effector("Magnet")(Magnet)
    register_effector("MAGNET")(Magnet)

    class Other(Magnet):
        pass

    with pytest.raises(ValueError, match="'magnet' is already registered by"):
        register_effector("magnet")(Other)


def test_unknown_types_and_parameters_are_one_clear_error() -> None:
    """The error names the item, what is known, and the likely meaning."""
    with pytest.raises(RobotDescriptionError, match=r"test: type: unknown.*did you mean ToolC"):
        create_effector(effector("ToolChnager", "T"), robot())
    with pytest.raises(RobotDescriptionError, match="known types: Gripper, "):
        create_effector(effector("Qqq", "T"), robot())
    with pytest.raises(RobotDescriptionError, match="colour: unknown key of a Gripper"):
        create_effector(effector("Gripper", "T", fingers=HAND.fingers, colour=1), robot())


def test_types_of_other_packages(
    types: dict[str, Any], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Entry points add types; a broken one is logged and does not keep the others away."""

    class Point(EntryPoint):
        def load(self) -> Any:
            if self.name == "Magnet":
                return Magnet
            raise ImportError("no such module")

    points = [Point(name, "x:y", GROUP) for name in ("Broken", "Magnet")]
    monkeypatch.setattr(plugins, "entry_points", lambda group: points if group == GROUP else [])
    monkeypatch.setattr(registry.TYPES, "_discovered", False)
    monkeypatch.setattr(registry.TYPES, "_broken", {})
    types.clear()
    monkeypatch.setattr(plugins, "importlib", _NoImports)
    with caplog.at_level(logging.WARNING):
        assert effector_types() == ["Magnet"]
    assert "Broken" in caplog.text


class _NoImports:
    """Stands for importlib: the built-in modules have been imported already."""

    @staticmethod
    def import_module(name: str) -> None:
        """Do nothing."""
