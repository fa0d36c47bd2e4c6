"""Finding worlds, and what their scenes may not read: nothing outside, nothing without bound."""

from __future__ import annotations

import functools
import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image
from world_files import write_world

from usarsim_server.base import files as data
from usarsim_server.base.errors import WorldError
from usarsim_server.base.files import data_directory
from usarsim_server.worlds import loader
from usarsim_server.worlds.loader import DEFAULT_WORLD, find_world, list_worlds, load_world
from usarsim_server.worlds.scene import build_scene

SHIPPED = {"arena", "empty", "office", "plant", "proving_ground", "smoke_corridor"}


def test_the_shipped_worlds_are_listed() -> None:
    """The list holds at least the shipped worlds, sorted, each with a title."""
    worlds = list_worlds()
    names = [world.name for world in worlds]
    assert set(names) >= SHIPPED
    assert names == sorted(names)
    assert all(world.title and world.description for world in worlds)


def test_the_default_world_is_the_arena() -> None:
    """The world of a server that was told nothing exists and is the arena."""
    assert DEFAULT_WORLD == "arena"
    assert find_world(DEFAULT_WORLD).name == "arena"


@pytest.mark.parametrize("name", ["office", "Office", "OFFICE"])
def test_a_name_is_found_in_any_case(name: str) -> None:
    """Capitals make no difference in a world's name."""
    assert find_world(name) == data.data_directory("worlds") / "office"


def test_a_folder_is_found_by_its_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path is taken as it is, absolute or relative."""
    folder = write_world(tmp_path)
    assert find_world(str(folder)) == folder
    monkeypatch.chdir(tmp_path)
    assert find_world("yard") == Path("yard")
    assert find_world("./yard") == Path("./yard")


def test_an_unknown_name_lists_the_known_ones() -> None:
    """The error suggests the nearest name and lists all."""
    with pytest.raises(WorldError) as caught:
        find_world("ofice")
    text = str(caught.value)
    assert text.startswith("ofice: no such world (cure: did you mean office?")
    assert all(name in text for name in SHIPPED)


def test_a_path_without_world_says_what_is_missing(tmp_path: Path) -> None:
    """A path that is no world folder is not looked up as a name."""
    with pytest.raises(WorldError, match=r"not a world folder .*world\.toml"):
        find_world(str(tmp_path / "arena"))


def test_folders_without_a_sheet_are_no_worlds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stray files and folders beside the worlds are ignored."""
    yard = write_world(tmp_path)
    (tmp_path / "notes").mkdir()
    (tmp_path / "readme.txt").write_text("x", encoding="utf-8")
    monkeypatch.setattr(loader, "data_directory", lambda kind: tmp_path)
    assert [world.folder for world in list_worlds()] == [yard]


