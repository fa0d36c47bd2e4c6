"""What a team's own programs hand in is moved, read back as it was meant, and judged at the end."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scripted import Script

from usarsim_mission.errors import MissionError
from usarsim_mission.grid import FREE, UNKNOWN, WALL, Grid
from usarsim_mission.hand_in import (
    Frame,
    Reported,
    refuse_old_hand_in,
    take_handed_in,
    write_hand_in,
)
from usarsim_mission.match.team import read_team

VICTIMS = (Reported(1, 5.2, 4.9, "conscious"), Reported(2, 9.0, 9.0))
ENDS = ("_victim.txt", "_victim_info.txt", "_map.tiff", "_map.tfw")


def _grid() -> Grid:
    """A room that is no mirror image of itself."""
    cells = np.full((30, 40), UNKNOWN, np.uint8)
    cells[3:9, 5:30] = FREE
    cells[3, 5:30] = WALL
    return Grid(-1.0, 2.0, 0.1, cells)


def _leave(folder: Path, frame: Frame) -> None:
    """The four files, of places in the world's frame or mirrored."""
    grid, victims = _grid(), VICTIMS
    if frame == "usarsim":
        high = grid.y + grid.cells.shape[0] * grid.cell
        grid = Grid(grid.x, -high, grid.cell, np.flipud(grid.cells))
        victims = tuple(replace(one, y=-one.y) for one in VICTIMS)
    write_hand_in(folder, "team", grid, victims, {})
    for path in folder.iterdir():
        if not path.name.endswith(ENDS):
            path.unlink()


@pytest.mark.parametrize("frame", ["world", "usarsim"])
def test_files_are_moved_and_read_back(tmp_path: Path, frame: Frame) -> None:
    """O-54: the same in either frame; what lay there before a run would count for it."""
    left, run = tmp_path / "left", tmp_path / "run"
    run.mkdir()
    _leave(left, frame)
    with pytest.raises(MissionError, match="move it away"):
        refuse_old_hand_in(left)
    told = dict(take_handed_in(left, run, frame))
    refuse_old_hand_in(left)
    grid, again = _grid(), Grid.unpacked(told["map"])
    assert (again.x, again.y, again.cell) == pytest.approx((grid.x, grid.y, grid.cell))
    assert np.array_equal(again.cells, grid.cells)
    assert told["hand_in"]["victims"] == [
        {"number": 1, "place": [5.2, 4.9, 0.0], "status": "conscious"},
        {"number": 2, "place": [9.0, 9.0, 0.0], "status": ""},
    ]
    assert len(list((run / "handed-in").iterdir())) == 4


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("team_map.tfw", "0.1\n0\n0\n0.1\n0\n0\n", "is no world file"),
        ("team_map.tfw", "nan 0 0 nan 0 0", "is no world file"),
        ("team_map.tiff", "what?", "is no picture"),
        ("team_map.tiff", "%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "is no picture"),
        ("team_map.tiff", "BM", "is no picture"),
        ("team_victim.txt", "Victim1, 1, 2, 0, VICTIM, 1\n", "END is missing"),
        ("team_victim.txt", "Victim1, nan, 2, 0, VICTIM, 1\nEND", "is no number"),
    ],
)
def test_what_is_wrong_has_a_cure(tmp_path: Path, name: str, text: str, why: str) -> None:
    _leave(tmp_path / "left", "world")
    (tmp_path / "left" / name).write_text(text)
    with pytest.raises(MissionError, match=why):
        list(take_handed_in(tmp_path / "left", tmp_path, "world"))


def test_what_is_handed_in_counts_at_the_end() -> None:
    """Like marks that are set then, by the rules of their zones; before the end it is nothing."""
    script = Script().start(60.0, R1=(5.0, 3.0))
    script.drive("R1", "controller")
    row = {"number": 1, "place": [5.5, 5.0, 0.0], "status": "conscious"}
    rows = [row, {**row, "number": 2}, {"number": 3, "place": [9.0, 9.0, 0.0]}]
    assert script.tell("hand_in", victims=rows) == []
    script.tell("trial_end", 30.0, why="operator")
    told = script.tell("hand_in", 31.0, victims=rows)
    assert [one["kind"] for one in told] == ["found", "credit", "duplicate", "wrong", "score"]
    assert {one["t_sim"] for one in told} == {30.0}
    values = script.referee.score["values"]
    assert (values["VF"], values["VC"], values["ST"], values["FM"]) == (1, 1.0, 1, 1)


def test_where_a_team_leaves_it(tmp_path: Path) -> None:
    """Seen from the folder in which its programs run; a run's own, if it says so."""
    path = tmp_path / "team.toml"
    (tmp_path / "bin").mkdir()
    path.write_text('name = "T"\ncommand = ["./go"]\nfolder = "bin"\nhand_in = "{run}/out"\n')
    assert read_team(path).hand_in_folder(tmp_path / "run") == tmp_path / "run" / "out"
    path.write_text('name = "T"\nwait = true\nfolder = "bin"\nhand_in = "out"\n')
    assert read_team(path).hand_in_folder(tmp_path / "run") == tmp_path / "bin" / "out"
    path.write_text('name = "T"\nconsole = true\nhand_in = "out"\n')
    with pytest.raises(MissionError, match="hand_in stands without"):
        read_team(path)
