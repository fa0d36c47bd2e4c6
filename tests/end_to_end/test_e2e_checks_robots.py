"""Checks of the robots reference that are seen only when a whole machine, or a picture, is played.

Numbers in docstrings are those of the robots reference, section 5.

Checks of the side channels reference that need a whole server, and all of its ports.

Numbers in docstrings are those of the side channels reference, section 11.
"""

from __future__ import annotations

import gc
import io
import logging
import math
import re
import socket
import struct
from collections.abc import Callable, Iterator
from itertools import permutations
from pathlib import Path

import numpy as np
import psutil
import pytest
from numpy.typing import NDArray
from PIL import Image
from side_clients import WirelessModel, split_reply

from usarsim_client import BlockingConnection, rectangle
from usarsim_server.base.logs import ROOT
from usarsim_server.options import load_settings
from usarsim_server.services.listener import Endpoint
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.simulation.frames import Vector
from usarsim_server.testing import (
    PATIENCE,
    SIDE_PORTS,
    Rehearsal,
    RehearsedClient,
    ScriptedClient,
    ServerProcess,
    eventually,
    running_server,
)

# -- machines --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """An endless floor."""
    with Rehearsal(world="empty") as rehearsal:
        yield rehearsal


Hire = Callable[..., tuple[RehearsedClient, Vehicle]]


@pytest.fixture
def hire(stage: Rehearsal) -> Iterator[Hire]:
    """Puts robots into the world; they leave after the test."""
    clients: list[RehearsedClient] = []

    def make(robot_class: str, more: str) -> tuple[RehearsedClient, Vehicle]:
        clients.append(stage.connect())
        clients[-1].send(f"INIT {{ClassName USARBot.{robot_class}}} {more}")
        return clients[-1], stage.assembly.robots.vehicles[-1]

    yield make
    for client in clients:
        client.close()
    stage.run(0.05)


def place(vehicle: Vehicle) -> Vector:
    """Where it is; it must not have been lost."""
    state = vehicle.body.look()
    assert state is not None, "lost"
    return state.pose.position


def upright(vehicle: Vehicle) -> float:
    """Cosine of the angle between its own z axis and the vertical."""
    state = vehicle.body.look()
    assert state is not None, "lost"
    return state.pose.rotate((0.0, 0.0, 1.0))[2]


@pytest.mark.parametrize("robot_class", ["KR60", "TwoLink", "ComStation"])
def test_static_platforms_stand(stage: Rehearsal, hire: Hire, robot_class: str) -> None:
    """DRIVE, gravity and a robot that runs into it do not move a platform (robots 13)."""
    high, hanging = hire(robot_class, "{Location 0,8,-1.5}")
    low, standing = hire(robot_class, "{Location 0,0,-0.25}")
    everything = "{Left 5} {Right 5} {Speed 5} {FrontSteer 1} {RearSteer 1} {LinearVelocity 1}"
    for client in (high, low):
        client.send(f"DRIVE {everything}")
    driver, ram = hire("P2AT", "{Location -1.5,0,-0.3} {Dialect ut2004}")
    driver.send("DRIVE {Left 5.3} {Right 5.3}")
    before = place(standing)
    stage.run(5.0)
    assert place(hanging) == pytest.approx((0.0, -8.0, 1.5), abs=1e-5)
    assert place(standing) == pytest.approx(before, abs=1e-4)
    assert -1.2 < place(ram)[0] < 0.0, "the robot met it, and did not get past"


@pytest.mark.parametrize(
    ("robot_class", "separation", "mass"),
    [
        ("BasicSkidRobot", 1.152, 14.0),
        ("CasterSkidRobot", 1.152, 13.0),
        ("Kiva4Wheel", 0.648, None),
    ],
)
def test_robots_of_the_later_generation(
    stage: Rehearsal, hire: Hire, robot_class: str, separation: float, mass: float | None
) -> None:
    """GEO and CONF tell the track and the mass of the originals; a Kiva weighs what the physics
    moves (robots 7, 8)."""
    client, robot = hire(robot_class, "{Location 40,0,-0.5}")
    client.send("GETGEO {Type Robot}")
    (geo,) = re.findall(r"\{WheelSeparation ([\d.]+)\}", client.take("GEO")[0])
    client.send("GETCONF {Type Robot}")
    (told,) = re.findall(r"\{Mass ([\d.]+)\}", client.take("CONF")[0])
    assert float(geo) == pytest.approx(separation, abs=1e-4)
    state = robot.body.look()
    assert state is not None
    model = stage.assembly.simulation.compiled(state.snapshot).model
    moved = float(model.body_subtreemass[state.layout.base])
    assert float(told) == pytest.approx(mass or moved, rel=1e-3)
    assert moved == pytest.approx(float(told), rel=1e-3)


