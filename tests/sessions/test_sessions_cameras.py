"""The cameras of one robot: CONF, GEO, zoom, viewports, views bound to addresses."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import pytest
from sharing import shipped_robots

from usarsim_server.base.logs import ROOT
from usarsim_server.cameras.board import CameraBoard
from usarsim_server.cameras.view import Grid, Region
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.requests import Set
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import CameraDescription, RobotDescription
from usarsim_server.sessions.cameras import CameraMount, bind_view
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.snapshot import RobotBody

UDK, UT2004 = Dialect.UDK, Dialect.UT2004
ROSTER = shipped_robots()
LENS = "{CameraDefFov 80.0000}{CameraMinFov 20.0000}{CameraMaxFov 120.0000}"


def robot(name: str, *cameras: str) -> RobotDescription:
    """A shipped class, with other cameras if any are named."""
    found = ROSTER.find(name)
    assert found is not None
    others = tuple(CameraDescription(camera) for camera in cameras)
    return replace(found, cameras=others) if cameras else found


def test_a_camera_with_a_size_of_its_own() -> None:
    """ARDrone's Camera2 tells 176 x 144 in the corner of its tile; who is bound to it gets that."""
    stage = Stage(robot("ARDrone"))
    told = stage.mount.configuration("Camera", "Camera2", UDK)
    place = "{TextureOffsetX 320}{TextureOffsetY 0}"
    assert f"{place}{{TextureResolutionX 176}}{{TextureResolutionY 144}}" in told
    stage.board.bind("10.0.0.7", stage.keys[1])
    assert stage.board.bound("10.0.0.7") == Region(320, 0, 176, 144)
    # A tile that is smaller cuts it down.
    small = Stage(robot("ARDrone"), Grid(1, 1, 160, 120))
    small.set("SET {Type Viewports} {Config SingleView} {Viewport1 Camera2}", UT2004)
    told = small.mount.configuration("Camera", "Camera2", UDK)
    assert "{TextureResolutionX 160}{TextureResolutionY 120}" in told


class Stage:
    """A board with one robot on it, and what its client would say to it."""

    def __init__(self, kind: RobotDescription, grid: Grid | None = None, before: int = 0) -> None:
        self.board = CameraBoard(grid or Grid())
        for number in range(before):
            self.board.add("Camera", f"other{number}", 100 + number, None, Pose(), 1.0)
        self.keys = [
            self.board.add(one.name, "me", 7, one.link, one.pose, one.fov, one.rate, one.size).key
            for one in kind.cameras
        ]
        self.mount = CameraMount(
            kind, 7, self.keys, self.board, lambda: cast(RobotBody, SimpleNamespace(time=12.34))
        )

    def set(self, text: str, dialect: Dialect) -> list[str]:
        """The reply to a command line."""
        return self.mount.set(request(text), dialect)

    def fov(self, index: int = 0) -> float:
        """Present field of view of a camera, rad."""
        view = self.board.get(self.keys[index])
        assert view is not None
        return view.fov

    def shown(self) -> dict[int, str]:
        """Names of the cameras by tile."""
        return {view.tile: view.name for view in self.board.views if view.tile is not None}


def request(text: str) -> Set:
    """A SET as the server understands it."""
    (command,) = parse_line(text.encode("latin-1"))
    found = interpret(command)
    assert isinstance(found, Set)
    return found


# -- CONF ------------------------------------------------------------------------------------------


def test_configuration_in_udk() -> None:
    """The exact text of side channels 2.10 (side channels 36, 40, 41; protocol 138 and 5.2
    no. 30)."""
    assert Stage(robot("P3AT")).mount.configuration("Camera", None, UDK) == (
        "CONF {Type Camera} {Name Camera}{TextureOffsetX 0}{TextureOffsetY 0}"
        "{TextureResolutionX 320}{TextureResolutionY 240}"
        f"{LENS}{{CameraFov 80.0000}}"
    )


