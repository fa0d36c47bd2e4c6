"""Cameras on the control port: tiles, CONF, GEO, zoom and viewports over sockets.

What image clients see of what robots do: over sockets only, by the content of the pictures.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_client import BlockingConnection, rectangle
from usarsim_server.assembly import Assembly
from usarsim_server.base.launch import LaunchError
from usarsim_server.testing import (
    PATIENCE,
    ScriptedClient,
    ServerProcess,
    eventually,
    running_server,
)

QUICK = {"world": "empty", "speed": 5.0, "max_robots": 4}


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[Assembly, int]]:
    """A server with an empty world and the usual grid."""
    with running_server(**QUICK) as (assembly, endpoints):
        yield assembly, endpoints["control"].port


@pytest.fixture
def spawn(server: tuple[Assembly, int]) -> Iterator[Callable[..., ScriptedClient]]:
    """Makes clients with robots; they leave at the end, and the board is empty then."""
    assembly, port = server
    clients = []

    def make(init: str) -> ScriptedClient:
        client = ScriptedClient(port)
        clients.append(client)
        client.send(f"INIT {init} {{Location {4 * len(clients)},0,-0.3}}")
        client.wait_for("STA")
        return client

    yield make
    for client in clients:
        client.close()
    wait(lambda: not assembly.board.views)


def wait(condition: Callable[[], bool]) -> None:
    """Until something is true."""
    assert eventually(condition)


def ask(client: ScriptedClient, question: str) -> str:
    """The answer to GETCONF or GETGEO."""
    client.send(question)
    return client.wait_for(question[3:].split(" ")[0])


def fields(line: str) -> dict[str, str]:
    """Values by key."""
    return dict(re.findall(r"\{(\w+) ([^{}]*)\}", line))


def test_two_robots_get_tiles_0_and_1(spawn: Callable[..., ScriptedClient]) -> None:
    """Unasked CONF before the first STA, the same when asked, exact (side channels 36 to 41,
    protocol 138)."""
    for number, init in enumerate(("{ClassName P3AT}", "{Classname P2AT}")):
        client = spawn(init)
        text = (
            "CONF {Type Camera} {Name Camera}"
            f"{{TextureOffsetX {320 * number}}}{{TextureOffsetY 0}}"
            "{TextureResolutionX 320}{TextureResolutionY 240}"
            "{CameraDefFov 80.0000}{CameraMinFov 20.0000}{CameraMaxFov 120.0000}{CameraFov 80.0000}"
        )
        assert ask(client, "GETCONF {Type Camera}") == text
        assert ask(client, "GETCONF {Type Camera} {Name camera}") == text


def test_configuration_comes_unasked(server: tuple[Assembly, int]) -> None:
    """It is the first line after INIT in udk; ut2004 gets one that it passes over
    (side channels 38)."""
    conf, nfo = "CONF {Type Camera} {Name Camera}{TextureOffsetX 0}", "NFO {Status CameraTile}"
    for dialect, first in (("udk", conf), ("ut2004", nfo)):
        with ScriptedClient(server[1]) as client:
            client.wait_for("NFO")
            client.send(f"INIT {{ClassName P3AT}} {{Dialect {dialect}}} {{Location 0,0,-0.3}}")
            assert client.read_line().startswith(first)
            told = client.listen(0.5)
            assert not [line for line in told if line.startswith(first[:18])]
        wait(lambda: not server[0].board.views)


def test_tile_of_a_robot_that_left_is_given_away(
    spawn: Callable[..., ScriptedClient], server: tuple[Assembly, int]
) -> None:
    """The next camera takes the lowest free tile; the others stay where they are
    (side channels 44)."""
    stereo = spawn("{ClassName StereoP2AT} {Dialect udk}")
    other = spawn("{ClassName P3AT}")
    told = ask(stereo, "GETCONF {Type Camera}")
    assert re.findall(r"OffsetX (\d+)", told) == ["0", "320"]
    assert fields(ask(other, "GETCONF {Type Camera}"))["TextureOffsetX"] == "640"
    stereo.close()
    wait(lambda: len(server[0].board.views) == 1)
    heir = spawn("{ClassName P3AT}")
    assert fields(ask(heir, "GETCONF {Type Camera}"))["TextureOffsetX"] == "0"
    assert fields(ask(other, "GETCONF {Type Camera}"))["TextureOffsetX"] == "640"


def test_zoom_changes_what_conf_says(
    spawn: Callable[..., ScriptedClient], server: tuple[Assembly, int]
) -> None:
    """FOV 0.5 narrows the view, without a reply; nameless 0.35 and 0 too (side channels 45,
    robots 101, protocol 166)."""
    client = spawn("{ClassName P3AT}")
    for text, shown in (
        ("{Opcode FOV} {Params 0.5}", "29.0000"),
        ("{Opcode Zoom} {0.35}", "20.0000"),
        ("{Opcode Zoom} {Params 0}", "80.0000"),
    ):
        client.send(f"SET {{Type Camera}} {{Name Camera}} {text}")
        client.send("GETCONF {Type Camera}")
        heard = client.wait_for(lambda line: not line.startswith(("STA", "SEN", "NFO")))
        assert heard.startswith("CONF"), "no result in udk"
        assert fields(heard)["CameraFov"] == shown
    assert [view.fov for view in server[0].board.views] == [1.3963]
    old = spawn("{ClassName P2AT}")
    old.send("SET {Type Camera} {Name Camera} {Opcode Zoom} {0.35}")
    assert re.fullmatch(
        r"RES \{Time [\d.]+\} \{Type Camera\} \{Name Camera\} \{Status OK\}", old.wait_for("RES")
    )
    assert fields(ask(old, "GETCONF {Type Camera}"))["CameraFov"] == "0.3500"


def test_geometry_names_the_link(spawn: Callable[..., ScriptedClient]) -> None:
    """The camera of a P2AT sits on its pan-tilt, that of a P3AT on the body (protocol 134)."""
    old, new = spawn("{ClassName P2AT}"), spawn("{ClassName P3AT}")
    assert ask(old, "GETGEO {Type Camera}").endswith("Mount CameraPanTilt_Link2}")
    assert ask(new, "GETGEO {Type Camera} {Name Camera}").endswith("{Mount P3AT}")


def test_viewports_never_break_the_connection(
    spawn: Callable[..., ScriptedClient], server: tuple[Assembly, int]
) -> None:
    """Known clients choose a single camera; nonsense is answered or ignored (side channels 46)."""
    client = spawn("{ClassName StereoP2AT}")
    client.send("SET {Type Viewports} {Config SingleView} {Viewport1 RightCamera}")
    assert "{Config SingleView} {Status OK} {Viewport1 RightCamera}" in client.wait_for("RES")
    shown = {view.name: view.tile for view in server[0].board.views}
    assert shown == {"LeftCamera": None, "RightCamera": 0}
    assert fields(client.wait_for("STA"))["View"] == "0"
    for text in ("", "{Config}", "{Config 7} {Viewport9 x}", "{Viewport1 {x}", "{Viewport1 \xe9}"):
        client.send(f"SET {{Type Viewports}} {text}")
    modern = spawn("{ClassName P3AT}")
    modern.send("SET {Type Viewports} {Config SingleView} {Viewport1 Camera2}")
    assert ask(modern, "GETCONF {Type Camera}").startswith("CONF {Type Camera}")
    assert ask(client, "GETCONF {Type Camera}").startswith("CONF {Type Camera}")


def test_a_connection_without_a_robot_binds_a_view(
    spawn: Callable[..., ScriptedClient], server: tuple[Assembly, int]
) -> None:
    """Any connection may choose the camera that a client of the picture port sees."""
    assembly, port = server
    spawn("{ClassName P2AT} {Name Blue}")
    with ScriptedClient(port) as operator:
        operator.send("SET {Type Camera} {Robot blue} {Name Camera} {Client 10.1.2.3}")
        wait(lambda: assembly.board.bound("10.1.2.3") == assembly.board.grid.region(0))
        operator.send("SET {Type Camera} {Client 10.1.2.3}")
        wait(lambda: assembly.board.bound("10.1.2.3") is None)


def test_surplus_cameras_and_other_grids() -> None:
    """A grid of one small tile: the first camera has it, the others report the origin
    (side channels 40, 43)."""
    with running_server(**QUICK, tiles=(1, 1), tile_size=(176, 144)) as (assembly, endpoints):
        port = endpoints["control"].port
        with ScriptedClient(port) as first, ScriptedClient(port) as second:
            for number, client in enumerate((first, second)):
                client.send(f"INIT {{ClassName P3AT}} {{Location {4 * number},0,-0.3}}")
                client.wait_for("STA")
                told = fields(ask(client, "GETCONF {Type Camera}"))
                assert (told["TextureOffsetX"], told["TextureOffsetY"]) == ("0", "0")
                assert (told["TextureResolutionX"], told["TextureResolutionY"]) == ("176", "144")
            assert fields(second.wait_for("STA"))["View"] == "-1"
            assert [view.tile for view in assembly.board.views] == [0, None]
            first.close()
            wait(lambda: len(assembly.board.views) == 1)
            assert ask(second, "GETCONF {Type Camera}").startswith("CONF {Type Camera}")


def test_a_camera_keeps_its_own_rate(tmp_path: Path) -> None:
    """Two pictures per simulated second as the robot file says, whatever the server's rate is."""
    (tmp_path / "Slow.toml").write_text(
        'extends = "P3AT"\n[[camera]]\nname = "Camera"\nposition = [0.1, 0, -0.42]\nrate = 2\n',
        encoding="utf-8",
    )
    with running_server(**QUICK, tile_size=(16, 16), robots=[tmp_path]) as (assembly, endpoints):
        with ScriptedClient(endpoints["control"].port) as client:
            client.send("INIT {ClassName Slow} {Location 0,0,-0.3}")
            client.wait_for("STA")
            watch = assembly.render_loop.watch(assembly.board.grid.region(0), lambda frame: None)
            wait(lambda: assembly.render_loop.pictures > 0)
            start, before = assembly.robots.time, assembly.render_loop.pictures
            wait(lambda: assembly.robots.time > start + 4.0)
            taken, seconds = assembly.render_loop.pictures - before, assembly.robots.time - start
            watch.close()
        assert 3 <= taken <= 2.0 * seconds + 2.0


