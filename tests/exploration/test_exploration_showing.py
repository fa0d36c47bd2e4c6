"""Pictures and films of a run: overlays, the same picture everywhere, jumps, the command."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from small_world import ROOMS, small

from usarsim_exploration import run_folder
from usarsim_exploration.known_map import FREE, WALL
from usarsim_exploration.rendezvous import Meeting
from usarsim_exploration.running import Run, run
from usarsim_exploration.showing import overlays
from usarsim_exploration.showing.overlays import OVERLAYS
from usarsim_exploration.showing.picture import draw, overlays_of
from usarsim_exploration.showing.scene import Scene, Selection, layers_of, scene_of
from usarsim_exploration.showing.tape import Tape, tape_of
from usarsim_server import cli
from usarsim_server.base.errors import UsarsimError

SCALE, STRIP = 16, 18
"""Of a picture of the small world, pixels."""
LISTED = {
    "agents", "path", "free", "frontiers", "range", "selection", "meetings", "pairs",
}  # fmt: skip
"""On at start by the reference, whose safe space and sampled points are off."""


def taped(folder: Path, *options: str, **tables: object) -> Tape:
    """A run to its end."""
    tape = Tape(Run(small(folder, "end.base=off", *options, tables=tables or None)))
    while tape.advance():
        pass
    return tape


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """A step in which there is something of everything; two robots meet on both sides of a wall."""
    found = taped(tmp_path, "end.steps=14").scene(14)
    base, one, other = found.figures
    place = np.array([[10, 2]])
    chosen = Selection((20, 5), place, ((10, 2),), np.array([[6, 9], [16, 2]]), np.array([[16, 2]]))
    meeting = Meeting((10, 2), (16, 2), 20, (20, 9), 40)
    one = replace(one, meeting=meeting, selection=chosen, path=np.array([[9, 5], [8, 5]], np.int32))
    return replace(found, figures=(base, one, replace(other, role="relay", meeting=meeting)))


def changed(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Pixels that differ, (rows, columns)."""
    return (one != other).any(axis=2)


@pytest.mark.parametrize("name", OVERLAYS)
def test_a_toggle_switches_its_own_overlay(name: str, scene: Scene) -> None:
    """E-77: what changes with a toggle is what it draws alone, whatever else is drawn."""
    own = changed(draw(scene, {name}), draw(scene, ()))
    assert own[:-STRIP].any()
    assert not own[-STRIP:].any()
    others = set(OVERLAYS) - {name}
    found = changed(draw(scene, OVERLAYS), draw(scene, others))
    assert not (found & ~own).any()
    assert found.any() or OVERLAYS[name].by_cell


def test_the_overlays_that_are_drawn_by_default() -> None:
    """E-77: the default set is that of exploration reference 14, and ours beside it: known walls
    and links."""
    assert LISTED | {"obstacles", "links"} == overlays.DEFAULT
    assert overlays_of("") == overlays.DEFAULT
    assert overlays_of("safe,-links") == (overlays.DEFAULT | {"safe"}) - {"links"}
    assert overlays_of("none") == set()
    assert overlays_of("all,-safe") == set(OVERLAYS) - {"safe"}
    with pytest.raises(UsarsimError, match="there is no 'sfae'"):
        overlays_of("sfae")


