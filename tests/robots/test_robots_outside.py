"""Model files name files of their own; only those in the folder of the robot are read, if they
are files, and what they would grow into has a bound."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from model_texts import TETRAHEDRON, body, mjcf, urdf, write_stl
from robot_files import write

from usarsim_server.data import data_directory
from usarsim_server.errors import RobotDescriptionError
from usarsim_server.robots.catalog import Library, load_robot

MESH = '<asset><mesh name="t" file="FILE"/></asset>'
SHAPE = '<body><joint/><geom type="mesh" mesh="t"/></body>'
LEG = (
    '<link name="leg"><visual><geometry><mesh filename="MESH"/></geometry></visual></link>'
    '<joint name="j" type="fixed"><parent link="base"/><child link="leg"/></joint>'
)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """`in` for the robot; a mesh, a text and a link to them in `out`."""
    write_stl(tmp_path / "out" / "t.stl", *TETRAHEDRON)
    inside = "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    (tmp_path / "out" / "more.xml").write_text(inside)
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "link").symlink_to(tmp_path / "out")
    return tmp_path


def texts(out: Path) -> dict[str, str]:
    """Ways out."""
    meshes = '<compiler meshdir="../out"/>' + MESH.replace("FILE", "t.stl")
    assets = '<compiler assetdir="link"/>' + MESH.replace("FILE", "t.stl")
    return {
        "include": mjcf(before='<include file="../out/more.xml"/>'),
        "include link": mjcf(before='<include file="link/more.xml"/>'),
        "include escaped": mjcf(before="<include file='&#46;&#46;/out/more.xml'/>"),
        "mesh": mjcf(SHAPE, before=MESH.replace("FILE", "../out/t.stl")),
        "mesh absolute": mjcf(SHAPE, before=MESH.replace("FILE", f"{out}/t.stl")),
        "meshdir": mjcf(SHAPE, before=meshes),
        "assetdir": mjcf(SHAPE, before=assets),
        "texture": mjcf(before='<asset><texture type="2d" name="x" file="../out/t.stl"/></asset>'),
        "hfield": mjcf(
            before='<asset><hfield name="x" size="1 1 1 1" file="../out/t.stl"/></asset>'
        ),
        "model": mjcf(before='<asset><model name="x" file="../out/more.xml"/></asset>'),
        "urdf": urdf(LEG.replace("MESH", "../out/t.stl")),
        "urdf package": urdf(LEG.replace("MESH", "package://../out/t.stl")),
        "urdf file": urdf(LEG.replace("MESH", f"file://{out}/t.stl")),
    }


@pytest.mark.parametrize("name", texts(Path("/")))
def test_nothing_outside_the_folder_is_read(place: Path, name: str) -> None:
    """One error that names both files and the cure."""
    with pytest.raises(RobotDescriptionError, match=r"asks for .*outside.*--allow-outside"):
        body(place / "in", texts(place / "out")[name])


def test_with_leave_it_is_read(place: Path) -> None:
    """`--allow-outside`, which is an option of the library."""
    with pytest.raises(RobotDescriptionError, match="outside"):
        body(place / "in", texts(place / "out")["mesh"])
    library = Library([data_directory("robots"), place / "in"], allow_outside=True)
    robot = library.load(place / "in" / "Walker.toml", 1).description
    assert any(shape.kind == "mesh" for link in robot.links for shape in link.shapes)


def test_the_model_itself_lies_inside(place: Path) -> None:
    """`body = "../out/x.xml"` is refused before it is opened."""
    robot = {"description": "a test", "kind": "legged", "dialect": "udk"}
    for path in ("../out/more.xml", "link/more.xml", f"{place}/out/more.xml"):
        file = write(place / "in", "Walker", robot | {"body": path})
        with pytest.raises(RobotDescriptionError, match=r"body: .*Walker.toml asks for .*outside"):
            load_robot(file)


BOMBS = {
    "replicate": ('<replicate count="1e8" offset="1 0 0"><geom size="1"/></replicate>', "copies"),
    "nested replicate": (
        '<replicate count="99"><replicate count="99"><geom size="1"/></replicate></replicate>',
        "copies",
    ),
    "composite": ('<composite type="cable" count="9999999 1 1" prefix="a"/>', "copies"),
    "flexcomp": ('<flexcomp name="f" type="grid" count="999 999 999"/>', "copies"),
    "replicate by name": ('<replicate count="many"><geom size="1"/></replicate>', "no number"),
    "replicate nan": ('<replicate count="nan"><geom size="1"/></replicate>', "copies"),
    "deep": ("<body>" * 400 + "</body>" * 400, "nested too deeply"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_by_their_line(place: Path, name: str) -> None:
    """Before MuJoCo makes them."""
    text, problem = BOMBS[name]
    with pytest.raises(RobotDescriptionError, match=rf"body.xml: line \d+: .*{problem}"):
        body(place / "in", mjcf(text))


def test_files_that_include_each_other_end(place: Path) -> None:
    """A circle is MuJoCo's error; a chain without end is ours."""
    for number in range(300):
        inside = f'<mujoco><include file="i{number + 1}.xml"/></mujoco>'
        (place / "in" / f"i{number}.xml").write_text(inside)
    with pytest.raises(RobotDescriptionError, match="more than 200 files"):
        body(place / "in", mjcf(before='<include file="i0.xml"/>'))
    (place / "in" / "a.xml").write_text('<mujoco><include file="a.xml"/></mujoco>')
    with pytest.raises(RobotDescriptionError, match="already included"):
        body(place / "in", mjcf(before='<include file="a.xml"/>'))


PIPES = """
import sys
from usarsim_server.cli import main
raise SystemExit(main(["robots", "--robots", sys.argv[1], "Walker"]))
"""


@pytest.mark.parametrize("pipe", ["Walker.toml", "body.xml", "t.stl", "more.xml"])
def test_pipes_keep_nobody_waiting(place: Path, pipe: str) -> None:
    """In place of robot files, model files, meshes, includes."""
    folder = place / "in"
    more = '<include file="more.xml"/>' if pipe == "more.xml" else ""
    if pipe != "t.stl":
        write_stl(folder / "t.stl", *TETRAHEDRON)
    else:
        os.mkfifo(folder / pipe)
    try:
        body(folder, mjcf(SHAPE, before=MESH.replace("FILE", "t.stl") + more))
    except RobotDescriptionError:
        assert pipe in ("t.stl", "more.xml")
    if pipe != "t.stl":
        (folder / pipe).unlink(missing_ok=True)
        os.mkfifo(folder / pipe)
    done = subprocess.run(
        [sys.executable, "-c", PIPES, str(folder)],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 2
    assert "named pipe" in done.stderr
    assert done.stderr.count("\n") == 1
