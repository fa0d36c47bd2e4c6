"""Learns by the cross-entropy method which frontier to go to next, with numpy alone.

python examples/learn_exploration.py --curve curve.png

A frontier's score is a weighted sum of six features of what the robot sees; the robot goes to the
best one. Each generation draws weights, plays them all in the same worlds, and moves to the best
quarter. What was learned is then compared with chance, and with the nearest frontier, in worlds
that nobody has seen. The same seed gives the same figures on any number of processes.
"""

from __future__ import annotations

import argparse
import csv
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Observation = dict[str, Any]

FEATURES = ("way", "way of the nearest", "size", "ahead", "unknown around", "as last")
POPULATION, ELITE, EPISODES, GENERATIONS = 20, 5, 6, 8
TESTS = 60
"""Worlds of the comparison; of the curve a third."""
STEPS = 150
"""Of an episode at the most."""
TRAINING, TESTING = 1, 100_001
"""Seeds of the first worlds."""
WORLDS = 16
"""Worlds of the training."""
AROUND = 10
"""Patches of the map in each direction from a frontier that count, of 0.25 m by 0.21 m."""
METRES = 12.0, 10.0
"""Size of the worlds: width, height."""


@cache
def environment(first: int, worlds: int) -> gymnasium.Env[Observation, np.int64]:
    """Small buildings of one kind; made once in each process."""
    building = {"generator": "flats", "columns": 120, "rows": 100, "rooms": 30, "seed": first}
    return gymnasium.make(
        "usarsim_exploration.gym:usarsim/ExploreFrontiers-v0",
        disable_env_checker=True, worlds=worlds,
        scenario={"environment": building, "team": {"reach": 50, "speed": 5}}, steps=STEPS,
        time_cost=0.5,
    )  # fmt: skip


def features(seen: Observation, last: Array | None) -> Array:
    """(8, 6) of each frontier; rows without a frontier mean nothing.

    Args:
        seen: see docs/gym.md. last: where the frontier of the last step was, m; None: none yet.
    """
    table, pose = seen["frontiers"].astype(float), seen["pose"].astype(float)
    way, size, right, down = table[:, 1:].T
    places = np.stack([right, down], 1) + pose[:2] * METRES
    apart = np.maximum(np.hypot(right, down), 0.1)
    ahead = (right * pose[2] + down * pose[3]) / apart
    unknown = 1.0 - (seen["map"][0].astype(float) + seen["map"][1]) / 255.0
    patches = np.clip(places / METRES * 48, 0, 47).astype(int)
    padded = np.pad(unknown.clip(0.0), AROUND)  # outside nothing is unknown
    side = 2 * AROUND + 1
    around = [padded[row : row + side, column : column + side].mean() for column, row in patches]
    kept = np.zeros(8) if last is None else np.exp(-np.hypot(*(places - last).T))
    nearest = np.where(np.arange(8) == 0, 1.0, 0.0)
    return np.stack([way / 10.0, nearest, size / 5.0, ahead, np.array(around), kept], 1)


Policy = Callable[[Observation, NDArray[np.int8], Array | None], int]


def best(weights: Array, seen: Observation, mask: NDArray[np.int8], last: Array | None) -> int:
    """The frontier with the highest score."""
    scores = np.where(mask == 1, features(seen, last) @ weights, -np.inf)
    return int(np.argmax(scores))


def nearest(seen: Observation, mask: NDArray[np.int8], last: Array | None) -> int:
    """The first one: they stand in order."""
    return 0


