"""The environments of the grid, for one robot and for teams."""

import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils.conversions import parallel_to_aec

from usarsim_exploration.gym import ExploreGrid, ExplorePhysics, ExploreTeam
from usarsim_exploration.known_map import KNOWN
from usarsim_server.base.errors import UsarsimError

IDS = ("usarsim/ExploreGrid-v0", "usarsim/ExploreFrontiers-v0")
ROOMS = {
    "environment": {"generator": "flats", "columns": 100, "rows": 100, "rooms": 30},
    "team": {"robots": 3, "reach": 40, "radio": 30},
    "radio": {"model": "circle"},
}


def play(environment: ExploreGrid, steps: int, seed: int) -> list[tuple[object, ...]]:
    """What comes of random actions, with resets."""
    random = np.random.default_rng(seed)
    told: list[tuple[object, ...]] = []
    observation, _ = environment.reset(seed=seed)
    for _ in range(steps):
        action = np.int64(random.integers(environment.action_space.n))
        observation, reward, ended, cut, _ = environment.step(action)
        told.append((reward, ended, cut, *(one.tobytes() for one in observation.values())))
        if ended or cut:
            environment.reset()
    return told


@pytest.mark.parametrize("name", IDS)
def test_gymnasium_checks_it(name: str) -> None:
    """DOOR-11: check_env, unchanged; warnings are errors in this suite."""
    check_env(gymnasium.make(name).unwrapped)


@pytest.mark.parametrize("action", ["heading", "frontier"])
def test_pettingzoo_checks_it(action: str) -> None:
    """DOOR-11: parallel_api_test, parallel_seed_test and render_test, unchanged."""
    parallel_api_test(ExploreTeam(ROOMS, action=action, steps=60), num_cycles=70)
    parallel_seed_test(lambda: ExploreTeam(ROOMS, action=action, steps=30), num_cycles=40)
    render_test(lambda render_mode: parallel_to_aec(ExploreTeam(ROOMS, render_mode=render_mode)))


@pytest.mark.parametrize("action", ["heading", "frontier"])
def test_two_do_not_meet(action: str) -> None:
    """DOOR-12: two in turn are each as if alone; the same seed gives the same bits."""
    one, other, alone = (ExploreGrid(ROOMS, action=action, steps=20, worlds=2) for _ in range(3))
    first = [play(env, 25, seed) for seed in (1, 2) for env in (one, other)]
    assert first[0] == first[1] == play(alone, 25, 1)
    assert first[2] == first[3] == play(alone, 25, 2)
    assert first[0] != first[2]


def test_vectors() -> None:
    """In one process and in several, by the name that imports the package by itself."""
    for mode in ("sync", "async"):
        some = gymnasium.make_vec(
            "usarsim_exploration.gym:usarsim/ExploreGrid-v0", num_envs=2, vectorization_mode=mode,
            scenario=ROOMS,
        )  # fmt: skip
        observation, _ = some.reset(seed=3)
        assert observation["local"].shape == (2, 3, 64, 64)
        again = some.step(np.array([0, 4]))[0]
        assert again["map"].shape == (2, 3, 48, 48)
        some.close()


def test_what_is_seen_is_what_is_known() -> None:
    """The robot stands in the middle of known free space; rewards are the area that was found."""
    environment = ExploreGrid(ROOMS, time_cost=0.0, collision_cost=0.0, coverage=1.0, steps=50)
    observation, facts = environment.reset(seed=5)
    total = facts["covered"] * environment.level.free * 0.1**2
    for action in np.random.default_rng(0).integers(8, size=40):
        observation, reward, _, _, facts = environment.step(action)
        total += reward
    assert tuple(observation["local"][:, 32, 32]) == (255, 0, 0)
    assert total == pytest.approx(facts["covered"] * environment.level.free * 0.1**2)
    body = environment.level.cycle.bodies[1]
    bits = body.view.known.bits
    seen = (observation["local"][:2] > 0).any(axis=0)
    column, row = body.view.cell
    inside = bits[max(row - 32, 0) : row + 32, max(column - 32, 0) : column + 32]
    outside = 64 * 64 - inside.size
    assert np.count_nonzero(seen) == np.count_nonzero(inside & KNOWN) + outside


def test_a_wall_costs() -> None:
    """Who drives against a wall that it knows stays, looks there, and is charged."""
    environment = ExploreGrid(ROOMS, steps=100)
    environment.reset(seed=1)
    told = [environment.step(np.int64(0)) for _ in range(15)]
    reward, facts = told[-1][1], told[-1][4]
    assert facts["collided"]
    assert reward <= -0.6 + 1e-9
    assert tuple(told[-1][0]["pose"][2:4]) == (1.0, 0.0)


def test_the_nearest_frontier_covers_all() -> None:
    """Always the first choice ends an episode, with an area for each room."""
    environment = ExploreGrid(ROOMS, action="frontier")
    _, facts = environment.reset(seed=2)
    ended = cut = False
    while not (ended or cut):
        choice = np.int64(np.argmax(facts["action_mask"]))
        _, _, ended, cut, facts = environment.step(choice)
    assert ended
    assert facts["covered"] >= 0.9