SCENE = """<mujoco model="court">
  <visual>
    <headlight ambient="0.25 0.25 0.25" diffuse="0.1 0.1 0.1" specular="0 0 0"/>
  </visual>
  <worldbody>
    <light type="directional" dir="0.2 0 -1" diffuse="0.1 0.1 0.1" specular="0 0 0"/>
    <geom name="floor" type="plane" size="0 0 1" friction="1" rgba="0.5 0.5 0.5 1"/>
    <geom name="red" type="box" size="0.4 0.4 0.5" pos="3 0 0.5" rgba="0.9 0.05 0.05 1"/>
  </worldbody>
</mujoco>
"""
"""A red box 3 m ahead of the second start."""
SHEET = """title = "Court"
[[start]]
tag = "A"
position = [0.0, 20.0, 0.25]
yaw_degrees = 90.0
[[start]]
tag = "B"
position = [0.0, 0.0, 0.25]
yaw_degrees = 0.0
[[start]]
tag = "C"
position = [0.0, -10.0, 0.25]
yaw_degrees = -90.0
"""
WIDTH, HEIGHT = 320, 240

Picture = NDArray[np.int_]


@pytest.fixture(scope="module")
def pictures_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with raw pictures of the court."""
    folder: Path = tmp_path_factory.mktemp("worlds") / "court"
    folder.mkdir()
    (folder / "scene.xml").write_text(SCENE, encoding="utf-8")
    (folder / "world.toml").write_text(SHEET, encoding="utf-8")
    options = ("--world", str(folder), "--image-port", "0", "--image-type", "RAW")
    options += ("--image-silent-push", "off")  # or who is held up gets a picture unasked
    with ServerProcess(*options, "--spectator", "top") as process:
        yield process


GREY = 128
"""What all pixels of the picture are that a client gets while the renderer is late."""


class Viewer(BlockingConnection):
    """An image client, which asks again while the renderer is late."""

    def full(self) -> Picture:
        """The full frame."""
        return self._look(b"OK\r\n")

    def tile(self, number: int) -> Picture:
        """One tile of a grid of four columns."""
        x, y = number % 4 * WIDTH, number // 4 * HEIGHT
        return self._look(rectangle(x, y, WIDTH, HEIGHT))

    def _look(self, request: bytes) -> Picture:
        self.send(request)
        while ((seen := self.picture().pixels) == GREY).all():
            self.send(request)
        return seen.astype(int)


@pytest.fixture
def viewer(pictures_server: ServerProcess) -> Iterator[Viewer]:
    """An image client that hangs up after the test."""
    one = Viewer(pictures_server.ports["images"], patience=PATIENCE)
    yield one
    one.close()


@pytest.fixture
def placing(pictures_server: ServerProcess) -> Iterator[Callable[..., ScriptedClient]]:
    """Makes robots, which leave after the test."""
    clients: list[ScriptedClient] = []

    def make(start: str, robot_class: str = "P3AT_real") -> ScriptedClient:
        client = pictures_server.client()
        clients.append(client)
        client.send(f"INIT {{ClassName USARBot.{robot_class}}} {{Name {start}}} {{Start {start}}}")
        client.send("GETCONF {Type Camera}")
        client.wait_for("CONF {Type Camera}")
        return client

    yield make
    for client in clients:
        client.close()
    # The next test's robots are to have the same tiles.
    probe = Viewer(pictures_server.ports["images"], patience=PATIENCE)
    until(lambda: all(plain(probe.tile(number)) for number in (1, 2, 3)))
    probe.close()


def red(picture: Picture) -> NDArray[np.bool_]:
    """Pixels of the box in any light."""
    found: NDArray[np.bool_] = (
        picture[..., 0] > 2 * np.maximum(picture[..., 1], picture[..., 2])
    ) & (picture[..., 0] > 25)
    return found


def plain(picture: Picture) -> bool:
    """Whether a tile has no camera."""
    return bool((picture == picture[0, 0]).all())


def until(condition: Callable[[], bool]) -> None:
    """Wait for the world to get somewhere."""
    assert eventually(condition)


Spawn = Callable[..., ScriptedClient]


def test_a_box_before_the_second_robot_is_in_its_tile_only(viewer: Viewer, placing: Spawn) -> None:
    """Each robot's view is in its own tile (side channels 21, 36, 37); `top` is in the first."""
    placing("A")
    placing("B")
    until(lambda: red(viewer.tile(2)).sum() > 1000)
    assert not red(viewer.tile(1)).any()
    box = red(viewer.tile(2))
    columns = np.nonzero(box)[1]
    assert columns.mean() == pytest.approx(WIDTH / 2, abs=8)
    until(lambda: red(viewer.full())[:HEIGHT, 2 * WIDTH : 3 * WIDTH].sum() > 1000)
    frame = viewer.full()
    assert frame.shape == (960, 1280, 3)
    everywhere = red(frame)
    everywhere[:HEIGHT, :WIDTH] = False  # the spectator's view, from above
    assert np.array_equal(np.nonzero(everywhere)[1].min() // WIDTH, 2)
    assert everywhere.sum() == everywhere[:HEIGHT, 2 * WIDTH : 3 * WIDTH].sum()


def test_the_picture_follows_the_robot(viewer: Viewer, placing: Spawn) -> None:
    """Two pictures differ when the robot moves between them (side channels 34): to the left, box
    right."""
    robot = placing("B")

    def middle() -> float:
        columns = np.nonzero(red(viewer.tile(1)))[1]
        return float(columns.mean()) if columns.size else -1.0

    until(lambda: middle() == pytest.approx(WIDTH / 2, abs=8))
    robot.send("DRIVE {Left -2.0} {Right 2.0}")
    until(lambda: middle() > 0.65 * WIDTH)
    robot.send("DRIVE {Left 0} {Right 0}")


def test_headlights_brighten_the_box(viewer: Viewer, placing: Spawn) -> None:
    """`DRIVE {Light true}` lights what is before the robot, and `false` ends that."""
    robot = placing("B")

    def brightness() -> float:
        picture = viewer.tile(1)
        return float(picture[red(picture)][:, 0].mean())

    dark = brightness()
    robot.send("DRIVE {Light true}")
    until(lambda: brightness() > dark + 25)
    robot.send("DRIVE {Light false}")
    until(lambda: brightness() < dark + 5)


def test_zoom_makes_the_box_larger(viewer: Viewer, placing: Spawn) -> None:
    """`SET {Type Camera} ... {Opcode FOV}` narrows the picture, 0 restores it
    (side channels 45)."""
    robot = placing("B")
    before = red(viewer.tile(1)).sum()
    robot.send("SET {Type Camera} {Name Camera} {Opcode FOV} {Params 0.7}")
    until(lambda: red(viewer.tile(1)).sum() > 3 * before)
    robot.send("SET {Type Camera} {Name Camera} {Opcode FOV} {Params 0}")
    until(lambda: red(viewer.tile(1)).sum() == pytest.approx(before, rel=0.05))


def test_a_robot_that_leaves_takes_its_picture_along(viewer: Viewer, placing: Spawn) -> None:
    """The socket stays open, the frame keeps its size, the tile becomes plain
    (side channels 35)."""
    robot = placing("B")
    assert red(viewer.tile(1)).any()
    robot.close()
    until(lambda: plain(viewer.tile(1)))
    assert viewer.full().shape == (960, 1280, 3)


def test_classes_new_to_the_world_leave_pictures_right(viewer: Viewer, placing: Spawn) -> None:
    """While the model grows under the renderer, a camera goes on seeing the same."""
    placing("B")
    before = red(viewer.tile(1)).sum()
    for robot_class, start in (("P2DX", "A"), ("P2AT", "C")):
        placing(start, robot_class)
        assert red(viewer.tile(1)).sum() == pytest.approx(before, rel=0.05)
    assert not red(viewer.tile(2)).any()
    assert not plain(viewer.tile(3))


def test_two_viewers_of_different_tiles(
    pictures_server: ServerProcess, viewer: Viewer, placing: Spawn
) -> None:
    """Each gets what it asks for, whatever the other one looks at."""
    placing("A")
    placing("B")
    other = Viewer(pictures_server.ports["images"], patience=PATIENCE)
    try:
        for _ in range(5):
            assert not red(viewer.tile(1)).any()
            assert red(other.tile(2)).any()
    finally:
        other.close()


def test_a_view_that_does_not_exist_is_one_error() -> None:
    """A spectator with a misspelt view keeps the server from starting, and says what there is."""
    with pytest.raises(LaunchError, match=r"error: there is no view 'tpo' \(known: .*top"):
        ServerProcess("--world", "empty", "--image-port", "0", "--spectator", "tpo")