def test_all_cameras_stand_in_one_line() -> None:
    """Two cameras behind another robot's in a 2 x 2 grid, as the reference composes
    (side channels 39, 42)."""
    stage = Stage(robot("P3AT", "CameraTop", "CameraBottom"), Grid(2, 2), before=2)
    rest = f"{{TextureResolutionX 320}}{{TextureResolutionY 240}}{LENS}{{CameraFov 80.0000}}"
    assert stage.mount.configuration("Camera", None, UDK) == (
        f"CONF {{Type Camera}} {{Name CameraTop}}{{TextureOffsetX 0}}{{TextureOffsetY 240}}{rest} "
        f"{{Name CameraBottom}}{{TextureOffsetX 320}}{{TextureOffsetY 240}}{rest}"
    )
    one = stage.mount.configuration("camera", " camerabottom ", UDK)
    assert one.startswith("CONF {Type camera} {Name CameraBottom}{TextureOffsetX 320}")
    assert "CameraTop" not in one


def test_resolution_is_that_of_a_tile() -> None:
    """A single small tile, as a known client wants it (side channels 40)."""
    stage = Stage(robot("P3AT"), Grid(1, 1, 176, 144))
    line = stage.mount.configuration("Camera", None, UDK)
    assert "{TextureResolutionX 176}{TextureResolutionY 144}" in line


def test_camera_without_tile_reports_the_origin() -> None:
    """More cameras than tiles: offset 0, 0, and no notice is sent (side channels 43)."""
    stage = Stage(robot("P3AT"), Grid(2, 1), before=2)
    assert "{TextureOffsetX 0}{TextureOffsetY 0}" in stage.mount.configuration("Camera", None, UDK)
    assert stage.mount.take_news(1.0, UDK) == []
    assert stage.mount.take_news(1.0, UT2004) == []
    assert stage.mount.view == -1


def test_configuration_in_ut2004() -> None:
    """Radians in segments of their own, without tiles, canonical type (protocol 128, 138)."""
    lens = "{CameraDefFov 1.3963} {CameraMinFov 0.3491} {CameraMaxFov 2.0944} {CameraFov 1.3963}"
    assert Stage(robot("StereoP2AT")).mount.configuration("CAMERA", None, UT2004) == (
        f"CONF {{Type Camera}} {{Name LeftCamera}} {lens} {{Name RightCamera}} {lens}"
    )


@pytest.mark.parametrize("dialect", list(Dialect))
def test_no_answer_without_a_match(dialect: Dialect) -> None:
    """Other types, other names and robots without cameras get no line (protocol 126)."""
    stage = Stage(robot("P3AT"))
    assert stage.mount.configuration("Camera", "Rear", dialect) == ""
    assert stage.mount.configuration("Sonar", None, dialect) == ""
    assert stage.mount.geometry("Camera", "Rear", dialect) == ""
    bare = Stage(robot("KR60"))
    assert bare.mount.configuration("Camera", None, dialect) == ""
    assert bare.mount.geometry("Camera", None, dialect) == ""
    assert bare.mount.view == -1


# -- GEO -------------------------------------------------------------------------------------------


def test_geometry_on_a_moving_link() -> None:
    """The link carries the camera: by name, or as actuator and number (protocol 134, 135)."""
    mount = Stage(robot("P2AT")).mount
    assert mount.geometry("camera", None, UT2004) == (
        "GEO {Type Camera} {Name Camera Location 0.0820,0.0002,0.0613 "
        "Orientation 0.0000,0.0000,0.0000 Mount CameraPanTilt_Link2}"
    )
    assert mount.geometry("camera", None, UDK) == (
        "GEO {Type Camera} {Name Camera} {Location 0.08,0.00,0.06} {Orientation 0.00,0.00,0.00} "
        "{Mount CameraPanTilt} {MountLink 2}"
    )


def test_geometry_on_the_chassis() -> None:
    """Fixed cameras end in HARD, or in the class (protocol 134)."""
    mount = Stage(robot("P3AT")).mount
    assert mount.geometry("Camera", "camera", UT2004).endswith(
        "{Name Camera Location 0.1005,0.0000,-0.4200 Orientation 0.0000,0.0000,0.0000 Mount HARD}"
    )
    assert mount.geometry("Camera", None, UDK).endswith("{Orientation 0.00,0.00,0.00} {Mount P3AT}")


