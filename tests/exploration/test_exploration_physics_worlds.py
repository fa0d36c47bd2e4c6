"""World folders, ROS maps, and the commands that list and make environments."""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from usarsim_exploration.commands import generate, worlds
from usarsim_exploration.worlds import find
from usarsim_exploration.worlds.generators import KINDS, Shape, draw
from usarsim_exploration.worlds.physics import write_world
from usarsim_exploration.worlds.world import clearance
from usarsim_server.base.errors import UsarsimError, WorldError


def usarsim_explore(*words: str) -> int:
    """Run `worlds` or `generate`."""
    parser = argparse.ArgumentParser()
    below = parser.add_subparsers()
    worlds.add_parser(below)
    generate.add_parser(below)
    arguments = parser.parse_args(words)
    return int(arguments.run(arguments))


@pytest.mark.parametrize("name", ["lab", "maze"])
def test_grid_and_physics_are_the_same_place(tmp_path: Path, name: str) -> None:
    """EXP-04: intersection over union of the free cells is at least 0.97; base and starts agree."""
    world = find(name)
    write_world(world, tmp_path / name)
    cut = find(str(tmp_path / name))
    free, other = world.environment.walls == 0, cut.environment.walls == 0
    assert free.shape == other.shape
    assert np.count_nonzero(free & other) >= 0.97 * np.count_nonzero(free | other)
    assert (cut.base, cut.starts) == (world.base, world.starts)


def test_a_world_of_the_server_is_cut() -> None:
    """Its walls are where its generator puts them: the corridor is 2.4 m wide and 20 m long."""
    world = find("smoke_corridor")
    truth = world.environment
    column, row = world.base
    assert truth.is_free((column, row))
    corridor = truth.walls[:, round((5.4 + 10.0) / truth.cell)] == 0
    assert np.count_nonzero(corridor) == pytest.approx(2.4 / truth.cell, abs=1)
    assert len(world.starts) == 16


def test_ros_maps(tmp_path: Path) -> None:
    """Unknown is wall, and the base stands at the origin."""
    pixels = np.full((60, 80), 254, np.uint8)
    pixels[:, :10], pixels[0] = 205, 0
    Image.fromarray(pixels).save(tmp_path / "map.pgm")
    sheet = "image: map.pgm\nresolution: 0.05\norigin: [-2.02, -1.02, 0.0]\n"
    (tmp_path / "map.yaml").write_text(sheet)
    world = find(str(tmp_path / "map.yaml"))
    assert np.array_equal(world.environment.walls != 0, pixels != 254)
    assert (world.base, world.environment.cell) == ((40, 39), 0.05)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_generators(kind: str) -> None:
    """EXP-04: the same seed gives the same cells, all of them connected; another one others."""
    shape = Shape(columns=200, rows=180, rooms=36)
    one, again, other = (draw(kind, shape, seed).walls for seed in (3, 3, 4))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    assert one.shape == (180, 200)
    assert 0.1 < np.count_nonzero(one == 0) / one.size < 0.99
    assert clearance(one).max() >= 4


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(sorted(KINDS)),
    shape=st.builds(
        Shape,
        columns=st.integers(100, 200),
        rows=st.integers(100, 200),
        rooms=st.integers(10, 400),
        doors=st.integers(8, 40),
        loops=st.floats(0.0, 1.0),
        clutter=st.floats(0.0, 0.3),
    ),
    seed=st.integers(0, 2**63 - 1),
)
def test_any_shape(kind: str, shape: Shape, seed: int) -> None:
    """Whatever is asked for, there is one connected space, or one error."""
    try:
        walls = draw(kind, shape, seed).walls
    except WorldError as error:
        if "leave hardly anything free" not in str(error):
            raise
        return
    assert walls.shape == (shape.rows, shape.columns)
    assert cv2.connectedComponents(1 - walls, connectivity=4)[0] == 2


def test_more_loops_more_doors() -> None:
    """A tree of rooms has the fewest doors."""
    few, many = (
        np.count_nonzero(draw("flats", Shape(loops=loops, clutter=0.0), 1).walls)
        for loops in (0.0, 1.0)
    )
    assert few - many > 20 * 2 * 10


def test_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is made can be listed again; JSON names all facts."""
    out = tmp_path / "mine.png"
    words = ["--columns", "200", "--rows", "150", "--rooms", "36", "--seed", "7", "--out", str(out)]
    assert usarsim_explore("generate", "office", *words) == 0
    assert "200 x 150" in capsys.readouterr().out
    assert usarsim_explore("worlds", str(out), "--json", "--out", str(tmp_path / "w")) == 0
    (facts,) = json.loads(capsys.readouterr().out)
    assert (facts["name"], facts["columns"], len(facts["starts"])) == ("mine", 200, 16)
    assert (tmp_path / "w" / "scene.xml").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["generate", "ofice", "--out", "x.png"], "did you mean 'office'"),
        (["generate", "cave", "--loops", "2", "--out", "x.png"], "from 0 to 1"),
        (["generate", "cave", "--rooms", "many", "--out", "x.png"], "rooms: 'many'"),
        (["worlds", "--out", "x.png"], "no world is named"),
    ],
)
def test_wrong_words(words: list[str], told: str) -> None:
    """One line with the cure."""
    with pytest.raises(UsarsimError, match=told):
        usarsim_explore(*words)
