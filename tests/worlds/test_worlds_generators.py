"""The generators of the shipped worlds, and that what is committed is what they make."""

from __future__ import annotations

import hashlib
import math
import os
import re
import struct
import subprocess
import sys
import tomllib
from collections import deque
from ctypes.util import find_library
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shipped_worlds import NAMES
from world_files import HEAD, START, write_world

from usarsim_exploration.worlds.mjcf import Movable, Scene, number, turned
from usarsim_exploration.worlds.sheet import PELVIS_HEIGHT, GeneratedWorld
from usarsim_server.base.files import data_directory
from usarsim_server.simulation.frames import quaternion_from_rpy
from usarsim_server.worlds import victims
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene
from world_generators import GENERATORS, __main__, differences, files
from world_generators import drawing as picture
from world_generators.arena import MAZE
from world_generators.terrain import incline, ramp_rise, symmetric_heights
from world_generators.walls import WallSize, door, wall, window

ROOT = Path(__file__).resolve().parents[2]


# ---- committed files ----------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_committed_worlds_are_what_the_generators_make(name: str) -> None:
    """Nobody edited a generated file, nobody forgot to run a generator."""
    assert differences(name, data_directory("worlds")) == []


def test_every_generator_has_a_folder() -> None:
    """Generators and tested worlds are the same."""
    assert tuple(GENERATORS) == NAMES


