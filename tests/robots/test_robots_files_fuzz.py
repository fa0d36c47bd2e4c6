"""Whatever a robot file says, of arms as well: a robot that MuJoCo can build, or one
RobotDescriptionError.
"""

from __future__ import annotations

import copy
import tempfile
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from robot_files import table, write
from test_robots_limbs import ARM, GRIPPER

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.mjcf import build_spec

QUICK = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)
texts = st.text(st.characters(codec="utf-8"), max_size=8)
scalars = st.one_of(
    st.booleans(),
    st.integers(),
    st.integers(10**300, 10**310),
    st.floats(),
    texts,
    st.sampled_from(["left", "box", "P3AT", "udk", "LeftWheel", "base"]),
)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=8,
)
KEYS = [*table(), "extends", "battery", "report", "camera", "without", "rest_height", "aliases"]


def paths(node: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place inside a nested table."""
    pairs = node.items() if isinstance(node, dict) else enumerate(node)
    found = []
    for name, inner in pairs:
        found.append((*here, name))
        if isinstance(inner, dict | list):
            found += paths(inner, (*here, name))
    return found


PLACES = paths(table())


def put(robot: dict[str, Any], place: tuple[Any, ...], value: Any) -> None:
    node: Any = robot
    for name in place[:-1]:
        node = node[name]
    node[place[-1]] = value


def at_place(robot: dict[str, Any], place: tuple[Any, ...]) -> Any:
    node: Any = robot
    for name in place:
        node = node[name]
    return node


def outcome(path: Path) -> RobotDescription | str:
    """The robot, or the text of the one error that is allowed."""
    try:
        return load_robot(path)
    except RobotDescriptionError as error:
        return str(error)


def check(robot: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        loaded = outcome(write(Path(folder), "Test", robot))
        if isinstance(loaded, str):
            assert loaded.startswith(folder)
            assert "\n" not in loaded
        else:
            assert build_spec(loaded).compile().nu == len(loaded.driven_wheels)


@QUICK
@given(st.dictionaries(st.sampled_from(KEYS) | texts, values, max_size=5))
def test_random_tables_never_raise_anything_else(robot: dict[str, Any]) -> None:
    """A table of random keys and values is a robot or a RobotDescriptionError."""
    check(robot)


@QUICK
@given(st.lists(st.tuples(st.sampled_from(PLACES), values), min_size=1, max_size=2))
def test_damaged_files_never_raise_anything_else(
    damages: list[tuple[tuple[Any, ...], Any]],
) -> None:
    """A good file with one or two values replaced is a robot or a RobotDescriptionError."""
    robot = copy.deepcopy(table())
    for place, value in damages:
        # An earlier damage may have taken the place away.
        try:
            put(robot, place, value)
        except (KeyError, IndexError, TypeError):
            continue
    check(robot)


SCALAR_KEYS = ("mass", "radius", "width", "max_wheel_speed")
NUMBERS = [place for place in PLACES if isinstance(place[-1], int) or place[-1] in SCALAR_KEYS]
NUMBERS = [place for place in NUMBERS if isinstance(at_place(table(), place), float)]
numbers = st.floats(1e-3, 100) | st.floats(-200, 200) | st.sampled_from([1e-4, 1e-3, 100.0, 1e5])


@QUICK
@given(st.dictionaries(st.sampled_from(NUMBERS), numbers, min_size=1, max_size=6))
def test_numbers_within_the_limits_always_compile(changes: dict[tuple[Any, ...], float]) -> None:
    """The limits of the loader are such that MuJoCo never refuses what the loader accepts."""
    robot = copy.deepcopy(table())
    for place, value in changes.items():
        put(robot, place, value)
    check(robot)


@QUICK
@given(st.binary(max_size=60))
def test_random_bytes_never_raise_anything_else(data: bytes) -> None:
    """A file of random bytes is a RobotDescriptionError."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "Test.toml"
        path.write_bytes(data)
        loaded = outcome(path)
        assert isinstance(loaded, str)
        assert loaded.startswith(folder)


ARMED = table(
    actuator=[ARM],
    effector=[GRIPPER, {**GRIPPER, "name": "Loose", "mount": "", "detached": True}],
)
FUZZ_PLACES = [place for place in paths(ARMED) if place[0] in ("actuator", "effector")]
FUZZ_NUMBERS = [place for place in FUZZ_PLACES if isinstance(at_place(ARMED, place), float)]


@QUICK
@given(st.lists(st.tuples(st.sampled_from(FUZZ_PLACES), values), min_size=1, max_size=2))
def test_damaged_arms_never_raise_anything_else(
    damages: list[tuple[tuple[Any, ...], Any]],
) -> None:
    """An armed robot with one or two values replaced is a robot or a RobotDescriptionError."""
    robot = copy.deepcopy(ARMED)
    for place, value in damages:
        # An earlier damage may have taken the place away.
        try:
            put(robot, place, value)
        except (KeyError, IndexError, TypeError):
            continue
    check(robot)


@QUICK
@given(st.dictionaries(st.sampled_from(FUZZ_NUMBERS), numbers, min_size=1, max_size=6))
def test_numbers_of_arms_within_the_limits_always_compile(
    changes: dict[tuple[Any, ...], float],
) -> None:
    """MuJoCo never refuses an arm that the loader accepts."""
    robot = copy.deepcopy(ARMED)
    for place, value in changes.items():
        put(robot, place, value)
    check(robot)


@QUICK
@given(st.dictionaries(st.sampled_from(["actuator", "effector", "without"]), values, max_size=3))
def test_random_tables_of_arms_never_raise_anything_else(changes: dict[str, Any]) -> None:
    """Anything in place of the tables is a robot or a RobotDescriptionError."""
    check({**copy.deepcopy(ARMED), **changes})


def test_the_undamaged_robot_is_one(tmp_path: Path) -> None:
    """What is damaged here loads and compiles when it is whole."""
    robot = outcome(write(tmp_path, "Test", ARMED))
    assert not isinstance(robot, str), robot
    assert build_spec(robot).compile().njnt == 1 + 2 + 2 + 2 + 3