@pytest.mark.parametrize(("dialect", "rights"), [("ut2004", True), ("udk", False)])
def test_flip_rights_a_robot_of_the_old_generation(
    stage: Rehearsal, hire: Hire, dialect: str, rights: bool
) -> None:
    """An overturned P2AT gets up on Flip in ut2004 and lies on in udk (robots 50)."""
    more = f"{{Location 20,0,-0.6}} {{Rotation 3.14159,0,0.5}} {{Dialect {dialect}}}"
    client, robot = hire("P2AT", more)
    stage.run(1.0)
    assert upright(robot) < -0.8
    client.send("DRIVE {Flip true}")
    stage.run(1.5)
    assert upright(robot) > 0.99 if rights else upright(robot) < -0.8


def test_a_wall_stops_a_robot_on_the_wire(tmp_path: Path) -> None:
    """At full speed into a wall: its nose sinks in by less than 1 cm, it does not climb, and what
    it tells of itself says so (robots 59)."""
    folder = world(tmp_path, '<geom type="box" pos="2 0 1" size="0.1 3 1"/>')
    with Rehearsal(world=str(folder)) as yard:
        client = yard.connect()
        client.send("INIT {ClassName P2AT} {Location 0,0,-0.2} {Dialect ut2004}")
        yard.run(0.5)
        (robot,) = yard.assembly.robots.vehicles
        height = place(robot)[2]
        client.send("GETGEO {Type Robot}", "DRIVE {Left 100} {Right 100} {Normalized true}")
        found = re.search(r"\{Dimensions ([\d.]+),", client.take("GEO")[0])
        assert found is not None
        yard.run(4.0)
        reached = place(robot)
        client.take()
        yard.run(3.0)
        truth = [line for line in client.take("SEN") if "{Type GroundTruth}" in line][-1]
        (told,) = re.findall(r"\{Location (-?[\d.]+),", truth)
        assert float(told) == pytest.approx(place(robot)[0], abs=0.011), "two digits, cut off"
    nose = 0.5 * float(found[1])
    assert 1.9 - nose - 0.15 < reached[0] < 1.9 - nose + 0.15, "it is at the wall"
    assert math.dist(place_xy(reached), place_xy(place(robot))) < 0.01, "it stays there"
    assert abs(reached[2] - height) < 0.01


def place_xy(point: Vector) -> tuple[float, float]:
    """The part of a point that a map shows."""
    return point[0], point[1]


