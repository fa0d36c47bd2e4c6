"""Finding robot classes by the names that clients use; what files of robots may read.

Model files name files of their own; only those in the folder of the robot are read, if they are
files, and what they would grow into has a bound.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest
from model_texts import TETRAHEDRON, body, mjcf, urdf, write_stl
from robot_files import table, write

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.base.files import data_directory
from usarsim_server.robots.catalog import Library, RobotCatalog, load_catalog, load_robot

SHIPPED = tuple(
    sorted((path.stem for path in data_directory("robots").glob("*.toml")), key=str.lower)
)
ROSTER = (
    *("AirRobot", "ARDrone", "ATRV", "ATRV2", "ATRVJr", "BasicAckermanRobot", "BasicSkidRobot"),
    *("CasterSkidRobot", "ComStation", "Cooper", "crawler_robot", "Element", "ERS"),
    *("Fanuc_M16iB20", "Fanuc_Robot_And_Rail", "FanucM16", "Forklift", "ForkLift"),
    *("FrontAckerman", "GripperBase", "HandBot", "HMMWV", "Hummer", "Kenaf", "KinectBot"),
    *("Kiva4Wheel", "KR3", "KR5", "KR6", "KR60", "KRobot", "KUKA_LWR_BOT", "Kurt", "Kurt2D"),
    *("Kurt3D", "Lisa", "Matilda", "MDS", "MultiView", "Nao", "Nomad", "OmniP2AT", "OmniP2DX"),
    *("P2AT", "P2AT_ATLANTA", "P2DX", "P3AT", "P3DX", "Passarola", "PR2", "QRIO", "quadrotor"),
    *("pioneer2dx_with_sensors", "pioneer3at_with_sensors", "ReferenceGPSCoordinate", "Rugbot"),
    *("Sedan", "SegwayRMPFifty", "SnowStorm", "Soryu", "StereoP2AT", "Submarine", "Talon"),
    *("Tarantula", "TarantulaSIED", "TeleMax", "turtlebot", "TwoLink", "UnitLoader"),
    *("youBot", "Zerg"),
)
"""Every class that a client of either generation can ask for (robots reference 1.1)."""


@pytest.fixture(scope="module")
def catalog() -> RobotCatalog:
    return load_catalog()


def found(catalog: RobotCatalog, name: str):
    robot = catalog.find(name)
    assert robot is not None, name
    return robot


def test_shipped_classes(catalog: RobotCatalog) -> None:
    """The shipped folder has exactly the documented classes, listed in alphabetical order."""
    assert catalog.names() == SHIPPED
    assert tuple(robot.name for robot in catalog.descriptions()) == SHIPPED


@pytest.mark.parametrize("name", ROSTER)
def test_the_whole_roster_is_there(catalog: RobotCatalog, name: str) -> None:
    """Every row of the catalog of the original simulators is answered (robots 1)."""
    assert found(catalog, name).name == name


@pytest.mark.parametrize("name", SHIPPED)
def test_every_class_is_found_with_and_without_package(catalog: RobotCatalog, name: str) -> None:
    """A class is found by its name, with a package, and in any case (robots 1, 2)."""
    for spelling in (name, f"USARBot.{name}", f"a.b.{name}", name.lower(), name.upper()):
        assert found(catalog, spelling).name == name
    assert found(catalog, f" USARBot.{name} ").name == name


@pytest.mark.parametrize(
    "name", ["", ".", "USARBot.", "Nothing", "USARBot.P3ATX", "P3AT.toml", "*"]
)
def test_unknown_classes_are_none(catalog: RobotCatalog, name: str) -> None:
    """A class nobody described is None (robots 1)."""
    assert catalog.find(name) is None


@pytest.mark.parametrize(
    ("alias", "model"),
    [
        ("StereoP2AT", "P2AT"),
        ("OmniP2AT", "P2AT"),
        ("P2AT_ATLANTA", "P2AT"),
        ("OmniP2DX", "P2DX"),
        ("P3DX", "P2DX"),
    ],
)
def test_aliases_have_the_mapped_geometry_and_their_own_name(
    catalog: RobotCatalog, alias: str, model: str
) -> None:
    """Variants report the class the client asked for and have the geometry of robots 1.1
    (robots 3)."""
    robot, original = found(catalog, alias), found(catalog, model)
    assert robot.name == alias
    assert robot.model == original.model == model
    assert robot.wheels == original.wheels
    assert robot.shapes == original.shapes
    assert robot.report.wheel_radius == original.report.wheel_radius


@pytest.mark.parametrize("suffix", ["_R", "_Red", "_0", "_b", "_a_long_one"])
@pytest.mark.parametrize("name", ["pioneer3at_with_sensors", "pioneer2dx_with_sensors"])
def test_suffixes_of_the_gazebo_classes(catalog: RobotCatalog, name: str, suffix: str) -> None:
    """The 2015 classes take any suffix, which the client gets back in its own spelling."""
    robot = found(catalog, name + suffix)
    assert robot.name == name + suffix
    assert robot.model == name
    assert found(catalog, f"USARBot.{(name + suffix).upper()}").name == (name + suffix).upper()
    assert catalog.find(name + suffix.removeprefix("_")) is None


def test_pattern_never_hides_a_class_of_that_name(tmp_path: Path) -> None:
    """An exact name wins over a pattern that matches it, too."""
    write(tmp_path, "pioneer3at_with_sensors_X", table())
    robot = found(load_catalog([tmp_path]), "pioneer3at_with_sensors_x")
    assert (robot.name, robot.model) == ("pioneer3at_with_sensors_X", "pioneer3at_with_sensors_X")


def test_user_folder_adds_a_class(tmp_path: Path) -> None:
    """A robot file in a folder of the user's is a class; nothing else is needed."""
    write(tmp_path, "Rover", table(aliases=["Buggy"], alias_patterns=["rover-*"]))
    (tmp_path / "notes.txt").write_text("no robot")
    catalog = load_catalog([tmp_path])
    assert "Rover" in catalog.names()
    assert "Buggy" not in catalog.names()
    assert len(catalog.names()) == len(SHIPPED) + 1
    assert found(catalog, "USARBot.BUGGY").name == "Buggy"
    assert found(catalog, "Rover-7").name == "Rover-7"
    assert {found(catalog, name).model for name in ("rover", "buggy", "ROVER-7")} == {"Rover"}


