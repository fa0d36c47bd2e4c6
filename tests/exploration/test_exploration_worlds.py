"""Maps of files, the environments that come with the benchmark, and where runs begin in them."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from usarsim_exploration.environment import Environment
from usarsim_exploration.scenario import merge, read
from usarsim_exploration.worlds import STARTS, draw_places, find, names
from usarsim_exploration.worlds.pictures import Rules, load_map, save_map
from usarsim_maps.grids.occupancy import load_grid
from usarsim_maps.reader import Context
from usarsim_server.base.errors import WorldError
from usarsim_server.cli import main

COMPAT = Rules(compat=True)


def painted(path: Path, pixels: NDArray[np.generic], mode: str | None = None) -> Path:
    """A picture file."""
    Image.fromarray(pixels, mode).save(path) if mode else Image.fromarray(pixels).save(path)
    return path


def walls_of(path: Path, rules: Rules = COMPAT) -> NDArray[np.uint8]:
    """The part of a small map that is not margin."""
    walls = load_map(path, rules).walls
    with Image.open(path) as image:
        columns, rows = image.size
    if rules.compat:
        left, top = (800 - columns) // 2, (600 - rows) // 2
        return walls[top : top + rows, left : left + columns]
    return walls


@pytest.mark.parametrize("rules", [Rules(), COMPAT])
def test_black_is_wall(tmp_path: Path, rules: Rules) -> None:
    """E-01: a picture of two levels, in our rules and in MRESim's."""
    pixels = np.random.default_rng(1).integers(0, 2, (30, 40)).astype(np.uint8) * 255
    path = painted(tmp_path / "map.png", pixels)
    assert np.array_equal(walls_of(path, rules), pixels == 0)


def test_the_first_band_decides(tmp_path: Path) -> None:
    """E-02: compat looks at red only."""
    pixels = np.array([[(0, 255, 0), (1, 1, 1), (255, 0, 0)]], np.uint8)
    assert walls_of(painted(tmp_path / "map.png", pixels)).tolist() == [[1, 0, 0]]


def test_palette_and_deep_grey(tmp_path: Path) -> None:
    """E-03: compat takes the index in a palette, and the sample of 16 bits."""
    image = Image.fromarray(np.array([[0, 1, 2]], np.uint8)).convert("P")
    image.putdata([0, 1, 2])
    image.putpalette([255, 255, 255, 0, 0, 0, 9, 9, 9])
    image.save(tmp_path / "palette.png")
    assert walls_of(tmp_path / "palette.png").tolist() == [[1, 0, 0]]
    deep = painted(tmp_path / "deep.png", np.array([[0, 1, 256, 65535]], np.uint16))
    assert walls_of(deep).tolist() == [[1, 0, 0, 0]]


def test_a_small_map_stands_in_the_middle(tmp_path: Path) -> None:
    """E-04: 505 x 304 begins at (147, 148); the margin is free in compat, else wall."""
    pixels = np.full((304, 505), 255, np.uint8)
    pixels[0, 0] = 0
    path = painted(tmp_path / "map.png", pixels)
    free = load_map(path, COMPAT).walls
    assert free.shape == (600, 800)
    assert np.argwhere(free).tolist() == [[148, 147]]
    walled = load_map(path, Rules(canvas=(800, 600))).walls
    assert np.count_nonzero(walled == 0) == 505 * 304 - 1
    assert not walled[148, 148]


def test_a_map_that_is_too_large(tmp_path: Path) -> None:
    """E-05: both sizes are named; the limit can be set."""
    path = painted(tmp_path / "map.png", np.full((10, 801), 255, np.uint8))
    with pytest.raises(WorldError, match=r"801 x 10 cells are more than 800 x 600 \(leave"):
        load_map(path, COMPAT)
    with pytest.raises(WorldError, match=r"801 x 10 cells are more than 700 x 700 \(make the map"):
        load_map(path, Rules(limit=(700, 700)))
    assert load_map(path, Rules()).shape == (10, 801)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_text_maps(tmp_path: Path, end: str) -> None:
    """E-06: any size and both line ends; a wrong row names its line."""
    path = tmp_path / "map.txt"
    path.write_bytes(end.join(["2", "3", "010", "001", ""]).encode())
    assert load_map(path, Rules()).walls.tolist() == [[0, 1, 0], [0, 0, 1]]
    path.write_bytes(end.join(["2", "3", "010", "01", ""]).encode())
    with pytest.raises(WorldError, match=r"map\.txt: line 4"):
        load_map(path, Rules())


@pytest.mark.parametrize("name", ["map.png", "map.txt"])
def test_saved_and_loaded(tmp_path: Path, name: str) -> None:
    """E-07: every cell."""
    walls = np.random.default_rng(2).integers(0, 2, (21, 35)).astype(np.uint8)
    save_map(Environment("map", walls), tmp_path / name)
    assert np.array_equal(load_map(tmp_path / name, Rules()).walls, walls)