@pytest.mark.slow
def test_four_robots_for_a_while(stage: Rehearsal, hire: Hire) -> None:
    """Four robots drive and sense for 36 s: nothing is warned of, and what they need does not grow
    (robots 122, shortened)."""
    heard: list[str] = []

    class Ear(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            heard.append(record.getMessage())

    ear = Ear(logging.WARNING)
    logging.getLogger(ROOT).addHandler(ear)
    team = [hire("P3AT", f"{{Location 0,{3 * y},-0.3}}")[0] for y in range(10, 14)]
    process, used = psutil.Process(), []
    for part in range(12):
        for number, client in enumerate(team):
            client.send(f"DRIVE {{Left {1 - number * 0.3}}} {{Right {0.2 * part - 1}}}")
        stage.run(3.0)
        assert all(client.take("SEN") for client in team)
        gc.collect()
        used.append(process.memory_info().rss)
    logging.getLogger(ROOT).removeHandler(ear)
    assert heard == []
    assert used[-1] - used[2] < 4 << 20


# -- pictures --------------------------------------------------------------------------------------

WIDTH, HEIGHT = 320, 240
BOX = 0.5
"""m: half the width of the red box."""
DISTANCE = 6.0
"""m from the origin to the face of the box."""


def world(folder: Path, bodies: str) -> Path:
    """A world folder with a floor, light and something on it."""
    (folder / "scene.xml").write_text(
        '<mujoco><worldbody><light type="directional" dir="0.2 0 -1" diffuse="0.3 0.3 0.3"/>'
        f'<geom type="plane" size="0 0 1" rgba="0.5 0.5 0.5 1"/>{bodies}</worldbody></mujoco>'
    )
    (folder / "world.toml").write_text(
        'title = "Yard"\n[[start]]\ntag = "Start"\nposition = [0.0, 0.0, 0.25]\n'
    )
    return folder


@pytest.fixture(scope="module")
def render_loop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with raw pictures of a red box ahead of the start."""
    box = (
        f'<geom type="box" pos="{DISTANCE + BOX} 0 1" size="{BOX} {BOX} 1" rgba="0.9 0.05 0.05 1"/>'
    )
    folder = world(tmp_path_factory.mktemp("yard"), box)
    options = ("--image-port=0", "--image-type=RAW", "--tiles=1x1", "--camera-rate=30")
    with ServerProcess("--world", str(folder), *options) as process:
        yield process


def red_columns(port: int) -> int:
    """Columns of the current picture in which the box is seen in the middle row."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as client:
        client.sendall(b"OK")
        stream = client.makefile("rb")
        _, length = struct.unpack(">BI", stream.read(5))
        data = stream.read(length)
        stream.close()
    assert struct.unpack(">HH", data[:4]) == (WIDTH, HEIGHT)
    picture: NDArray[np.int_] = np.frombuffer(data, np.uint8, offset=4).astype(int)
    row = picture.reshape(HEIGHT, WIDTH, 3)[HEIGHT // 2]
    return int(((row[:, 2] > 2 * row[:, 1]) & (row[:, 2] > 25)).sum())


def expected(fov: float, eye: float) -> float:
    """Columns that a pinhole camera at x = eye (m) shows of the box; all, if it is wider."""
    wide = 2 * BOX / (DISTANCE - eye) * WIDTH / 2 / math.tan(fov / 2)
    return min(float(WIDTH), wide)


def test_zoom_on_the_wire_and_in_the_picture(render_loop: ServerProcess) -> None:
    """The default is 1.3963 rad, 0.2 ends at 0.3491, 3.0 at 2.0944, 0 is the default again, and a
    box has the width that belongs to it (robots 101)."""
    client = render_loop.client()
    client.send("INIT {ClassName P3AT} {Start Start} {Dialect ut2004}")
    client.wait_for("STA")
    client.send("GETGEO {Type Camera}")
    (ahead,) = re.findall(r"Location (-?[\d.]+),", client.wait_for("GEO"))
    for asked, fov in ((None, 1.3963), (0.2, 0.3491), (0.7, 0.7), (3.0, 2.0944), (0, 1.3963)):
        if asked is not None:
            client.send(f"SET {{Type Camera}} {{Name Camera}} {{Opcode Zoom}} {{Params {asked}}}")
        client.send("GETCONF {Type Camera}")
        (told,) = re.findall(r"\{CameraFov ([\d.]+)\}", client.wait_for("CONF {Type Camera}"))
        assert float(told) == pytest.approx(fov, abs=2e-4)
        wanted = pytest.approx(expected(fov, float(ahead)), abs=3.0)
        assert eventually(lambda: red_columns(render_loop.ports["images"]) == wanted), fov  # noqa: B023
    client.close()


def ports(endpoints: dict[str, Endpoint]) -> dict[str, int]:
    """Port numbers by service."""
    return {name: endpoint.port for name, endpoint in endpoints.items()}


# -- images ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tag", "kind"),
    [("raw", 0), ("Super", 1), ("GOOD", 2), ("nOrMaL", 3), ("fair", 4), ("Bad", 5), ("", 3)],
)
def test_every_tag_of_a_type_is_on_the_wire(tag: str, kind: int) -> None:
    """Tags map to types 0 to 5 in any case, none at all to NORMAL (side channels 17, 19); replies
    to OK and U have that type, their payload is as long as told and has the size (side channels 10
    to 14)."""
    settings = load_settings({"image_type": tag, "tile_size": "64x48", "tiles": "2x2"})
    small = {"tile_size": settings.tile_size, "tiles": settings.tiles}
    with running_server(world="empty", image_port=0, image_type=settings.image_type, **small) as (
        _,
        endpoints,
    ):
        looker = BlockingConnection(ports(endpoints)["images"], patience=PATIENCE)
        for request, size in (
            (b"OK", (128, 96)),
            (rectangle(64, 0, 64, 48), (64, 48)),
        ):
            looker.send(request)
            found = looker.picture()
            payload = found.payload
            assert found.kind == kind
            if kind:
                assert payload[:2] + payload[-2:] == b"\xff\xd8\xff\xd9"
                assert Image.open(io.BytesIO(payload)).size == size
            else:
                assert struct.unpack(">HH", payload[:4]) == size
                assert len(payload) == 4 + size[1] * 3 * size[0]
        looker.close()


# -- ground truth, for a long time -----------------------------------------------------------------


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    """A server with both ports that tell positions."""
    with ServerProcess("--world", "empty", "--groundtruth-port=0", "--wireless-port=0") as process:
        yield process


def test_ten_minutes_of_questions(server: ServerProcess) -> None:
    """What a wireless server with the obstacle model asks in ten minutes, without its pauses: every
    reply is read by its splitter, and the server has not grown (side channels 66)."""
    process = psutil.Process(server.process.pid)
    names = ("A", "B", "C")
    team = []
    for y, name in enumerate(names):
        team.append(server.client())
        team[-1].send(f"INIT {{ClassName P3AT}} {{Name {name}}} {{Location 0,{2 * y},-0.3}}")
        team[-1].wait_for("STA")
    team[0].send("DRIVE {Left 1} {Right 1}")
    model = WirelessModel(server.ports["groundtruth"])
    used = []
    for number in range(600):
        assert set(model.positions()) == set(names)
        if number % 10 == 0:
            for one, other in permutations(names, 2):
                assert model.obstacles(one, other) == 0
        if number % 100 == 99:
            used.append(process.memory_info().rss)
    assert used[-1] - used[1] < 8 << 20
    model.client.close()
    for client in team:
        client.close()


@pytest.mark.parametrize("service", ["groundtruth", "wireless"])
def test_positions_are_told_on_both_ports(server: ServerProcess, service: str) -> None:
    """Ground truth answers on the port of the embedded wireless server, too, so that one that runs
    elsewhere may be told either address (side channels 47, 53, 54, 100)."""
    robot = server.client()
    robot.send("INIT {ClassName P3AT} {Name Solo} {Location 0,20,-0.3}")
    robot.wait_for("STA")
    client = ScriptedClient(server.ports[service])
    assert client.read_for(0.2) == []
    client.send_bytes(b"GETPOS\r\ngetobs {From solo} {To Nobody}\r\n")
    _, groups = split_reply(client.wait_for("POSITIONS"))
    assert "Solo" in [group.get("Name") for group in groups[1:]]
    assert client.read_line() == "NUMOBS {From solo} {To Nobody} {ObstCount -1.0000}"
    client.close()
    robot.close()


# -- ports -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", SIDE_PORTS)
def test_every_port_can_be_chosen(key: str) -> None:
    """Asked for alone a service listens where it was told, and nothing else does
    (side channels 99)."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = probe.getsockname()[1]
    with running_server(world="empty", **{key: free}) as (_, endpoints):
        found = ports(endpoints)
        assert set(found) == {"control", key.removesuffix("_port").replace("image", "images")}
        assert free in found.values()
        socket.create_connection(("127.0.0.1", free), timeout=PATIENCE).close()


def test_every_port_can_be_disabled() -> None:
    """With all of them off there is robot control only (side channels 99)."""
    settings = load_settings(dict.fromkeys(SIDE_PORTS, "off"))
    assert [getattr(settings, key) for key in SIDE_PORTS] == [None] * len(SIDE_PORTS)
    with running_server(world="empty") as (_, endpoints):
        assert set(endpoints) == {"control"}
