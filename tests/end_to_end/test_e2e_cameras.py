"""Cameras on the control port: tiles, CONF, GEO, zoom and viewports over sockets."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from usarsim_server.app import Assembly
from usarsim_server.testing import ScriptedClient, eventually, running_server

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
    """Unasked CONF before the first STA, the same when asked, exact (checks 36 to 41, 138)."""
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
    """It is the first line after INIT in udk; ut2004 gets one that it passes over (check 38)."""
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
    """The next camera takes the lowest free tile; the others stay where they are (check 44)."""
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
    """FOV 0.5 narrows the view, without a reply; nameless 0.35 and 0 too (checks 45, 101, 166)."""
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
    """The camera of a P2AT sits on its pan-tilt, that of a P3AT on the body (check 134)."""
    old, new = spawn("{ClassName P2AT}"), spawn("{ClassName P3AT}")
    assert ask(old, "GETGEO {Type Camera}").endswith("Mount CameraPanTilt_Link2}")
    assert ask(new, "GETGEO {Type Camera} {Name Camera}").endswith("{Mount P3AT}")


def test_viewports_never_break_the_connection(
    spawn: Callable[..., ScriptedClient], server: tuple[Assembly, int]
) -> None:
    """Known clients choose a single camera; nonsense is answered or ignored (check 46)."""
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
    """A grid of one small tile: the first camera has it, the others report the origin (40, 43)."""
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
            watch = assembly.studio.watch(assembly.board.grid.region(0), lambda frame: None)
            wait(lambda: assembly.studio.pictures > 0)
            start, before = assembly.fleet.time, assembly.studio.pictures
            wait(lambda: assembly.fleet.time > start + 4.0)
            taken, seconds = assembly.studio.pictures - before, assembly.fleet.time - start
            watch.close()
        assert 3 <= taken <= 2.0 * seconds + 2.0