def test_colours(scene: Scene) -> None:
    """Reference 14: unknown grey, explored white, known at base yellow, safe green, roles."""
    bits = scene.known(None)
    middles = draw(scene, {"free", "obstacles"})[:-STRIP][SCALE // 2 :: SCALE, SCALE // 2 :: SCALE]
    free = bits & (FREE | WALL) == FREE
    assert (middles[bits == 0] == overlays.UNKNOWN).all()
    assert (middles[bits & WALL != 0] == overlays.OBSTACLE).all()
    at_base = free & (scene.known(0) & FREE != 0)
    assert at_base.any()
    assert (middles[at_base] == overlays.KNOWN_AT_BASE).all()
    assert (middles[free & (scene.known(0) == 0)] == overlays.EXPLORED).all()
    for number, one in enumerate(scene.figures):
        agent = draw(scene, {"agents"}, number)[:-STRIP]
        assert (agent == overlays.ROLES[one.role]).all(axis=2).sum() > 30


def test_the_map_of_one_robot(scene: Scene) -> None:
    """A robot that was chosen shows its own map and plans; links are those of all."""
    alone = draw(scene, {"free"}, 1)[:-STRIP][SCALE // 2 :: SCALE, SCALE // 2 :: SCALE]
    unknown = scene.layers[2] == 0
    assert (alone[unknown] == overlays.UNKNOWN).all()
    assert changed(draw(scene, {"meetings"}, 2), draw(scene, {"meetings"}, 1)).any()
    links = draw(scene, {"links"}, 1)[:-STRIP]
    assert (links == draw(scene, {"links"})[:-STRIP]).all()


def test_steps_in_any_order(tmp_path: Path) -> None:
    """EXP-19: each step of a tape has the maps that the run had, also across blocks and doors."""
    door = {"step": 70, "kind": "close", "cells": [13, 4, 13, 6]}
    tape = Tape(Run(small(tmp_path, "end.base=off", "end.home=false", "end.steps=140",
                          tables={"event": [door]})))  # fmt: skip
    layers = [layers_of(tape.run.cycle)]
    while tape.advance():
        layers.append(layers_of(tape.run.cycle))
    layers.append(layers_of(tape.run.cycle))
    assert len(tape) == 141
    for step in (140, 3, 4, 64, 63, 69, 70, 127, 128, 0):
        found = tape.scene(step)
        assert (found.layers == layers[step]).all()
        for number, one in enumerate(found.figures):
            trail = found.trail(number)
            assert tuple(trail[-1]) == one.cell
            assert np.abs(np.diff(trail, axis=0)).max(initial=1) == 1  # cell by cell
    assert tape.scene(70).walls.sum() == tape.scene(69).walls.sum() + 3
    assert tape.shares[-1][0] >= max(tape.shares[-1][1:])


def test_the_map_of_a_result_is_the_last_picture(tmp_path: Path) -> None:
    """E-78: `map.png` and the last step come from the same drawer; also after bumps and a loss."""
    events = [
        {"step": 6, "kind": "close", "cells": [9, 4, 9, 9]},
        {"step": 8, "kind": "loss", "robot": "R2"},
    ]
    tape = taped(tmp_path, "end.steps=30", event=events)
    moves = tape.run.result().history.moves
    assert any("x" in text for text in moves.reshape(-1))
    shown = overlays.DEFAULT | {"trail"}
    last = draw(tape.scene(len(tape) - 1), shown)
    assert (draw(scene_of(tape.run.result()), shown) == last).all()


def test_a_jump_takes_less_than_200_ms(tmp_path: Path) -> None:
    """EXP-19: picture and file of any step of a long run; processor time, the median of some."""
    tape = taped(tmp_path, "end.home=false", "end.steps=600", strategy={"name": "nearest"})
    assert len(tape) == 601
    taken = []
    for step in (600, 17, 333, 63, 590, 2):
        begin = time.process_time()
        draw(tape.scene(step))
        taken.append(time.process_time() - begin)
    assert sorted(taken)[3] < 0.2


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """E-78: a PNG is the picture of the state; films and folders have a frame for each step."""
    folder = tmp_path / "out"
    run_folder.write(run(small(tmp_path, "end.steps=9", "end.base=off")), folder, {})

    def show(out: str, *options: str) -> int:
        return cli.main(["explore", "show", str(folder), "--out", str(tmp_path / out), *options])

    assert show("5.png", "--step=5", "--overlays=safe,-links") == 0
    tape = tape_of(folder)
    while tape.advance():
        pass
    wanted = draw(tape.scene(5), overlays_of("safe,-links"))
    assert (cv2.imread(str(tmp_path / "5.png"))[..., ::-1] == wanted).all()
    assert show("log.png", "--step=5", "--overlays=safe,-links,-path", "--from-log") == 0
    logged = cv2.imread(str(tmp_path / "log.png"))[..., ::-1]
    assert (logged == draw(tape.scene(5), overlays_of("safe,-links,-path"))).all()
    assert show("r2.png", "--robot=r2") == 0
    last = cv2.imread(str(tmp_path / "r2.png"))[..., ::-1]
    assert (last == draw(tape.scene(9), robot=2)).all()
    assert show("all.gif", "--every=4", "--fps=5") == 0
    with Image.open(tmp_path / "all.gif") as gif:
        assert gif.n_frames == 4  # steps 0, 4, 8, 9
        assert gif.info["duration"] == 200
    assert show("all.mp4") == 0
    assert cv2.VideoCapture(str(tmp_path / "all.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 10
    assert show("frames", "--every=5") == 0
    names = sorted(one.name for one in (tmp_path / "frames").iterdir())
    assert names == ["step-000000.png", "step-000005.png", "step-000009.png"]
    capsys.readouterr()
    for out, option, told in (
        ("x.png", "--step=10", "--step: 10 does not come (the run ends after 9)"),
        ("x.png", "--robot=R7", "--robot: R7 is not there (choose among Base, R1, R2)"),
        ("x.mp4", "--step=3", "--step: belongs to a picture"),
        ("x.jpg", "--every=2", "is of no known kind (choose .png, .mp4, .gif"),
        ("no/x.png", "--step=1", "no is not there"),
    ):
        assert show(out, option) == 2
        assert told in capsys.readouterr().err
        assert not (tmp_path / out).exists()


def test_a_log_of_another_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run that goes otherwise than its log says is not shown as if it were that one."""
    folder = tmp_path / "out"
    run_folder.write(run(small(tmp_path, "end.steps=9", "end.base=off")), folder, {})
    log = folder / "agents.csv"
    lines = log.read_text().splitlines()
    lines[-1] = lines[-1].replace("9,2,R2,", "9,2,R2,1")
    log.write_text("\n".join(lines) + "\n")
    assert cli.main(["explore", "show", str(folder), "--out", str(tmp_path / "a.png")]) == 2
    assert "step 9 is not that of the log" in capsys.readouterr().err
    assert ROOMS.count("\n") == 12
