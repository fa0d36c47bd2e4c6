"""The team in MuJoCo: the checkers, what robots see of each other, and when maps are merged."""

from pathlib import Path

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils.conversions import parallel_to_aec

from usarsim_exploration.gym import ExplorePhysicsTeam
from usarsim_exploration.known_map import WALL
from usarsim_server.base.errors import UsarsimError

ROWS, COLUMNS = 30, 40


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> str:
    """An empty hall of 4 m by 3 m, as a map file."""
    rows = ["1" * COLUMNS, *["1" + "0" * (COLUMNS - 2) + "1"] * (ROWS - 2), "1" * COLUMNS]
    path: Path = tmp_path_factory.mktemp("gym") / "hall.txt"
    path.write_text("\n".join([str(ROWS), str(COLUMNS), *rows, ""]))
    return str(path)


def test_pettingzoo_checks_it(hall: str) -> None:
    """DOOR-11: parallel_api_test, parallel_seed_test and render_test, unchanged."""
    parallel_api_test(ExplorePhysicsTeam(hall, coverage=1.0, steps=8), num_cycles=10)
    parallel_seed_test(lambda: ExplorePhysicsTeam(hall, noise=0.02, steps=8), num_cycles=4)
    render_test(
        lambda render_mode: parallel_to_aec(ExplorePhysicsTeam(hall, render_mode=render_mode))
    )


@pytest.mark.parametrize("reach", [0.0, 20.0])
def test_maps_are_merged_by_radio(hall: str, reach: float) -> None:
    """Who is linked knows the same, and where the other is; nobody draws the other as a wall."""
    team = ExplorePhysicsTeam(hall, robots=2, radio={"model": "circle"}, radio_range=reach)
    team.reset(seed=3)
    for _ in range(12):
        actions = {"robot_1": np.array([0, 1.0]), "robot_2": np.array([0, -1.0])}
        seen, _, _, _, infos = team.step(actions)
    linked = reach > 0.0
    assert [infos[name]["linked"] for name in team.agents] == [[2] * linked, [1] * linked]
    assert np.array_equal(seen["robot_1"]["map"][:2], seen["robot_2"]["map"][:2]) == linked
    assert (seen["robot_1"]["map"][2] == 128).any() == linked
    inner = team.level.charts[1].bits[3:-3, 3:-3]
    assert not (inner & WALL).any()


def test_they_see_and_meet_each_other(hall: str) -> None:
    """A robot that drives at another one sees it before it, pushes it, and both are charged."""
    team = ExplorePhysicsTeam(hall, robots=2)
    team.reset(seed=1)
    stage = team.level.stage
    stage.begin([(1.2, 1.5, 0.0), (2.6, 1.5, 0.0)], np.random.default_rng(1))
    ahead = stage.rovers[0].scanner.scan[90]
    assert 0.5 < ahead < 1.4  # the wall is 2.5 m from the range finder
    assert not stage.rovers[0].met[90]
    for _ in range(15):
        stage.step({0: (1.0, 0.0)})
    assert [one.touching for one in stage.rovers] == [True, True]


@pytest.mark.parametrize(
    ("shape", "least", "most"),
    [({"latency": 3}, 0.8, 0.99), ({"latency": 50}, 0.0, 0.0), ({"bandwidth": 40}, 0.01, 0.2)],
)
def test_messages_take_bytes_and_steps(
    hall: str, shape: dict[str, int], least: float, most: float
) -> None:
    """E-81: of what robots know the base knows what has had the time to arrive, and no more than
    fits into as many bytes; frames get lost in the same way again."""
    told = []
    for _ in range(2):
        team = ExplorePhysicsTeam(hall, radio={"model": "circle", "loss": 0.1, **shape})
        team.reset(seed=3)
        for _ in range(12):
            _, _, _, _, infos = team.step({"robot_1": np.array([0, 1.0]), "robot_2": np.zeros(2)})
        assert infos["robot_1"]["linked"] == [2]
        told.append(np.stack([one.bits for one in team.level.charts]))
    assert np.array_equal(*told)
    base, *robots = told[0] != 0
    assert least <= base.sum() / np.logical_or(*robots).sum() <= most


def test_a_team_of_nobody() -> None:
    """One line with the cure."""
    with pytest.raises(UsarsimError, match="robots: 0"):
        ExplorePhysicsTeam(robots=0)