def test_an_installed_package_carries_its_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Data inside the package is preferred; without it the folder beside the package is used."""
    package = tmp_path / "usarsim_server"
    package.mkdir()
    monkeypatch.setattr(data, "_PACKAGE", package)
    assert data.data_directory("worlds") == tmp_path / "worlds"
    (package / "_data" / "worlds").mkdir(parents=True)
    assert data.data_directory("worlds") == package / "_data" / "worlds"
    assert data.data_directory("robots") == tmp_path / "robots"


GROUND = '<worldbody><geom type="plane" size="9 9 1"/></worldbody>'
BOMBS = {
    "replicate": (
        '<worldbody><replicate count="1e8"><geom size="1"/></replicate></worldbody>',
        "copies",
    ),
    "hfield": (
        '<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>',
        "points of a height field",
    ),
    "texture": (
        '<asset><texture type="2d" name="t" builtin="flat" width="99999" height="99999"/></asset>',
        "pixels",
    ),
    "picture": ('<asset><texture type="2d" name="t" file="bomb.png"/></asset>', "pixels"),
    "height picture": (
        '<asset><hfield name="h" file="bomb.png" size="1 1 1 1"/></asset>',
        "pixels of bomb.png",
    ),
    "own format": (
        '<asset><hfield name="h" file="bomb.bin" size="1 1 1 1"/></asset>',
        "pixels of bomb.bin",
    ),
    "memory": ('<size memory="900G"/>', "memory"),
    "user data": ('<size nuser_geom="2000000000"/>', "nuser_geom"),
    "made mesh": (
        '<asset><mesh name="m" builtin="supersphere" params="9999 1 1"/></asset>',
        "params",
    ),
    "outside": ('<asset><mesh name="m" file="../secret.obj"/></asset>', "outside.*--allow-outside"),
    "include": ('<include file="../secret.xml"/>', "outside.*--allow-outside"),
}


@functools.cache
def bomb() -> bytes:
    """A small file of a picture that takes a gigabyte."""
    file = io.BytesIO()
    Image.new("1", (30_000, 30_000)).save(file, "PNG")
    return file.getvalue()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A world that works."""
    world = tmp_path / "hall"
    shutil.copytree(data_directory("worlds") / "empty", world)
    (tmp_path / "secret.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    (tmp_path / "secret.xml").write_text("<mujoco><visual/></mujoco>")
    (world / "bomb.png").write_bytes(bomb())
    (world / "bomb.bin").write_bytes(b"\xff\xff\xff\x7f" * 4)
    return world


def put(folder: Path, text: str) -> None:
    """Make a scene of something and the ground."""
    (folder / "scene.xml").write_text(f"<mujoco>\n{text}\n{GROUND}</mujoco>")


@pytest.mark.parametrize("name", BOMBS)
def test_a_scene_has_bounds(folder: Path, name: str) -> None:
    """The error names the line; MuJoCo never sees the file."""
    text, problem = BOMBS[name]
    put(folder, text)
    with pytest.raises(WorldError, match=rf"scene.xml: line 2: .*{problem}"):
        build_scene(load_world(folder))


def test_a_link_is_where_it_leads(folder: Path) -> None:
    """A link in the folder of a world to a file outside is refused, one to a file inside is read;
    plain files beside them change nothing, nor do roundabout names."""
    shutil.copy(folder.parent / "secret.obj", folder / "own.obj")
    (folder / "own link.obj").symlink_to(folder / "own.obj")
    (folder / "out link.obj").symlink_to(folder.parent / "secret.obj")
    mesh = "<mesh name='{}' file='{}'/>".format
    inside = mesh("a", "own.obj") + mesh("b", ".//../hall/own link.obj")
    put(folder, f"<asset>{inside}</asset>")
    assert build_scene(load_world(folder)).compile().nmesh == 2
    for name in ("out link.obj", "./out link.obj"):
        put(folder, f"<asset>{inside}\n{mesh('c', name)}</asset>")
        with pytest.raises(WorldError, match=r"scene.xml: line 3: .*out link.obj.* lies outside"):
            build_scene(load_world(folder))


def test_with_leave_files_outside_are_read(folder: Path) -> None:
    """`--allow-outside`; comments, stray signs and escapes in the text do not matter."""
    put(
        folder,
        "<!-- a -- b --><include file='../secret.xml'/><custom><text name='&' data='>'/></custom>",
    )
    assert build_scene(load_world(folder), allow_outside=True).compile().ngeom > 0


@pytest.mark.parametrize(
    "name", ["world.toml", "scene.xml", "objects.toml", "avatars.toml", "a.png"]
)
def test_pipes_keep_no_server_waiting(folder: Path, name: str) -> None:
    """In place of any file of a world."""
    put(
        folder,
        '<asset><texture type="2d" name="t" file="a.png"/></asset>' if name == "a.png" else "",
    )
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    ports = [f"--{port}-port=off" for port in ("image", "groundtruth", "wireless", "truth")]
    command = [sys.executable, "-m", "usarsim_server", "serve"]
    done = subprocess.run(
        [*command, "--world", str(folder), "--port", "0", *ports],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    if name != "world.toml":
        assert "named pipe" in done.stderr
