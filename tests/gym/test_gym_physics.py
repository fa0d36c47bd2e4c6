"""The environment in MuJoCo: what it sees, what a reset keeps, what two of them share."""

import copy
import math
import pickle
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import gymnasium
import mujoco
import numpy as np
import psutil
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env

from usarsim_exploration.gym import ExploreGrid, ExplorePhysics
from usarsim_exploration.known_map import FREE, WALL
from usarsim_server.base.errors import UsarsimError

ROOM = """\
14
26
11111111111111111111111111
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
10000000000000000000000001
11111111111111111111111111
"""
"""2.6 m by 1.4 m, with 0.1 m of wall."""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The name of a map file."""
    path = tmp_path_factory.mktemp("gym") / "room.txt"
    path.write_text(ROOM)
    return str(path)


@pytest.fixture(scope="module")
def lab() -> ExplorePhysics:
    """A building; tests reset it."""
    return ExplorePhysics(noise=0.01)


def play(environment: ExplorePhysics, steps: int, seed: int) -> list[tuple[object, ...]]:
    """What comes of random actions in an episode."""
    random = np.random.default_rng(seed)
    observation, _ = environment.reset(seed=seed)
    told = [tuple(one.tobytes() for one in observation.values())]
    for _ in range(steps):
        action = random.uniform(-1.0, 1.0, 2).astype(np.float32)
        observation, reward, *_ = environment.step(action)
        told.append((reward, *(one.tobytes() for one in observation.values())))
    return told


def test_gymnasium_checks_it() -> None:
    """DOOR-11: check_env, unchanged; warnings are errors in this suite."""
    check_env(gymnasium.make("usarsim/ExplorePhysics-v0").unwrapped)


def test_a_reset_compiles_nothing(lab: ExplorePhysics) -> None:
    """DOOR-11, DOOR-12: the second episode of a seed is the first, bit by bit, and costs little."""
    first = play(lab, 20, 1)
    with mock.patch.object(mujoco, "MjSpec", side_effect=AssertionError("compiled")):
        other = play(lab, 20, 2)
        begun = time.process_time()
        lab.reset(seed=1)
        taken = time.process_time() - begun
        again = play(lab, 20, 1)
    assert again == first
    assert other != first
    assert taken < 0.05


def test_two_do_not_meet(room: str) -> None:
    """DOOR-12: two in turn are each as if alone."""
    one, other, alone = (ExplorePhysics(room, noise=0.02) for _ in range(3))
    for seed in (1, 2):
        one.reset(seed=seed)
        other.reset(seed=seed + 10)
        for _ in range(5):
            told = [one.step(np.ones(2, np.float32))[0], other.step(-np.ones(2, np.float32))[0]]
        alone.reset(seed=seed)
        for _ in range(5):
            expected = alone.step(np.ones(2, np.float32))[0]
        assert all(np.array_equal(told[0][key], expected[key]) for key in expected)
        assert not np.array_equal(told[0]["ranges"], told[1]["ranges"])


def test_what_it_sees_is_there(room: str) -> None:
    """Ranges and pose agree with the walls; the map has walls where they are and nothing else."""
    environment = ExplorePhysics(room, coverage=1.0)
    observation, facts = environment.reset(seed=3)
    for _ in range(40):  # once around
        observation, _, _, _, facts = environment.step(np.array([0.0, 1.0], np.float32))
    x, y, heading = facts["x"], facts["y"], facts["heading"]
    assert observation["pose"][:2] == pytest.approx((x / 2.6, 1 - y / 1.4), abs=1e-6)
    assert observation["pose"][2:4] == pytest.approx((math.cos(heading), math.sin(heading)))
    assert observation["velocity"][1] == pytest.approx(1.5, abs=0.2)
    # the beam ahead, from the range finder 0.2085 m before the middle; y is up, headings are not
    start = x + 0.2085 * math.cos(heading), y - 0.2085 * math.sin(heading)
    ways = [
        (side - place) / part
        for place, part, sides in zip(
            start, (math.cos(heading), -math.sin(heading)), ((0.1, 2.5), (0.1, 1.3)), strict=True
        )
        for side in sides
    ]
    expected = min(way for way in ways if way > 0.0)
    assert observation["ranges"][90] == pytest.approx(expected, abs=0.02)
    bits, walls = environment.level.charts[1].bits, environment.level._world.environment.walls
    assert not ((bits & (FREE | WALL) == FREE) & (walls == 1)).any()
    assert not ((bits & WALL != 0) & (walls == 0)).any()
    assert facts["covered"] > 0.9


def test_a_wall_costs(room: str) -> None:
    """Pushing a wall is a collision; standing is none."""
    environment = ExplorePhysics(room)
    environment.reset(seed=1)
    _, reward, _, _, facts = environment.step(np.zeros(2, np.float32))
    assert not facts["collided"]
    for _ in range(30):
        _, reward, _, _, facts = environment.step(np.array([1.0, 0.0], np.float32))
    assert facts["collided"]
    assert reward == pytest.approx(-0.12, abs=0.05)


def test_odometry_drifts(lab: ExplorePhysics) -> None:
    """A pose by the wheels alone begins at the truth and turns too far."""
    drifting = ExplorePhysics(localisation="odometry")
    observation, facts = drifting.reset(seed=1)
    cosine, sine = math.cos(facts["heading"]), math.sin(facts["heading"])
    assert observation["pose"][2:4] == pytest.approx((cosine, sine), abs=1e-6)
    for _ in range(10):
        observation, _, _, _, facts = drifting.step(np.array([0.0, 1.0], np.float32))
    told = math.atan2(observation["pose"][3], observation["pose"][2])
    assert math.remainder(told - facts["heading"], math.tau) > 0.3
    assert drifting.level.covered > 0.0


def test_vectors(room: str) -> None:
    """Several in one process, each with its own luck."""
    some = gymnasium.make_vec(
        "usarsim_exploration.gym:usarsim/ExplorePhysics-v0",
        2,
        vectorization_mode="sync",
        world=room,
    )
    observation, _ = some.reset(seed=[1, 2])
    assert observation["ranges"].shape == (2, 181)
    assert not np.array_equal(*observation["ranges"])
    some.close()


def test_memory_stays(room: str) -> None:
    """DOOR-12 in small: steps with resets leave nothing; `make bench ARGS=gym` makes 100,000."""
    physics = ExplorePhysics(room, steps=20)
    grid = ExploreGrid({"environment": {"name": room}}, steps=20)
    process = psutil.Process()
    for round_ in range(5):
        for environment in (physics, grid):
            environment.action_space.seed(round_)
            environment.reset(seed=round_)
            for _ in range(30):
                _, _, ended, cut, _ = environment.step(environment.action_space.sample())
                if ended or cut:
                    environment.reset()
        if round_ == 1:
            before = process.memory_info().rss
    assert process.memory_info().rss - before < 10e6


def test_a_picture(room: str) -> None:
    """rgb_array: the map in colours; without it nothing."""
    environment = ExplorePhysics(room, render_mode="rgb_array")
    environment.reset(seed=1)
    picture = environment.render()
    assert picture is not None
    assert picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) >= 4
    assert ExplorePhysics(room).render() is None


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"robot": "P3TA"}, "there is no class 'P3TA'"),
        ({"robot": "AirRobot"}, "name a skid_steer one"),
        ({"speed": 0.0}, "speed: 0.0 m/s"),
        ({"reach": 0.05}, "max_range"),
        ({"localisation": "stars"}, "write truth or odometry"),
        ({"world": "lap"}, "lap: no such environment"),
    ],
)
def test_wrong_words(arguments: dict[str, object], told: str, room: str) -> None:
    """One line with the cure."""
    with pytest.raises(UsarsimError, match=told):
        ExplorePhysics(**{"world": room, **arguments})  # type: ignore[arg-type]


@pytest.mark.parametrize("action", [[2.0, 0.0], [np.nan, 0.0], np.zeros(3), 0.5, None, "left"])
def test_actions_out_of_the_space(action: object, lab: ExplorePhysics) -> None:
    """An error of Gymnasium's kind that says which there are; numbers of all types are read."""
    lab.reset(seed=1)
    with pytest.raises(InvalidAction, match=r"action: .* \(give 2 numbers from -1 to 1\)"):
        lab.step(action)
    for good in ([1, -1], (0.5, 0.5), np.ones(2, np.float64)):
        lab.step(good)


def test_no_episode_goes_on(room: str) -> None:
    """Before the first reset, and after the end, steps are refused."""
    environment = ExplorePhysics(room, steps=1)
    still = np.zeros(2, np.float32)
    with pytest.raises(ResetNeeded, match="call reset first"):
        environment.step(still)
    environment.reset(seed=1)
    environment.step(still)
    with pytest.raises(ResetNeeded, match="call reset before the next step"):
        environment.step(still)


@pytest.mark.parametrize("twin", [copy.deepcopy, pickle.dumps])
def test_copies_are_refused(twin: Callable[[object], object], lab: ExplorePhysics) -> None:
    """What MuJoCo has compiled cannot be copied; the error says what to do instead."""
    with pytest.raises(TypeError, match="make another environment with the same arguments"):
        twin(lab)


def test_the_world_is_gone(room: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files that MuJoCo read leave nothing behind."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    ExplorePhysics(room)
    assert not list(tmp_path.iterdir())