# -- news ------------------------------------------------------------------------------------------


def test_udk_clients_are_told_their_tiles_once() -> None:
    """One CONF per camera, unasked (side channels 38)."""
    stage = Stage(robot("P3AT", "A", "B"))
    first, second = stage.mount.take_news(1.0, UDK)
    assert first == stage.mount.configuration("Camera", "A", UDK)
    assert second == stage.mount.configuration("Camera", "B", UDK)
    assert stage.mount.take_news(2.0, UDK) == []


def test_ut2004_clients_get_a_line_they_pass_over() -> None:
    """That generation knew no unsolicited CONF, so an NFO nobody looks for tells it."""
    stage = Stage(robot("P2AT"))
    assert stage.mount.take_news(1.0, UT2004) == [
        "NFO {Status CameraTile} {Time 1.0000} {Type Camera} {Name Camera}"
    ]


# -- zoom ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("opcode", ["Zoom", "FOV", "zoom"])
def test_zoom_in_udk(opcode: str) -> None:
    """Whole degrees, limits, zero for the default, never a reply (side channels 45, robots 101)."""
    stage = Stage(robot("P3AT"))

    def after(value: str) -> str:
        text = f"SET {{Type Camera}} {{Name Camera}} {{Opcode {opcode}}} {{Params {value}}}"
        assert stage.set(text, UDK) == []
        return stage.mount.configuration("Camera", None, UDK).rsplit("{", 1)[1]

    assert after("0.5") == "CameraFov 29.0000}"
    assert stage.fov() == pytest.approx(0.50615, abs=1e-5)
    assert after("0.2") == "CameraFov 20.0000}"
    assert stage.fov() == 0.3491
    assert after("3,0") == "CameraFov 120.0000}"
    assert stage.fov() == 2.0944
    assert after("-1e30") == "CameraFov 20.0000}"
    assert after("0") == "CameraFov 80.0000}"
    assert stage.fov() == 1.3963


def test_zoom_in_ut2004() -> None:
    """Radians as they are sent, and a result (robots 101, protocol 163)."""
    stage = Stage(robot("P2AT"))
    ok = ["RES {Time 12.34} {Type Camera} {Name Camera} {Status OK}"]
    assert stage.set("SET {Type Camera} {Name Camera} {Opcode Zoom} {Params 0.5}", UT2004) == ok
    assert stage.fov() == 0.5
    assert "{CameraFov 0.5000}" in stage.mount.configuration("Camera", None, UT2004)
    for value, fov in (("0.2", 0.3491), ("3.0", 2.0944), ("0", 1.3963)):
        stage.set(f"SET {{Type Camera}} {{Name Camera}} {{Opcode Zoom}} {{Params {value}}}", UT2004)
        assert stage.fov() == fov


@pytest.mark.parametrize(
    "text",
    [
        "SET {Type Camera} {Name Camera} {Opcode Zoom} {0.700000}",
        "SET {Type Camera} {Name Camera} {FOV 0.7}",
        "set {type camera} {name CAMERA} {opcode fov} {params .7} ",
        "SET {Type Camera} {Opcode Zoom} {Params 0.7}",
    ],
)
def test_irregular_spellings_of_zoom(text: str) -> None:
    """The value may stand in a nameless group, as the Player driver sends it (protocol 166)."""
    stage = Stage(robot("P2AT"))
    assert len(stage.set(text, UT2004)) == 1
    assert stage.fov() == pytest.approx(0.7)


def test_zoom_of_all_cameras_or_one() -> None:
    """Without a name all cameras of the robot are meant; nobody else's."""
    stage = Stage(robot("StereoP2AT"), before=1)
    results = stage.set("SET {Type Camera} {Opcode FOV} {Params 1}", UT2004)
    assert [line.split("{Name ")[1].split("}")[0] for line in results] == [
        "LeftCamera",
        "RightCamera",
    ]
    stage.set("SET {Type Camera} {Name RightCamera} {Opcode FOV} {Params 0.6}", UT2004)
    assert (stage.fov(0), stage.fov(1)) == (1.0, 0.6)
    assert stage.board.views[0].fov == 1.0