@pytest.mark.parametrize(
    ("name", "digest"),
    [("lab", "a32b4fdb"), ("cave", "31aa6d45"), ("mine", "19031cd0"), ("maze", "c90f835a")],
)
def test_shipped_environments(name: str, digest: str) -> None:
    """EXP-04: all that is free can be reached, sixteen robots have room to start, and it is the
    environment whose results are published."""
    world = find(name)
    assert world.digest.startswith(digest)
    truth = world.environment
    assert np.count_nonzero(truth.reachable(world.base)) >= 0.99 * truth.free
    assert len({world.base, *world.starts}) == STARTS + 1
    assert all(map(truth.is_free, world.starts))
    assert max(abs(a - b) for a, b in zip(world.starts[0], world.base, strict=True)) <= 12


def test_enough_environments() -> None:
    """EXP-04: at least twelve."""
    assert len(names()) >= 12


def test_what_cannot_be_found(tmp_path: Path) -> None:
    """Each error says what to give instead."""
    with pytest.raises(WorldError, match="did you mean 'office'"):
        find("ofice")
    with pytest.raises(WorldError, match="no such file or world"):
        find(str(tmp_path / "map.png"))
    full = painted(tmp_path / "full.png", np.zeros((9, 9), np.uint8))
    with pytest.raises(WorldError, match="there is no free cell"):
        find(str(full))
    whole = painted(tmp_path / "whole.png", np.full((90, 90), 255, np.uint8)).read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[:60])
    with pytest.raises(WorldError, match=r"cut\.png"):
        find(str(tmp_path / "cut.png"))


CASES = Path(__file__).parents[1] / "maps" / "cases"


def test_pictures_with_grey_walls() -> None:
    """What `usarsim import` takes for a wall is one, and what was taken is told."""
    world = find(str(CASES / "17_grey_walls" / "grey_walls.png"))
    assert np.count_nonzero(world.environment.walls) == 216
    assert world.notes == ("grey_walls.png: walls are the 216 cells darker than 0.63 of white",)


def test_one_picture_is_read_alike(tmp_path: Path) -> None:
    """Walls and free cells of `usarsim import` and of exploration are the same."""
    pixels = np.random.default_rng(3).choice(np.array([90, 120, 200, 205, 254], np.uint8), (30, 40))
    path = painted(tmp_path / "map.png", pixels)
    grid = load_grid(path, Context())
    assert np.array_equal(load_map(path, Rules()).walls == 0, grid.free[::-1])


def test_the_yaml_file_beside_a_picture(tmp_path: Path) -> None:
    """Its scale counts, as in an import."""
    path = painted(tmp_path / "map.png", np.full((30, 40), 254, np.uint8))
    (tmp_path / "map.yaml").write_text("image: map.png\nresolution: 0.05\n")
    assert load_map(path, Rules()).cell == 0.05


def test_base_and_starts_are_inside(tmp_path: Path) -> None:
    """Of a hall with an outside that counts as free, also if a door of 1 m is open."""
    case = CASES / "08_hall"
    world = find(str(case / "hall_25.yaml"))
    with Image.open(case / "hall.pgm") as image:
        pixels = np.array(image)
    pixels[95:105, 139] = 254
    painted(tmp_path / "open.pgm", pixels)
    text = (case / "hall_25.yaml").read_text().replace("hall.pgm", "open.pgm")
    (tmp_path / "open.yaml").write_text(text)
    opened = find(str(tmp_path / "open.yaml"))
    white = find(
        str(painted(tmp_path / "white.png", np.where(pixels == 0, 0, 255).astype(np.uint8)))
    )
    for one in (world, opened, white):
        assert np.count_nonzero(one.environment.walls == 0) >= 39684
        assert len(one.starts) == STARTS
        for column, row in (one.base, *one.starts):
            assert 61 <= column <= 138
            assert 61 <= row <= 138
    for seed in range(10):
        drawn = draw_places(opened.environment, "", "drawn", seed)
        assert all(61 <= part <= 138 for part in drawn.base)


def test_a_base_that_is_stated_outside_has_its_robots_beside_it() -> None:
    """Whoever says where the base stands may say outside."""
    options = ["environment.name=" + repr(str(CASES / "08_hall" / "hall_25.yaml"))]
    scenario = read(merge({}, [*options, "team.robots=2", "team.base=[20, 20]"]))
    for one in scenario.team:
        assert max(one.cell) < 40


def test_a_run_begins_inside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`usarsim explore run` puts base and robots inside, and says what was read as free."""
    world, out = CASES / "08_hall" / "hall_25.yaml", tmp_path / "out"
    words = ["explore", "run", "--world", str(world), "--robots", "2", "--steps", "1"]
    assert main([*words, "--out", str(out)]) == 0
    assert "33600 cells of the grey of unknown ones" in capsys.readouterr().err
    scenario = tomllib.loads((out / "scenario.toml").read_text())
    for cell in (scenario["team"]["base"], *(robot["start"] for robot in scenario["robot"])):
        assert all(61 <= part <= 138 for part in cell)