def test_radio_decides_who_knows_what() -> None:
    """Maps are the same where robots are linked, and differ where none hears another."""
    deaf = {**ROOMS, "team": {"robots": 2, "reach": 40, "radio": 0}}
    near = {**ROOMS, "team": {"robots": 2, "reach": 40, "radio": 10000}}
    for scenario, same in ((deaf, False), (near, True)):
        team = ExploreTeam(scenario)
        team.reset(seed=4)
        for _ in range(5):
            seen, _, _, _, infos = team.step({"robot_1": np.int64(0), "robot_2": np.int64(4)})
        maps = [seen[name]["map"][:2] for name in team.agents]
        assert np.array_equal(*maps) == same
        assert (infos["robot_1"]["linked"] == [2]) == same


def test_a_robot_that_fails_is_out() -> None:
    """Its agent is terminated, and the others go on."""
    team = ExploreTeam({**ROOMS, "event": [{"step": 2, "kind": "loss", "robot": "R2"}]})
    team.reset(seed=1)
    for _ in range(2):
        ended = team.step(dict.fromkeys(team.agents, np.int64(0)))[2]
    assert ended == {"robot_1": False, "robot_2": True, "robot_3": False}
    assert team.agents == ["robot_1", "robot_3"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"scenario": {"environment": {"name": "lap"}}}, "lab"),
        ({"action": "fly"}, "write heading or frontier"),
        ({"worlds": 3}, "write environment.generator"),
        ({"coverage": 2.0}, "coverage: 2.0"),
        ({"scenario": "nowhere.toml"}, "nowhere.toml"),
    ],
)
def test_wrong_words(arguments: dict[str, object], told: str) -> None:
    """One line with the cure."""
    with pytest.raises(UsarsimError, match=told):
        ExploreGrid(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("action", [8, -1, 1.5, np.nan, None, "left", [0, 1], [[0], [1, 2]]])
def test_actions_out_of_the_space(action: object) -> None:
    """An error of Gymnasium's kind that says which there are; numbers of all types are read."""
    environment, team = ExploreGrid(ROOMS), ExploreTeam(ROOMS, robots=1)
    environment.reset(seed=1)
    team.reset(seed=1)
    cure = r"\(give a whole number from 0 to 7\)"
    with pytest.raises(InvalidAction, match=f"action: .* {cure}"):
        environment.step(action)
    with pytest.raises(InvalidAction, match=f"robot_1: .* {cure}"):
        team.step({"robot_1": action})
    for good in (7, np.int8(0), np.array(3), np.array([3])):
        environment.step(good)


def test_agents_that_are_not_there() -> None:
    """A team takes an action for each agent that goes on, and for no other."""
    team = ExploreTeam(ROOMS, robots=2)
    team.reset(seed=1)
    for actions, wrong in (({"robot_1": 0}, 2), ({"robot_1": 0, "robot_2": 0, "robot_9": 0}, 9)):
        with pytest.raises(InvalidAction, match=rf"actions: robot_{wrong} \(give one to each name"):
            team.step(actions)


@pytest.mark.parametrize("kind", [ExploreGrid, ExploreTeam])
def test_no_episode_goes_on(kind: type[ExploreGrid | ExploreTeam]) -> None:
    """Before the first reset, and after the end, steps are refused until the next reset."""
    environment = kind(ROOMS, steps=1, render_mode="rgb_array")
    action = 0 if kind is ExploreGrid else dict.fromkeys(environment.possible_agents, 0)
    for call in (lambda: environment.step(action), environment.render):
        with pytest.raises(ResetNeeded, match="call reset first"):
            call()
    for _ in range(2):
        environment.reset(seed=1)
        environment.step(action)
        with pytest.raises(ResetNeeded, match="call reset before the next step"):
            environment.step(action)
    assert environment.render() is not None


def test_a_world_of_one_cell(tmp_path: Path) -> None:
    """All robots stand on it, and the first step ends the episode, for all is known."""
    (tmp_path / "one.txt").write_text("3\n3\n111\n101\n111\n")
    scenario = {"environment": {"name": str(tmp_path / "one.txt")}}
    for action in ("heading", "frontier"):
        environment = ExploreGrid(scenario, action=action)
        _, facts = environment.reset(seed=1)
        assert facts["covered"] == 1.0
        assert environment.step(0)[2]
        team = ExploreTeam(scenario, robots=2, action=action)
        team.reset(seed=1)
        assert all(team.step({"robot_1": 0, "robot_2": 0})[2].values())
    with pytest.raises(UsarsimError, match=r"one\.txt: there is no room for a robot"):
        ExplorePhysics(str(tmp_path / "one.txt"))


@pytest.mark.parametrize("missing", ["gymnasium", "pettingzoo"])
def test_without_the_extra(missing: str, tmp_path: Path) -> None:
    """DOOR-13: one sentence with the pip command; everything else does without."""
    program = (
        "import sys, importlib.util as u\n"
        "import usarsim_server.__main__, usarsim_server.cli, usarsim_exploration.command\n"
        "assert not {'gymnasium', 'pettingzoo'} & set(sys.modules)\n"
        "find = u.find_spec\n"
        f"u.find_spec = lambda name: None if name == {missing!r} else find(name)\n"
        "import usarsim_exploration.gym\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert last == (
        "usarsim_server.base.extras.MissingLibraryError: "
        f'usarsim_exploration.gym: {missing} is not installed (pip install "usarsim-server[gym]")'
    )