@pytest.mark.parametrize(
    "text",
    [
        "SET {Type Camera} {Name Rear} {Opcode Zoom} {Params 0.5}",
        "SET {Type Camera} {Name Camera} {Opcode Iris} {Params 0.5}",
        "SET {Type Camera} {Name Camera}",
        "SET {Type Sonar} {Name Camera} {Opcode Zoom} {Params 0.5}",
    ],
)
def test_what_no_camera_knows_is_ignored(text: str) -> None:
    """Unknown names, opcodes and types change nothing and give no result (protocol 163)."""
    stage = Stage(robot("P2AT"))
    assert stage.set(text, UT2004) == []
    assert stage.fov() == 1.3963


# -- viewports -------------------------------------------------------------------------------------

QUAD = "SET {Type Viewports} {Config QuadView} "


def test_single_view_shows_the_chosen_camera() -> None:
    """The reply of side channels reference 2.11, and the picture on the robot's tile
    (side channels 46)."""
    stage = Stage(robot("P2AT", "Camera1", "Camera2"), Grid(1, 1, 176, 144))
    assert stage.shown() == {0: "Camera1"}
    said = stage.set("SET {Type Viewports} {Config SingleView} {Viewport1 Camera2}", UT2004)
    assert said == [
        "RES {Time 12.34} {Type Viewports} {Config SingleView} {Status OK} "
        "{Viewport1 Camera2} {Status OK} {Viewport2 Disabled} {Status OK} "
        "{Viewport3 Disabled} {Status OK} {Viewport4 Disabled} {Status OK}"
    ]
    assert stage.shown() == {0: "Camera2"}


def test_quad_view_chooses_the_cameras_of_four_tiles() -> None:
    """Viewport k is tile k of the robot; what is not named stays as it is."""
    stage = Stage(robot("P2AT", *"ABCDE"), before=1)
    assert stage.shown() == {0: "Camera", 1: "A", 2: "B", 3: "C", 4: "D", 5: "E"}
    (said,) = stage.set(QUAD + "{Viewport1 d} {Viewport3 Disable} {Viewport4 A}", UT2004)
    assert said.endswith(
        "{Config QuadView} {Status OK} {Viewport1 D} {Status OK} {Viewport2 B} {Status OK} "
        "{Viewport3 Disabled} {Status OK} {Viewport4 A} {Status OK}"
    )
    assert stage.shown() == {0: "Camera", 1: "D", 2: "B", 4: "A", 5: "E"}
    stage.set("SET {Type Viewports} {Config 0} {Viewport1 C}", UT2004)
    assert stage.shown() == {0: "Camera", 1: "C"}
    stage.set("SET {Type Viewports} {Config 1}", UT2004)
    assert stage.shown() == {0: "Camera", 1: "C", 2: "B", 4: "A", 5: "E"}


def test_view_is_the_first_tile_whatever_it_shows() -> None:
    """STA tells where the picture of the robot is (protocol reference 4.3)."""
    stage = Stage(robot("StereoP2AT"), before=3)
    assert stage.mount.view == 3
    stage.set(QUAD + "{Viewport1 None} {Viewport2 LeftCamera}", UT2004)
    assert stage.mount.view == 3
    assert stage.shown()[4] == "LeftCamera"


def test_viewport_failures_are_told() -> None:
    """A camera that does not exist is None, a viewport without a tile cannot show anything."""
    stage = Stage(robot("P2AT"))
    (said,) = stage.set(QUAD + "{Viewport1 Rear} {Viewport2 Camera} {Viewport3 None}", UT2004)
    assert said.endswith(
        "{Config QuadView} {Status OK} {Viewport1 None} {Status Failed} {Viewport2 Camera} "
        "{Status Failed} {Viewport3 Disabled} {Status OK} {Viewport4 Disabled} {Status OK}"
    )
    assert stage.shown() == {0: "Camera"}
    (said,) = stage.set("SET {Type Viewports} {Config Triple}", UT2004)
    assert "{Config QuadView} {Status Failed}" in said


