"""Small scenarios that came out wrong, with their right values; old rules give the old ones."""

from pathlib import Path

import numpy as np
import pytest
from lanes import slow_but
from small_world import SEALED, small

from usarsim_exploration import run_folder
from usarsim_exploration.history import History
from usarsim_exploration.running import run
from usarsim_exploration.scenario import load, read
from usarsim_server.base.errors import UsarsimError

CASES = Path(__file__).parent / "cases"


def shared(history: History) -> float:
    """Part of the steps, after the start, in which two robots are in one cell."""
    cells = [{tuple(one) for one in row} for row in history.cell[1:, 1:].tolist()]
    return float(np.mean([len(one) < history.robots for one in cells]))


@pytest.mark.parametrize(("name", "least"), [("15/maze1.txt", 1), ("16/slanted.txt", 2)])
def test_a_map_is_explored(name: str, least: int) -> None:
    """Narrow passages are explored, corners are not looked through, no share is above 100 %."""
    place = {"environment": {"name": str(CASES / name)}, "team": {"robots": 1}}
    result = run(read(place))
    history = result.history
    assert result.ended == "base knows"
    assert history.steps >= least
    assert 0.95 <= history.known_base[-1] / history.reachable[-1] <= 1.0
    assert (history.known_team <= history.reachable).all()


@pytest.mark.parametrize(
    "strategy", ["frontier", "minpos", "voronoi", "market", "greedy", "nearest"]
)
def test_robots_in_one_cell_part(strategy: str) -> None:
    """Four that start in one cell of a crossing take its four arms."""
    result = run(load(CASES / "22" / "tie.toml", [f"strategy.name={strategy}"]))
    assert result.ended == "base knows"
    assert result.history.steps < 12
    assert shared(result.history) <= 0.2


def test_old_rules_leave_them_together() -> None:
    """Results of rules 1 come out as they did."""
    result = run(load(CASES / "22" / "tie.toml", ["strategy.name=minpos", "rules=1"]))
    assert shared(result.history) == 1.0


def test_a_door_opens_more() -> None:
    """Shares are those of what is reachable now, and the second room has to be known as well."""
    result = run(load(CASES / "21" / "open2.toml"))
    history = result.history
    assert result.ended == "base knows"
    assert history.reachable[2] < history.reachable[3] == history.reachable[-1]
    assert (history.known_team <= history.reachable).all()
    assert history.known_base[-1] >= 0.95 * history.reachable[-1]


@pytest.mark.parametrize("waits", [False, True])
def test_an_event_to_come(waits: bool) -> None:
    """It is waited for if the scenario says so; else results name it."""
    options = ["end.base=60", f"end.events={str(waits).lower()}"]
    result = run(load(CASES / "21" / "open2.toml", options))
    told = run_folder.facts(result).get("unawaited", [])
    assert (result.history.steps >= 3) is waits
    assert [one["step"] for one in told] == ([] if waits else [3])  # type: ignore[attr-defined]


def test_what_is_closed_around_the_base_does_not_count(tmp_path: Path) -> None:
    """A robot in another room knows cells that cannot be reached: none of them is a share."""
    rows = [{"start": [5, 3]}, {"start": [20, 3]}]
    team = {"base": [3, 3], "reach": 8, "speed": 2.0, "radio": 60.0}
    history = run(small(tmp_path, picture=SEALED, tables={"team": team, "robot": rows})).history
    assert (history.known_team <= history.reachable).all()
    assert (history.free_team > history.known_team).all()


@pytest.mark.parametrize("silent", ["team.radio=0", "team.base_radio=0"])
@pytest.mark.parametrize("model", ["circle", "sight", "path-loss"])
def test_a_radio_without_range_has_no_links(tmp_path: Path, model: str, silent: str) -> None:
    """Whatever the model."""
    history = run(small(tmp_path, f"radio.model={model}", silent, "end.steps=10")).history
    assert not history.linked_base[:, 1:].any()


def test_nobody_is_home_while_data_is_not() -> None:
    """A narrow link brings all in the end."""
    content = {
        "environment": {"name": "lab"},
        "team": {"robots": 2},
        "radio": {"bandwidth": 100},
    }
    result = run(read(content))
    assert result.ended == "base knows"
    assert result.history.known_base[-1] >= 0.95 * result.history.reachable[-1]


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["frontier", "next-best-view"])
@pytest.mark.parametrize(
    ("noise", "least"),
    slow_but(lambda one: one[0] == 3.0, [(0.5, 0.95), (1.0, 0.92), (3.0, 0.86)]),
)
def test_noise_does_not_end_runs_early(noise: float, least: float, strategy: str) -> None:
    """One bad beam makes no certain wall."""
    content = {
        "environment": {"name": "lab"},
        "team": {"robots": 2, "noise": noise},
        "strategy": {"name": strategy},
    }
    result = run(read(content))
    assert result.history.known_base[-1] >= least * result.history.reachable[-1]


def test_a_picture_that_is_none(tmp_path: Path) -> None:
    """It is said in words, not as a reader's own KeyError."""
    (tmp_path / "none.png").write_bytes(b"hello")
    with pytest.raises(UsarsimError, match=r"none\.png: the picture cannot be read") as told:
        read({"environment": {"name": str(tmp_path / "none.png")}})
    assert "KeyError" not in str(told.value)