def test_generators_are_deterministic() -> None:
    """Two runs write the same bytes, also with another hash seed."""
    program = (
        "import hashlib; from world_generators import files; "
        "print(hashlib.sha256(repr(sorted(files('arena').items())).encode()).hexdigest())"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": "77"}
    other = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    ours = hashlib.sha256(repr(sorted(files("arena").items())).encode()).hexdigest()
    assert other.stdout.strip() == ours


def test_the_command_line_writes_and_checks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`worldgen NAME --into DIR` writes; `--check` is silent then, and names a changed file."""
    assert __main__.main(["empty", "--into", str(tmp_path)]) == 0
    assert __main__.main(["empty", "--check", "--into", str(tmp_path)]) == 0
    assert capsys.readouterr().err == ""
    sheet = tmp_path / "empty" / "world.toml"
    sheet.write_text(sheet.read_text(encoding="utf-8") + "# mine\n", encoding="utf-8")
    assert __main__.main(["empty", "--check", "--into", str(tmp_path)]) == 1
    assert str(sheet) in capsys.readouterr().err
    with pytest.raises(SystemExit):
        __main__.main(["atlantis"])
    assert "no generator for 'atlantis'" in capsys.readouterr().err


@pytest.mark.parametrize("name", NAMES)
def test_pictures_are_there_and_small(name: str) -> None:
    """The documentation's pictures are 960 x 600 and under 300 kB."""
    content = (ROOT / "docs" / "images" / f"world_{name}.png").read_bytes()
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    assert struct.unpack(">II", content[16:24]) == (960, 600)
    assert len(content) < 300_000


def test_the_documented_example_is_a_world(tmp_path: Path) -> None:
    """The scene and the sheets printed in docs/worlds.md load and compile."""
    text = (ROOT / "docs" / "worlds.md").read_text(encoding="utf-8")
    (scene,) = re.findall(r"```xml\n(.*?)```", text, re.DOTALL)
    sheet, upon, life, smoke, ground, machinery = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    folder = tmp_path / "yard"
    folder.mkdir()
    (folder / "scene.xml").write_text(scene, encoding="utf-8")
    (folder / "world.toml").write_text(sheet, encoding="utf-8")
    world = load_world(folder)
    assert build_scene(world).compile().nv == 6
    assert (len(world.starts), len(world.victims), len(world.path_nodes)) == (1, 1, 2)
    (folder / "world.toml").write_text(sheet + life, encoding="utf-8")
    world = load_world(folder)
    assert build_scene(world).compile().nmocap == 1
    assert (len(world.victims), len(world.tags), len(world.sounds)) == (2, 1, 1)
    assert len(world.false_alarms) == 1
    (folder / "world.toml").write_text(sheet + smoke + ground, encoding="utf-8")
    world = load_world(folder)
    assert (len(world.smoke.volumes), len(world.smoke.puffs), len(world.surfaces)) == (1, 1, 2)
    assert build_scene(world).geom("surface_2") is not None
    (folder / "world.toml").write_text(sheet + machinery, encoding="utf-8")
    model = build_scene(load_world(folder)).compile()
    assert (model.nmocap, model.nv) == (4, 7)
    (folder / "scene.xml").unlink()
    (folder / "world.toml").write_text(upon, encoding="utf-8")
    assert build_scene(load_world(folder)).geom("paint:zone:autonomous") is not None


def test_the_documentation_shows_every_shipped_world() -> None:
    """docs/worlds.md names each shipped world and shows its picture."""
    text = (ROOT / "docs" / "worlds.md").read_text(encoding="utf-8")
    for name in NAMES:
        assert f"### {name}" in text
        assert f"(images/world_{name}.png)" in text


# ---- writers ------------------------------------------------------------------------------


@given(st.floats(-1e4, 1e4))
def test_numbers_are_short_and_near(value: float) -> None:
    """At most five decimals, no exponent, no negative zero, no trailing zeros."""
    text = number(value)
    assert re.fullmatch(r"-?\d+(\.\d{0,4}[1-9])?", text)
    assert text != "-0"
    assert float(text) == pytest.approx(value, abs=5.1e-6)


@given(*[st.floats(-180.0, 180.0)] * 3)
def test_turns_agree_with_the_server(roll: float, pitch: float, yaw: float) -> None:
    """The generators' rotation is the simulation frame's Rz(yaw) Ry(pitch) Rx(roll)."""
    ours = turned(roll, pitch, yaw)
    theirs = quaternion_from_rpy(*(math.radians(angle) for angle in (roll, pitch, yaw)))
    assert ours == pytest.approx(theirs, abs=1e-12)


def test_pelvis_heights_agree_with_the_server() -> None:
    """Generators place victims by the same heights that the figures are built for."""
    assert PELVIS_HEIGHT == victims.PELVIS_HEIGHT


@pytest.mark.parametrize("name", NAMES)
def test_sheets_survive_the_round_trip(name: str) -> None:
    """What TOML reads is what the generator meant."""
    world = GENERATORS[name]()
    sheet = tomllib.loads(world.toml())
    assert sheet["title"] == world.title
    assert [start["tag"] for start in sheet["start"]] == [start.tag for start in world.starts]
    people = sheet.get("victim", [])
    assert [p["properties"] for p in people] == [dict(p.properties) for p in world.people]


def test_text_is_escaped() -> None:
    """Quotes, backslashes and angle brackets do no harm in either file."""
    scene = Scene('a "b" <c>', center=(0, 0, 0), extent=1.0)
    world = GeneratedWorld("x", 'say "hi" \\ bye', "", scene, (0, 0, 0), (1, 1, 1))
    assert tomllib.loads(world.toml())["title"] == 'say "hi" \\ bye'
    assert mujoco.MjSpec.from_string(scene.xml()).modelname == 'a "b" <c>'


def workshop(*materials: str) -> Scene:
    """A scene with nothing but materials."""
    scene = Scene("s", center=(0, 0, 0), extent=1.0)
    for material in materials:
        scene.material(material, (1, 1, 1))
    return scene


def test_movables_balance(tmp_path: Path) -> None:
    """A body of two pieces weighs their sum and stands where it was put."""
    scene = workshop("wood")
    body = Movable("thing", (1.0, 2.0, 3.0), turned(yaw=90.0))
    body.box((0, 0, 0), (0.2, 0.4, 0.6), "wood", 1.5)
    body.cylinder((0.5, 0, 0), 0.1, 0.2, "wood", 0.5)
    scene.movable(body)
    model = mujoco.MjModel.from_xml_string(scene.xml())
    assert model.body("thing").mass[0] == pytest.approx(2.0)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.geom("thing:2").xpos == pytest.approx([1.0, 2.5, 3.0])
    assert model.geom("thing:1").size == pytest.approx([0.1, 0.2, 0.3])


def heights_along(scene: Scene, xs: list[float], y: float = 0.0) -> list[float]:
    """Heights of a scene's surface, measured by rays."""
    model = mujoco.MjModel.from_xml_string(scene.xml())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    down = np.array([0.0, 0.0, -1.0])
    geom = np.zeros(1, np.int32)
    ways = [
        mujoco.mj_ray(model, data, np.array([x, y, 9.0]), down, None, 1, -1, geom, None) for x in xs
    ]
    return [9.0 - way if way >= 0 else math.nan for way in ways]


@pytest.mark.parametrize("angle", [5.0, 15.0, 35.0])
def test_inclines_leave_the_ground_at_their_foot(angle: float) -> None:
    """The slope's surface passes through the foot line and has the angle and length asked for."""
    scene = workshop("wood")
    incline(scene, "slope", (1.0, 0.0, 0.0), (4.0, 1.0), angle, "wood")
    reach = 4.0 * math.cos(math.radians(angle))
    rise = math.tan(math.radians(angle))
    inside = [1.0, 1.5, 1.0 + reach - 0.01]
    assert heights_along(scene, inside) == pytest.approx(
        [(x - 1.0) * rise for x in inside], abs=1e-4
    )
    assert math.isnan(heights_along(scene, [1.0 + reach + 0.3])[0])


@pytest.mark.parametrize("yaw", [0.0, 90.0, 180.0, -90.0])
def test_ramps_rise_toward_their_yaw(yaw: float) -> None:
    """A wedge starts at its low edge and reaches its rise at the far edge."""
    scene = workshop("wood")
    scene.ramp("ramp", (2.0, 1.0), (1.2, 0.6), ramp_rise(1.2), "wood", yaw=yaw)
    for along in (0.05, 0.6, 1.15):
        x = 2.0 + along * math.cos(math.radians(yaw))
        y = 1.0 + along * math.sin(math.radians(yaw))
        height = heights_along(scene, [x], y)[0]
        assert height == pytest.approx(along * math.tan(math.radians(15.0)), abs=1e-4)


@given(st.text(max_size=8), st.integers(2, 14))
def test_step_fields_are_symmetric(seed: str, size: int) -> None:
    """A half turn maps any field onto itself (E2828 style), whatever seed and size."""
    heights = symmetric_heights(seed, [0.0, 0.05, 0.1], size)
    assert len(heights) == size
    assert all(len(row) == size for row in heights)
    assert tuple(tuple(reversed(row)) for row in reversed(heights)) == heights


def test_walls_leave_their_openings_free() -> None:
    """Solid pieces, lintels, sills and panes add up to the whole wall, except the doorway."""
    scene = workshop("brick", "glass")
    openings = [window(4.0, 1.0), door(1.5)]
    wall(scene, "w", "x", 2.0, (0.0, 6.0), "brick", WallSize(0.2, 2.5), openings=openings)
    model = mujoco.MjModel.from_xml_string(scene.xml())
    volume = sum(8 * math.prod(model.geom_size[g]) for g in range(model.ngeom))
    holes = 1.0 * 2.1 * 0.2 + 1.0 * 1.2 * (0.2 - 0.02)
    assert volume == pytest.approx(6.0 * 2.5 * 0.2 - holes)
    names = {model.geom(g).name for g in range(model.ngeom)}
    assert names == {"w_1", "w_2", "w_3", "w_lintel_1", "w_lintel_2", "w_sill_1", "w_pane_1"}


# ---- maze ---------------------------------------------------------------------------------


def test_the_maze_is_connected_and_its_closed_cells_have_a_hole() -> None:
    """All open cells hang together and are entered from west, south and east; two are closed."""
    rows, columns = MAZE.shape
    assert (rows, columns) == (7, 9)
    steps = {"north": (-1, 0), "south": (1, 0), "east": (0, 1), "west": (0, -1)}
    entrances, seen = set(), {(3, 0)}
    queue = deque(seen)
    while queue:
        row, column = queue.popleft()
        for side, (down, right) in steps.items():
            if MAZE.wall(row, column, side) != " ":
                continue
            cell = (row + down, column + right)
            if 0 <= cell[0] < rows and 0 <= cell[1] < columns:
                if cell not in seen:
                    seen.add(cell)
                    queue.append(cell)
            elif cell[0] >= 0:  # the hall wall closes the north side
                entrances.add(side)
    assert entrances == {"west", "south", "east"}
    closed = {(row, column) for row in range(rows) for column in range(columns)} - seen
    assert closed == {(0, 8), (6, 3)}
    for row, column in closed:
        assert "o" in {MAZE.wall(row, column, side) for side in steps}


# ---- pictures -----------------------------------------------------------------------------


def drawn(world: str | Path, target: Path, width: int, height: int) -> np.ndarray:
    """The pixels (height, width, 3) that the picture program writes, red, green, blue."""
    command = [sys.executable, "-m", "world_generators.drawing", str(world), str(target)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "MUJOCO_GL": "egl"}
    size = ["--width", str(width), "--height", str(height)]
    subprocess.run([*command, *size], env=environment, check=True)
    content = np.frombuffer(target.read_bytes(), np.uint8)
    return cv2.imdecode(content, cv2.IMREAD_COLOR)[..., ::-1].astype(int)


def test_an_unknown_world_is_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The picture program reports a user's mistake without a traceback."""
    assert picture.main(["atlantis", str(tmp_path / "x.png")]) == 2
    assert capsys.readouterr().err.startswith("atlantis: no such world")


@pytest.mark.skipif(find_library("EGL") is None, reason="no EGL library on this machine")
def test_a_picture_shows_the_world_and_its_starts(tmp_path: Path) -> None:
    """The preview of the empty world has a floor, sky above it, and green arrows."""
    image = drawn("empty", tmp_path / "empty.png", 240, 150)
    assert image.shape == (150, 240, 3)
    red, green, blue = np.moveaxis(image, 2, 0)
    assert (blue[0] > red[0] + 10).all()
    assert (abs(green[-1] - red[-1]) < 15).all()
    assert ((green > red + 40) & (green > blue + 20)).sum() > 50


@pytest.mark.skipif(find_library("EGL") is None, reason="no EGL library on this machine")
def test_a_picture_shows_smoke_and_ground(tmp_path: Path) -> None:
    """Drawn with mud and smoke the middle is brown below and grey above; without, neither."""
    scene = """<mujoco><worldbody>
      <geom name="floor" type="plane" size="0 0 1" rgba="0.9 0.9 0.9 1"/>
      <camera name="overview" pos="0 -6 2" xyaxes="1 0 0 0 0.316 0.949" fovy="50"/>
    </worldbody></mujoco>"""
    media = """
[[smoke]]
name = "cloud"
kind = "regional"
shape = "ellipsoid"
position = [0, 6, 2]
size = [6, 4, 3]
density = 2.0

[[surface]]
name = "bog"
kind = "mud"
x = [-3, 3]
y = [-3.5, 1]
"""
    smoky, bare = (
        drawn(write_world(tmp_path, HEAD + START + extra, scene), tmp_path / "yard.png", 96, 60)
        for extra in (media, "")
    )
    brown = smoky[45, 40:56]
    assert (brown[:, 0] > brown[:, 2] + 15).all()
    assert np.abs(np.ptp(bare[45, 40:56], axis=1)).max() < 10
    cloud = np.abs(smoky - bare).sum(axis=2)[:25, 40:56]
    assert cloud.max() > 60