def test_initial_configuration_depends_on_the_number_of_cameras() -> None:
    """SingleView for one camera at most, QuadView for more (side channels reference 2.11)."""
    for name, config in (("KR60", "SingleView"), ("P2AT", "SingleView"), ("StereoP2AT", "Quad")):
        (said,) = Stage(robot(name)).set("SET {Type Viewports}", UT2004)
        assert f"{{Config {config}" in said


def test_udk_takes_viewports_without_doing_anything() -> None:
    """That generation had no handler for them (side channels reference 2.11)."""
    stage = Stage(robot("StereoP2AT"))
    assert stage.set(QUAD + "{Viewport1 RightCamera}", UDK) == []
    assert stage.shown() == {0: "LeftCamera", 1: "RightCamera"}


# -- views bound to addresses ----------------------------------------------------------------------


def test_view_of_an_address_is_bound() -> None:
    """With Robot it is bound, without it is released; ut2004 tells how it went."""
    stage = Stage(robot("P2AT"), before=2)
    attach = "SET {Type Camera} {Robot ME} {Name camera} {Client 10.0.0.7}"
    assert stage.set(attach, UT2004) == ["RES {Time 12.34} {Type Camera} {Name camera} {Status OK}"]
    assert stage.board.bound("10.0.0.7") == stage.board.grid.region(2)
    assert stage.set("SET {Type Camera} {Name Camera} {Client 10.0.0.7}", UDK) == []
    assert stage.board.bound("10.0.0.7") is None


@pytest.mark.parametrize(
    ("text", "done"),
    [
        ("SET {Type Camera} {Robot me} {Name Camera} {Client 10.0.0.7}", True),
        ("SET {Type Camera} {Robot you} {Name Camera} {Client 10.0.0.7}", False),
        ("SET {Type Camera} {Robot me} {Name Rear} {Client 10.0.0.7}", True),
        ("SET {Type Camera} {Robot me} {Client 10.0.0.7}", True),
        ("SET {Type Camera} {Robot you} {Name Rear} {Client 10.0.0.7}", False),
        ("SET {Type Camera} {Robot me} {Name Camera} {Client somewhere}", False),
        ("SET {Type Camera} {Robot me} {Name Camera}", None),
        ("SET {Type Camera} {Name Camera} {Opcode Zoom} {Params 1} {Client 10.0.0.7}", None),
        ("SET {Type Sonar} {Robot me} {Name Camera} {Client 10.0.0.7}", None),
    ],
)
def test_what_can_be_bound(text: str, done: bool | None) -> None:
    """Only cameras and addresses that exist; other requests are left to others."""
    stage = Stage(robot("P2AT"))
    assert bind_view(stage.board, request(text)) is done
    assert (stage.board.bound("10.0.0.7") is not None) is bool(done)


def test_any_name_is_the_only_camera(caplog) -> None:
    """A robot's one camera is bound by any name, with a log line; of two the name decides."""
    caplog.set_level("INFO", ROOT)
    attach = "SET {Type Camera} {Robot me} {Name RobotCamera} {Client 10.0.0.7}"
    assert bind_view(Stage(robot("Sedan")).board, request(attach))
    assert "RobotCamera" in caplog.text
    assert not bind_view(Stage(robot("StereoP2AT")).board, request(attach))


def test_a_robot_that_has_left_is_no_error() -> None:
    """A late command of a robot whose cameras are gone changes nothing."""
    stage = Stage(robot("StereoP2AT"))
    stage.board.remove_robot(7)
    other = stage.board.add("Camera", "heir", 8, None, Pose(), 1.0)
    assert stage.set("SET {Type Camera} {Opcode Zoom} {Params 1}", UDK) == []
    stage.set(QUAD + "{Viewport1 RightCamera}", UT2004)
    assert "{CameraFov 80.0000}" in stage.mount.configuration("Camera", None, UDK)
    assert stage.mount.take_news(1.0, UDK) == []
    assert stage.mount.view == -1
    assert stage.board.views == (other,)
