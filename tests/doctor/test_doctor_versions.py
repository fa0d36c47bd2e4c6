"""Versions: what is refused, what is merely missing, and the command that mends it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from usarsim_server.doctor.checks.installation import PACKAGES, Package, judge_package, judge_python
from usarsim_server.doctor.isolation import Outcome
from usarsim_server.doctor.registry import Mark

BY_NAME = {package.name: package for package in PACKAGES}


def found(version: str) -> Outcome:
    """A library that could be imported."""
    return Outcome({"version": version})


def test_requirements_are_those_of_the_project() -> None:
    """What is demanded here is word for word what `pip` is told."""
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    project = tomllib.loads(text)["project"]
    needed = {package.requirement for package in PACKAGES if not package.optional}
    assert needed == set(project["dependencies"])
    optional = {package.requirement for package in PACKAGES if package.optional}
    assert optional == {one for group in project["optional-dependencies"].values() for one in group}
    assert project["requires-python"] == ">=3.11"


@pytest.mark.parametrize("version", ["4.0.0", "4.1.2", "3.2.6", "2.3.7"])
def test_mujoco_that_diverges_or_is_too_old_is_a_problem(version: str) -> None:
    """4.0.0 and what is older than 3.16 are refused, with the command that gets a good one."""
    finding = judge_package(BY_NAME["mujoco"], found(version))
    assert finding.mark is Mark.PROBLEM
    assert version in finding.text
    assert finding.cure is not None
    assert finding.cure.endswith("-m pip install 'mujoco>=3.16,<4'")


def test_the_reason_is_that_of_the_server() -> None:
    """The text about 4.0.0 is the one that the server itself would give."""
    assert "diverges when robots touch" in judge_package(BY_NAME["mujoco"], found("4.0.0")).text


@pytest.mark.parametrize(
    ("name", "version", "mark"),
    [
        ("mujoco", "3.16.0", Mark.OK),
        ("numpy", "1.25.9", Mark.PROBLEM),
        ("numpy", "1.26.0", Mark.OK),
        ("numpy", "2.4.6rc1", Mark.OK),
        ("embreex", "4.4.0.post1", Mark.OK),
        ("embreex", "2.17.7", Mark.PROBLEM),
        ("pillow", "10.1.0", Mark.OK),
        ("usd-core", "23.11", Mark.WARNING),
    ],
)
def test_bounds_of_versions(name: str, version: str, mark: Mark) -> None:
    """Numbers are compared as numbers, and the lower bound itself will do."""
    assert judge_package(BY_NAME[name], found(version)).mark is mark


def test_an_upper_bound_counts() -> None:
    """A release at the upper bound is too new."""
    package = Package("thing", "thing", "thing>=1.2,<4", "things")
    assert judge_package(package, found("4.0")).mark is Mark.PROBLEM
    assert judge_package(package, found("3.99")).mark is Mark.OK


def test_what_is_missing_costs_what_it_is_for() -> None:
    """A missing library is a problem, a missing optional one a note that says what is lost."""
    needed = judge_package(BY_NAME["embreex"], Outcome(failure="no", missing="embreex"))
    assert (needed.mark, needed.text) == (
        Mark.PROBLEM,
        "not installed: needed for the rays of range sensors",
    )
    optional = judge_package(BY_NAME["usd-core"], Outcome(failure="no", missing="pxr"))
    assert optional.mark is Mark.NOTE
    assert ".usdz" in optional.text
    assert optional.cure is not None
    assert optional.cure.endswith("-m pip install 'usd-core>=24.8'")


def test_what_is_broken_is_installed_again() -> None:
    """A library that is there but dies, or lacks another one, says so."""
    dead = Outcome(failure="the process was ended by SIGILL")
    finding = judge_package(BY_NAME["embreex"], dead)
    assert finding.mark is Mark.PROBLEM
    assert finding.text == "cannot be imported: the process was ended by SIGILL"
    assert finding.cure is not None
    assert "--force-reinstall" in finding.cure
    lacking = Outcome(failure="ModuleNotFoundError: No module named 'x'", missing="x")
    assert "cannot be imported" in judge_package(BY_NAME["pillow"], lacking).text


def test_python_that_is_too_old_is_a_problem() -> None:
    """3.10 will not do, 3.11 and later will."""
    old = judge_python((3, 10, 12), "/usr/bin/python3")
    assert old.mark is Mark.PROBLEM
    assert old.cure is not None
    assert old.cure.startswith("python3.11 -m venv")
    assert judge_python((3, 11, 0), "python").mark is Mark.OK
    assert judge_python((3, 14, 0), "python").mark is Mark.OK