class Chance:
    """Any frontier, drawn anew in every step."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def __call__(self, seen: Observation, mask: NDArray[np.int8], last: Array | None) -> int:
        return int(self._random.choice(np.flatnonzero(mask)))


def play(policy: Policy, seed: int, first: int = TRAINING, worlds: int = WORLDS) -> float:
    """The return of an episode, m2."""
    env = environment(first, worlds)
    seen, facts = env.reset(seed=seed)
    total, over, last = 0.0, False, None
    while not over:
        choice = policy(seen, facts["action_mask"], last)
        last = seen["frontiers"][choice, 3:] + seen["pose"][:2] * METRES
        seen, reward, ended, cut, facts = env.step(np.int64(choice))
        total, over = total + float(reward), ended or cut
    return total


def trial(weights: Array, seeds: tuple[int, ...]) -> float:
    """The mean return of weights."""
    return float(np.mean([play(partial(best, weights), seed) for seed in seeds]))


def test(what: str, weights: Array, number: int) -> float:
    """The return of a way to choose in one of the worlds of the comparison."""
    policies: dict[str, Policy] = {
        "chance": Chance(number), "nearest": nearest, "learned": partial(best, weights),
    }  # fmt: skip
    return play(policies[what], number, TESTING + number, 1)


def compare(pool: ProcessPoolExecutor, what: str, weights: Array, worlds: int) -> Array:
    """Returns (worlds,) in worlds that nobody has seen."""
    return np.array(list(pool.map(partial(test, what, weights), range(worlds))))


def learn(
    pool: ProcessPoolExecutor, seed: int, generations: int, worlds: int
) -> tuple[Array, list[tuple[float, float]]]:
    """Learn.

    Args:
        worlds: of the curve, which nobody learns from.

    Returns:
        The weights that were learned; of each generation the mean return of what it drew, and the
        return in these worlds of what it came to.
    """
    random = np.random.default_rng(seed)
    mean, spread = np.zeros(len(FEATURES)), np.ones(len(FEATURES))
    curve = []
    for generation in range(generations):
        drawn = mean + spread * random.standard_normal((POPULATION, len(FEATURES)))
        seeds = tuple(random.integers(2**31, size=EPISODES).tolist())
        returns = np.array(list(pool.map(trial, drawn, [seeds] * POPULATION)))
        elite = drawn[np.argsort(-returns, kind="stable")[:ELITE]]
        # some spread is added, less each time, lest it settles too early
        mean = elite.mean(axis=0)
        spread = elite.std(axis=0) + 0.3 * (1.0 - generation / generations)
        reached = float(compare(pool, "learned", mean, worlds).mean())
        curve.append((float(returns.mean()), reached))
        print(f"generation {generation + 1:2}: {curve[-1][0]:6.1f}, unseen {reached:6.1f} m2",
              flush=True)  # fmt: skip
    return mean, curve


def draw(path: Path, curve: list[tuple[float, float]], tests: dict[str, Array]) -> None:
    """The curve as a picture."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 4.0), layout="constrained")
    numbers = range(1, len(curve) + 1)
    axes.plot(numbers, [one[0] for one in curve], label="training: mean of what was drawn")
    axes.plot(numbers, [one[1] for one in curve], "o-", label="unseen worlds: what was learned")
    for name, style in (("chance", "--"), ("nearest", "-.")):
        level = tests[name][: len(tests[name]) // 3].mean()
        axes.axhline(level, color="0.4", ls=style, lw=1, label=f"unseen worlds: {name}")
    axes.set(xlabel="generation", ylabel="return, m²", xlim=(1, len(curve)))
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def main() -> None:
    """Learn, compare, say so."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--generations", type=int, default=GENERATIONS)
    parser.add_argument("--tests", type=int, default=TESTS, help="worlds of the comparison")
    parser.add_argument("--curve", type=Path, metavar="FILE", help="draw it there (matplotlib)")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write it there")
    given = parser.parse_args()
    begun = time.monotonic()
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        weights, curve = learn(pool, given.seed, given.generations, max(given.tests // 3, 1))
        trained = time.monotonic() - begun
        tests = {
            name: compare(pool, name, weights, given.tests)
            for name in ("chance", "nearest", "learned")
        }
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"learned in {trained:.0f} s; {spent.ru_utime + spent.ru_stime:.0f} s of processors in all"
    )
    for name, weight in zip(FEATURES, weights, strict=True):
        print(f"  {name:20} {weight:6.2f}")
    print(f"returns in {given.tests} worlds that nobody has seen, mean and standard error:")
    for name, returns in tests.items():
        error = returns.std() / np.sqrt(len(returns))
        print(f"  {name:20} {returns.mean():6.1f} {error:5.1f}")
    if given.csv is not None:
        with given.csv.open("w", newline="") as file:
            csv.writer(file).writerows([("drawn", "unseen"), *curve])
    if given.curve is not None:
        draw(given.curve, curve, tests)


if __name__ == "__main__":
    main()
