"""Whatever a robot file says of arms: a robot that can be built, or one RobotDescriptionError."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from robot_files import table, write
from test_robots_limbs import ARM, GRIPPER
from test_robots_loader_fuzz import QUICK, at_place, check, numbers, outcome, paths, put, values

from usarsim_server.robots.mjcf import build_spec

ARMED = table(
    actuator=[ARM],
    effector=[GRIPPER, {**GRIPPER, "name": "Loose", "mount": "", "detached": True}],
)
PLACES = [place for place in paths(ARMED) if place[0] in ("actuator", "effector")]
NUMBERS = [place for place in PLACES if isinstance(at_place(ARMED, place), float)]


@QUICK
@given(st.lists(st.tuples(st.sampled_from(PLACES), values), min_size=1, max_size=2))
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
@given(st.dictionaries(st.sampled_from(NUMBERS), numbers, min_size=1, max_size=6))
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