def test_user_folder_replaces_a_shipped_class(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A user's class replaces the shipped one, also for its variants, and the log says so."""
    write(tmp_path, "p2at", table(name="P2AT"))
    with caplog.at_level(logging.INFO, logger="usarsim"):
        catalog = load_catalog([tmp_path])
    assert catalog.names() == SHIPPED
    assert found(catalog, "P2AT").report.mass == 6.2
    assert found(catalog, "StereoP2AT").report.mass == 6.2
    assert found(catalog, "P3AT").report.mass == 11.9
    assert "robot class is replaced" in caplog.text


def test_user_file_may_extend_what_it_replaces(tmp_path: Path) -> None:
    """The fast P3AT of the howto: three lines in a folder of one's own (robots 23)."""
    (tmp_path / "P3AT.toml").write_text('extends = "P3AT"\n[drive]\nmax_wheel_speed = 8.17\n')
    robot = found(load_catalog([tmp_path]), "P3AT")
    assert robot.drive.max_wheel_speed == 8.17
    assert robot.report.max_speed == 8.17
    assert robot.drive.max_wheel_speed * robot.report.wheel_radius == pytest.approx(0.80, abs=0.005)


def test_shipped_aliases_outlive_a_replaced_class(tmp_path: Path) -> None:
    """Names that a replaced file gave to a class lead to the new robot of that class."""
    write(tmp_path, "pioneer3at_with_sensors", table())
    assert found(load_catalog([tmp_path]), "pioneer3at_with_sensors_R").report.mass == 6.2


def test_only_names_are_read_at_first(tmp_path: Path) -> None:
    """A class is read when somebody asks for it; then a mistake in its file is one error."""
    write(tmp_path, "Rover", table(kind="x"))
    aliases = 'alias_patterns = [\n["a"],\n]\n'
    (tmp_path / "Truck.toml").write_text(aliases + (tmp_path / "Rover.toml").read_text())
    library = Library([tmp_path])
    with pytest.raises(RobotDescriptionError, match=r"Truck\.toml: kind"):
        library.names()
    (tmp_path / "Truck.toml").unlink()
    catalog = RobotCatalog(Library([tmp_path]).names())
    assert catalog.names() == ("Rover",)
    for _ in range(2):
        with pytest.raises(RobotDescriptionError, match=r"Rover\.toml: kind"):
            catalog.find("rover")


def test_later_folders_win(tmp_path: Path) -> None:
    """Of several folders the last one that has the class decides."""
    write(tmp_path / "one", "Rover", table(description="one"))
    write(tmp_path / "two", "ROVER", table(description="two", name="Rover"))
    catalog = load_catalog([tmp_path / "one", tmp_path / "two"])
    assert found(catalog, "rover").description == "two"
    assert catalog.names().count("Rover") == 1


def test_later_alias_wins_over_an_earlier_class(tmp_path: Path) -> None:
    """A user may map the name of a shipped class onto a robot of his own by an alias."""
    write(tmp_path, "Rover", table(aliases=["P2DX"]))
    robot = found(load_catalog([tmp_path]), "p2dx")
    assert (robot.name, robot.model) == ("P2DX", "Rover")


def test_one_name_twice_in_a_folder_is_an_error(tmp_path: Path) -> None:
    """Two robots of one folder cannot claim the same name."""
    write(tmp_path / "a", "One", table(aliases=["Both"]))
    write(tmp_path / "a", "Two", table(aliases=["BOTH"]))
    with pytest.raises(RobotDescriptionError, match="'BOTH' is also a name in"):
        load_catalog([tmp_path / "a"])
    write(tmp_path / "b", "Both", table())
    write(tmp_path / "b", "BOTH", table())
    with pytest.raises(RobotDescriptionError, match="by case only"):
        load_catalog([tmp_path / "b"])


def test_bad_folder_and_bad_file_are_errors(tmp_path: Path) -> None:
    """A missing folder and a bad file in it stop the loading with one error."""
    with pytest.raises(RobotDescriptionError, match="no such folder"):
        load_catalog([tmp_path / "absent"])
    write(tmp_path, "Rover", table(kind="x"))
    with pytest.raises(RobotDescriptionError, match=r"Rover\.toml: kind"):
        load_catalog([tmp_path])


def test_circle_over_folders_is_an_error(tmp_path: Path) -> None:
    """A user's P2AT that extends a variant of P2AT is refused instead of recursing."""
    write(tmp_path, "P2AT", {"extends": "StereoP2AT"})
    with pytest.raises(RobotDescriptionError, match="circle"):
        load_catalog([tmp_path])


def test_same_file_twice_is_one_class(tmp_path: Path) -> None:
    """Naming a folder twice does no harm."""
    write(tmp_path, "Rover", table())
    assert load_catalog([tmp_path, tmp_path]).names().count("Rover") == 1


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
