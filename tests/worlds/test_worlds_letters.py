"""Worlds and robots in folders whose names have letters outside of ASCII, in any locale."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from usarsim_server.base.files import data_directory
from usarsim_server.specs import path_bytes

LOCALES = {
    "C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "UTF-8": {"LC_ALL": "C.UTF-8", "PYTHONUTF8": "1"},
}
CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))


def tetrahedron() -> bytes:
    """A binary STL file."""
    data = b"\0" * 80 + struct.pack("<I", len(FACES))
    for face in FACES:
        data += struct.pack("<3f", 0, 0, 0)
        data += b"".join(struct.pack("<3f", *CORNERS[corner]) for corner in face) + b"\0\0"
    return data


def world(folder: Path) -> Path:
    """A shipped world, with pieces in a file of their own and a mesh whose name is no ASCII."""
    shutil.copytree(data_directory("worlds") / "empty", folder)
    scene = folder / "scene.xml"
    text = scene.read_text(encoding="utf-8")
    pieces = '<mujoco><asset><mesh name="m" file="größe.stl"/></asset><worldbody>'
    pieces += '<geom type="mesh" mesh="m" pos="0 0 3"/></worldbody></mujoco>'
    (folder / "stücke.xml").write_text(pieces, encoding="utf-8")
    (folder / "größe.stl").write_bytes(tetrahedron())
    model = '<asset><model name="s" file="stücke.xml"/></asset>'
    frame = '<worldbody><frame><attach model="s" prefix="s"/></frame></worldbody>'
    end = text.rindex("</mujoco>")
    scene.write_text(text[:end] + model + frame + text[end:], encoding="utf-8")
    return folder


def python(program: str, *words: str | Path, locale: str) -> subprocess.CompletedProcess[bytes]:
    """A program in a locale."""
    return subprocess.run(
        [sys.executable, "-c", program, *map(os.fspath, words)],
        capture_output=True,
        env={**os.environ, **LOCALES[locale]},
    )


BUILD = """
import sys
from pathlib import Path
from usarsim_server.worlds import solids
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_in_parts
solids.LEAST = int(sys.argv[2])
spec, fixed = build_in_parts(load_world(Path(sys.argv[1])))
print(spec.compile().nmesh, fixed is not None)
"""


@pytest.mark.parametrize("locale", LOCALES)
@pytest.mark.parametrize("name", ["Müller/世界", os.fsdecode(b"M\xfcller/yard")])
def test_a_world_is_read(locale: str, name: str, tmp_path: Path) -> None:
    """Scene, pieces and meshes, in one and apart; a folder whose name is no UTF-8, too."""
    folder = world(tmp_path / name)
    whole = python(BUILD, folder, "100", locale=locale)
    assert (whole.returncode, whole.stdout) == (0, b"1 False\n"), whole.stderr
    apart = python(BUILD, folder, "0", locale=locale)
    assert (apart.returncode, apart.stdout) == (0, b"0 True\n"), apart.stderr


@pytest.mark.parametrize("locale", LOCALES)
def test_a_mesh_outside_is_refused(locale: str, tmp_path: Path) -> None:
    """What a scene names by such letters is looked at before MuJoCo opens it."""
    folder = world(tmp_path / "yard")
    (tmp_path / "außen").mkdir()
    shutil.move(folder / "größe.stl", tmp_path / "außen")
    pieces = folder / "stücke.xml"
    text = pieces.read_text(encoding="utf-8").replace("größe", "../außen/größe")
    pieces.write_text(text, encoding="utf-8")
    done = python(BUILD, folder, "100", locale=locale)
    assert b"lies outside the given folders" in done.stderr


def test_a_settings_file_names_a_world(tmp_path: Path) -> None:
    """Letters from the text of a file lead to the same folder as those of the command line."""
    world(tmp_path / "Müller" / "世界")
    sheet = tmp_path / "lab.toml"
    sheet.write_text('world = "Müller/世界"\n', encoding="utf-8")
    program = (
        "import sys; from pathlib import Path; from usarsim_server.options import load_settings\n"
        "from usarsim_server.worlds.loader import find_world\n"
        "print(find_world(load_settings({}, Path(sys.argv[1])).world).is_dir())"
    )
    for locale in LOCALES:
        done = python(program, sheet, locale=locale)
        assert (done.returncode, done.stdout) == (0, b"True\n"), done.stderr


def test_a_map_and_its_world_by_the_command_line(tmp_path: Path) -> None:
    """Import and a picture in the C locale."""
    folder = tmp_path / "Müller"
    folder.mkdir()
    (folder / "käse.stl").write_bytes(tetrahedron())
    plain = {**os.environ, **LOCALES["C"], "XDG_CACHE_HOME": str(tmp_path)}
    for words in (
        ["import", folder / "käse.stl", "--out", folder / "out"],
        ["worlds", folder / "out" / "k_se"],
    ):
        command = [sys.executable, "-m", "usarsim_server", *map(str, words)]
        done = subprocess.run(command, capture_output=True, env=plain)
        assert done.returncode == 0, done.stderr
        assert "Müller".encode() in done.stdout or words[0] == "worlds"


def test_paths_stay_bytes() -> None:
    """A name that is no UTF-8 is handed on as it is."""
    assert path_bytes(os.fsdecode(b"/a/\xfc")) == b"/a/\xfc"
