"""Who hears whom: laws, walls, chains; and what robots expect of them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.known_map import FREE, WALL, KnownMap
from usarsim_exploration.radio import (
    Circle,
    Links,
    PathLoss,
    Radio,
    RadioEstimate,
    Sight,
    create_radio,
    find_links,
    outline,
    radio_names,
)
from usarsim_exploration.radio.families.recorded import HEADER, Recorded, read_links
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.tables import Table
from usarsim_server.radio.configuration import read_radio
from usarsim_server.radio.models import PRESETS

MRESIM = PathLoss()


def corridor(*walls: int, thick: int = 1) -> Environment:
    """A long one, with walls across it."""
    cells = np.zeros((3, 460), np.uint8)
    for column in walls:
        cells[:, column : column + thick] = 1
    return Environment("corridor", cells)


def linked(radio: Radio, world: Environment, away: int, reach: float = 200.0) -> bool:
    """Whether two robots hear each other along the corridor."""
    cells: list[Cell] = [(2, 1), (2 + away, 1)]
    return bool(find_links(radio, world, cells, [reach, reach]).direct[0, 1])


@pytest.mark.parametrize(
    ("walls", "last"), [((), 199), ((10,), 142), ((10, 20), 102), ((10, 20, 30), 72)]
)
def test_walls_shorten_the_range(walls: tuple[int, ...], last: int) -> None:
    """E-32, E-33: the last cell with a link, and none beyond."""
    assert linked(MRESIM, corridor(*walls), last)
    assert not linked(MRESIM, corridor(*walls), last + 1)


def test_a_thick_wall_counts_once() -> None:
    """E-34: unless cells count."""
    cells = PathLoss(count="cells")
    for radio, same in ((MRESIM, True), (cells, False)):
        thick, thin = corridor(10, thick=20), corridor(10)
        assert (linked(radio, thick, 100) == linked(radio, thin, 100)) is same


def test_a_robot_expects_less() -> None:
    """E-35: 181 cells, 125 behind a wall, 86 behind two; 14 unknown cells are one more."""
    known = KnownMap((3, 460))
    known.bits[:] = FREE
    expects = RadioEstimate(MRESIM, known, 200.0, 0.1)

    def reaches(away: int) -> bool:
        known.version += 1
        return bool(expects.reaches(np.array([[2, 1]]), np.array([[2 + away, 1]]))[0, 0])

    assert reaches(181)
    assert not reaches(182)
    known.bits[:, 10] = WALL
    assert reaches(125)
    assert not reaches(126)
    known.bits[:, 20] = WALL
    assert reaches(86)
    assert not reaches(87)
    known.bits[:] = FREE
    known.bits[:, 10:23] = 0
    assert reaches(125)  # one run that is not free
    known.bits[:, 10:24] = 0
    assert reaches(86)
    assert not reaches(87)


def test_strength_falls() -> None:
    """E-36: with distance and with walls, strictly: it is no product."""
    model = PRESETS["mresim"]
    assert model.strength(50, 0) > model.strength(60, 0) > model.strength(60, 1)
    assert model.strength(60, 1) > model.strength(60, 2)


def test_circles() -> None:
    """E-38: MRESim adds the ranges, ours takes the smaller one."""
    world = corridor(10)
    assert linked(Circle(), world, 199)
    assert not linked(Circle(), world, 200)
    summed = Circle(sum_of_ranges=True)
    assert linked(summed, world, 399)
    assert not linked(summed, world, 400)


def test_one_cell_cuts_the_sight() -> None:
    """E-39."""
    assert linked(Sight(), corridor(), 100)
    assert not linked(Sight(), corridor(50), 100)


def test_a_chain_links_its_ends() -> None:
    """E-40: A with C in the same step, but not directly."""
    links = find_links(Circle(), corridor(), [(0, 1), (90, 1), (180, 1)], [100.0] * 3)
    assert not links.direct[0, 2]
    assert links.closed[0, 2]
    assert links.groups() == [[0, 1, 2]]
    assert Links(np.zeros((3, 3), bool)).groups() == []


def made(**content: object) -> Radio:
    """The model of a `[radio]` table with these keys."""
    table = Table(content, "s.toml", UsarsimError, "[radio]")
    radio = create_radio(table)
    table.finish()
    return radio


def test_a_table_names_a_model() -> None:
    """Models and presets by name; what is unknown is told with what there is."""
    assert made() == made(model="path-loss", preset="mresim") == MRESIM
    assert made(model="Circle", sum_of_ranges=True) == Circle(sum_of_ranges=True)
    assert {"circle", "path-loss", "sight"} <= set(radio_names())
    with pytest.raises(UsarsimError, match=r"s.toml: \[radio\]: model: 'sigth'.*mean sight"):
        made(model="sigth")
    with pytest.raises(UsarsimError, match="walls: unknown key"):
        made(model="sight", walls=3)


@pytest.mark.parametrize("preset", sorted(PRESETS))
@pytest.mark.parametrize("walls", [0, 1, 4, 5, 9])
def test_strength_is_that_of_the_wireless_server(preset: str, walls: int) -> None:
    """E-41: to 1e-6 dB, whatever the preset."""
    server = read_radio({"model": "path-loss", "preset": preset}, "s.toml").model
    ours = made(model="path-loss", preset=preset)
    assert isinstance(ours, PathLoss)
    for metres in (0.5, 7.0, 29.6, 199.0):
        wide = 1.0 if preset == "mresim" else 0.1
        found = ours.strength(metres / wide, 200.0, walls, wide)
        assert found == pytest.approx(server.strength(metres, walls), abs=1e-6)


def test_walls_alone_end_the_links_of_the_original() -> None:
    """E-37: 127 m behind four walls, 29.6 m behind five."""
    usarsim = made(model="path-loss", preset="usarsim")
    for walls, metres in ((4, 127.0), (5, 29.6)):
        assert usarsim.hears(metres * 0.995 / 0.1, 1.0, walls, 0.1)
        assert not usarsim.hears(metres * 1.005 / 0.1, 1.0, walls, 0.1)


@pytest.mark.parametrize("radio", [Circle(), Sight(), MRESIM])
def test_an_outline_ends_where_links_do(radio: Radio) -> None:
    """E-42: at the first failure of each direction."""
    walls = np.zeros((60, 80), np.uint8)
    walls[20, 10:70] = walls[30:50, 50] = 1
    world, middle = Environment("room", walls), (30, 35)
    ends = outline(radio, world, middle, 28.0, 32)
    for number, end in enumerate(ends.tolist()):
        angle, last = 2 * np.pi * number / 32, middle
        for along in range(1, 100):
            column = int(np.floor(30 + along * np.cos(angle) + 0.5))
            row = int(np.floor(35 + along * np.sin(angle) + 0.5))
            inside = 0 <= column < 80 and 0 <= row < 60
            cell = (column, row)
            if not inside or not find_links(radio, world, [middle, cell], [28.0] * 2).direct[0, 1]:
                break
            last = cell
        assert tuple(end) == last


def test_many_pairs_are_linked_as_each_is() -> None:
    """Bisection over pairs of the same kind finds what asking one by one does."""
    random = np.random.default_rng(4)
    away = np.hypot(*random.integers(0, 200, (2, 500)))
    reach, walls = random.choice([100.0, 200.0], 500), random.integers(0, 4, 500)
    many = MRESIM.linked(away, reach, walls, 0.1)
    alone = [
        MRESIM.linked(away[i : i + 1], reach[i : i + 1], walls[i : i + 1], 0.1) for i in range(500)
    ]
    assert (many == np.concatenate(alone)).all()
    assert 0 < many.sum() < 500


def test_a_silent_radio_has_no_link() -> None:
    """Range 0 is that of a robot that failed, under every model."""
    for radio in (Circle(sum_of_ranges=True), Sight(), MRESIM, made(preset="usarsim")):
        assert not find_links(radio, corridor(), [(2, 1), (3, 1)], [200.0, 0.0]).direct.any()


def test_recorded_links_hold_until_the_next_listed_step(tmp_path: Path) -> None:
    """EXP-09: whatever robots do; nobody hears one that is silent."""
    (tmp_path / "links.csv").write_text(f"{HEADER}\n2,0,1\n2,2,1\n5,,\n9,0,2\n")
    table = Table({"model": "recorded", "file": "links.csv"}, tmp_path / "s.toml", UsarsimError)
    radio = create_radio(table)
    table.finish()
    world, cells = corridor(), [(2, 1), (400, 1), (3, 1)]
    pairs = {
        1: [],
        2: [(0, 1), (1, 2)],
        4: [(0, 1), (1, 2)],
        5: [],
        8: [],
        9: [(0, 2)],
        99: [(0, 2)],
    }
    for step, expected in pairs.items():
        links = find_links(radio, world, cells, [9.0] * 3, step)
        assert list(zip(*np.nonzero(np.triu(links.direct)), strict=True)) == expected
    assert find_links(radio, world, cells, [9.0] * 3, 2).closed[0, 2]
    assert find_links(radio, world, cells, [9.0, 0.0, 9.0], 2).groups() == []
    with pytest.raises(UsarsimError, match="names robot 2, which is not there"):
        find_links(radio, world, cells[:2], [9.0] * 2, 9)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "line 1: has no header"),
        ("step,one\n", "line 1: has no header"),
        ("1,2\n", "line 2: 2 cells, not 3 as in the header"),
        ("1,2,2\n", "line 2: '1,2,2' is no link"),
        ("1,,2\n", "line 2: '1,,2' is no link"),
        ("1,0,x\n", "line 2"),
        ("1,0,-1\n", "line 2"),
        ("4,0,1\n\n3,0,1\n", "line 4: step 3 comes after step 4"),
    ],
)
def test_bad_link_tables(text: str, problem: str) -> None:
    """One error, naming file and line."""
    with pytest.raises(UsarsimError, match=problem) as caught:
        read_links(text if "step" in text or not text else f"{HEADER}\n{text}", "l.csv")
    assert str(caught.value).startswith("l.csv")


@settings(max_examples=60, deadline=None)
@given(st.text("0123456789,\n x", max_size=40))
@example("1,²,3")
def test_any_table_is_read_or_refused(text: str) -> None:
    """And what was read gives links for every step."""
    try:
        rows = read_links(f"{HEADER}\n{text}", "l.csv")
    except UsarsimError:
        return
    assert [step for step, _ in rows] == sorted({step for step, _ in rows})
    assert all(0 <= one < other for _, pairs in rows for one, other in pairs)
    assert not Recorded(table=rows).direct(-1, corridor(), [(0, 0)], [1.0]).any()
