"""What image clients see of what robots do: over sockets only, by the content of the pictures."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_server.testing import PATIENCE, ScriptedClient, ServerProcess, eventually

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
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
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


class Viewer:
    """An image client, which asks again while the renderer is late."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self._stream = self.socket.makefile("rb")

    def full(self) -> Picture:
        """The full frame."""
        return self._ask(b"OK\r\n")

    def tile(self, number: int) -> Picture:
        """One tile of a grid of four columns."""
        x, y = number % 4 * WIDTH, number // 4 * HEIGHT
        request = b"U" + b"".join(part.to_bytes(4) for part in (x, y, WIDTH, HEIGHT))
        return self._ask(request)

    def _ask(self, request: bytes) -> Picture:
        self.socket.sendall(request)
        while ((picture := self._read()) == GREY).all():
            self.socket.sendall(request)
        return picture

    def _read(self) -> Picture:
        header = self._stream.read(5)
        data = self._stream.read(int.from_bytes(header[1:]))
        width, height = int.from_bytes(data[:2]), int.from_bytes(data[2:4])
        blue_first = np.frombuffer(data, np.uint8, offset=4).reshape(height, width, 3)
        return blue_first[..., ::-1].astype(int)

    def close(self) -> None:
        """Hang up."""
        self.socket.close()


@pytest.fixture
def viewer(server: ServerProcess) -> Iterator[Viewer]:
    """An image client that hangs up after the test."""
    one = Viewer(server.ports["images"])
    yield one
    one.close()


@pytest.fixture
def spawn(server: ServerProcess) -> Iterator[Callable[..., ScriptedClient]]:
    """Makes robots, which leave after the test."""
    clients: list[ScriptedClient] = []

    def make(start: str, robot_class: str = "P3AT_real") -> ScriptedClient:
        client = server.client()
        clients.append(client)
        client.send(f"INIT {{ClassName USARBot.{robot_class}}} {{Name {start}}} {{Start {start}}}")
        client.send("GETCONF {Type Camera}")
        client.wait_for("CONF {Type Camera}")
        return client

    yield make
    for client in clients:
        client.close()
    # The next test's robots are to have the same tiles.
    probe = Viewer(server.ports["images"])
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


def test_a_box_before_the_second_robot_is_in_its_tile_only(viewer: Viewer, spawn: Spawn) -> None:
    """Each robot's view is in its own tile (checks 21, 36, 37); `top` is in the first."""
    spawn("A")
    spawn("B")
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


def test_the_picture_follows_the_robot(viewer: Viewer, spawn: Spawn) -> None:
    """Two pictures differ when the robot moves between them (check 34): to the left, box right."""
    robot = spawn("B")

    def middle() -> float:
        columns = np.nonzero(red(viewer.tile(1)))[1]
        return float(columns.mean()) if columns.size else -1.0

    until(lambda: middle() == pytest.approx(WIDTH / 2, abs=8))
    robot.send("DRIVE {Left -2.0} {Right 2.0}")
    until(lambda: middle() > 0.65 * WIDTH)
    robot.send("DRIVE {Left 0} {Right 0}")


def test_headlights_brighten_the_box(viewer: Viewer, spawn: Spawn) -> None:
    """`DRIVE {Light true}` lights what is before the robot, and `false` ends that."""
    robot = spawn("B")

    def brightness() -> float:
        picture = viewer.tile(1)
        return float(picture[red(picture)][:, 0].mean())

    dark = brightness()
    robot.send("DRIVE {Light true}")
    until(lambda: brightness() > dark + 25)
    robot.send("DRIVE {Light false}")
    until(lambda: brightness() < dark + 5)


def test_zoom_makes_the_box_larger(viewer: Viewer, spawn: Spawn) -> None:
    """`SET {Type Camera} ... {Opcode FOV}` narrows the picture, 0 restores it (check 45)."""
    robot = spawn("B")
    before = red(viewer.tile(1)).sum()
    robot.send("SET {Type Camera} {Name Camera} {Opcode FOV} {Params 0.7}")
    until(lambda: red(viewer.tile(1)).sum() > 3 * before)
    robot.send("SET {Type Camera} {Name Camera} {Opcode FOV} {Params 0}")
    until(lambda: red(viewer.tile(1)).sum() == pytest.approx(before, rel=0.05))


def test_a_robot_that_leaves_takes_its_picture_along(viewer: Viewer, spawn: Spawn) -> None:
    """The socket stays open, the frame keeps its size, the tile becomes plain (check 35)."""
    robot = spawn("B")
    assert red(viewer.tile(1)).any()
    robot.close()
    until(lambda: plain(viewer.tile(1)))
    assert viewer.full().shape == (960, 1280, 3)


def test_classes_new_to_the_world_leave_pictures_right(viewer: Viewer, spawn: Spawn) -> None:
    """While the model grows under the renderer, a camera goes on seeing the same."""
    spawn("B")
    before = red(viewer.tile(1)).sum()
    for robot_class, start in (("P2DX", "A"), ("P2AT", "C")):
        spawn(start, robot_class)
        assert red(viewer.tile(1)).sum() == pytest.approx(before, rel=0.05)
    assert not red(viewer.tile(2)).any()
    assert not plain(viewer.tile(3))


def test_two_viewers_of_different_tiles(
    server: ServerProcess, viewer: Viewer, spawn: Spawn
) -> None:
    """Each gets what it asks for, whatever the other one looks at."""
    spawn("A")
    spawn("B")
    other = Viewer(server.ports["images"])
    try:
        for _ in range(5):
            assert not red(viewer.tile(1)).any()
            assert red(other.tile(2)).any()
    finally:
        other.close()


def test_a_view_that_does_not_exist_is_one_error() -> None:
    """A spectator with a misspelt view keeps the server from starting, and says what there is."""
    with pytest.raises(RuntimeError, match=r"error: there is no view 'tpo' \(known: .*top"):
        ServerProcess("--world", "empty", "--image-port", "0", "--spectator", "tpo")
