"""Scenes of worlds: nothing outside their folder, nothing without bound, no pipes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from usarsim_server.data import data_directory
from usarsim_server.errors import WorldError
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A world that works."""
    world = tmp_path / "hall"
    shutil.copytree(data_directory("worlds") / "empty", world)
    (tmp_path / "secret.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    (tmp_path / "secret.xml").write_text("<mujoco><visual/></mujoco>")
    with (world / "bomb.png").open("wb") as file:
        Image.new("1", (30_000, 30_000)).save(file)
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
    command = [sys.executable, "-m", "usarsim_server.cli", "serve"]
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
