"""MRESim's rules, on worlds of ours: what its robots do, not how fast it is on its own maps."""

from pathlib import Path

import numpy as np
import pytest
from small_world import small

from usarsim_exploration.frontiers import Frontier
from usarsim_exploration.history import History
from usarsim_exploration.known_map import KnownMap
from usarsim_exploration.mresim import planning
from usarsim_exploration.running import run
from usarsim_exploration.scenario import read

RUN = "mresim=true", "links=before"


def office(seed: int, *, mresim: bool, strategy: str = "frontier") -> History:
    """Four robots in a shipped environment."""
    content: dict[str, object] = {
        "seed": seed,
        "links": "before",
        "mresim": mresim,
        "environment": {"name": "office"},
        "team": {"robots": 4},
        "strategy": {"name": strategy},
        "end": {"of": "all", "base": "off", "steps": 1500},
    }
    return run(read(content)).history


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["frontier", "ratio"])
def test_runs_need_more_steps(strategy: str) -> None:
    """EXP-23: means over seeds, 1.1 times those of the default at least; no share above all."""

    def steps(*, mresim: bool) -> float:
        runs = [office(seed, mresim=mresim, strategy=strategy) for seed in (1, 2, 3)]
        assert all((one.known_team <= one.reachable).all() for one in runs)
        return float(np.mean([np.argmax(one.known_team >= 0.9 * one.reachable) for one in runs]))

    assert steps(mresim=True) >= 1.1 * steps(mresim=False) > 0


def test_first_steps_are_random_and_repeat(tmp_path: Path) -> None:
    """By seed; by the default rules all seeds are alike."""

    def starts(*options: str) -> list[object]:
        histories = [run(small(tmp_path, f"seed={n}", "end.steps=3", *options)) for n in range(8)]
        return [str(one.history.cell.tolist()) for one in histories]

    assert starts(*RUN) == starts(*RUN)
    assert len(set(starts(*RUN))) > 2
    assert len(set(starts("links=before"))) == 1


def test_robots_in_contact_plan_at_every_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that hears the base plans at each step, but after a plan that led nowhere."""
    planned: list[KnownMap] = []
    find = planning.find_frontiers

    def noted(known: KnownMap) -> list[Frontier]:
        planned.append(known)
        return find(known)

    monkeypatch.setattr(planning, "find_frontiers", noted)
    team = {"robots": 1, "base": [3, 3], "speed": 1.0, "reach": 8, "radio": 1.0}
    radio = {"model": "circle", "sum_of_ranges": True}
    counted = []
    for base_radio in (100.0, 0.0):
        planned.clear()
        tables: dict[str, object] = {"team": team | {"base_radio": base_radio}, "radio": radio}
        run(small(tmp_path, *RUN, "end.steps=23", "end.base=off", tables=tables))
        counted.append(len(planned))
    contact, alone = counted
    assert contact >= 10 > alone


def test_range_of_a_pair_is_that_of_the_lower_number(tmp_path: Path) -> None:
    """D6: a base of 20 cells is heard by a robot of 2 over 10."""
    tables: dict[str, object] = {"radio": {"model": "path-loss"}}
    options = "team.robots=1", "team.radio=2", "team.base_radio=20", "team.base=[3,3]"
    robot: dict[str, object] = {"robot": [{"name": "A", "start": [11, 3]}]}
    linked = [
        run(small(tmp_path, *options, *rules, "end.steps=1", tables=tables | robot)).history
        for rules in ((), RUN)
    ]
    assert [bool(one.linked_base[0, 1]) for one in linked] == [False, True]


def test_frontiers_are_what_is_not_certain() -> None:
    """Their middle is inside of an outline, not on it; the unknown has to touch them."""
    known = KnownMap((60, 60))
    cells = np.array([row * 60 + column for row in range(10, 50) for column in range(10, 50)])
    known.write(0, cells, np.full(len(cells), 1, np.uint8))
    (found,) = planning.find_frontiers(known)
    assert found.size == 39 * 39 + 4 * 39
    column, row = found.centre
    assert 24 <= column <= 29  # less than 29.5, as the outline counts, too
    assert column == row


@pytest.mark.parametrize(("options", "explores"), [(("rules=1",), True), ((), False), (RUN, False)])
def test_relays_that_shall_not_explore(
    tmp_path: Path, options: tuple[str, ...], explores: bool
) -> None:
    """They wait, but by rules 1, which did not heed it."""
    role = "strategy.name=role-based", "strategy.relay_explores=false", "end.base=off"
    history = run(small(tmp_path, *role, "end.steps=60", *options)).history
    relay = history.role[:, 1] == "relay"
    assert bool((history.state[relay, 1] == "explore").any()) is explores
