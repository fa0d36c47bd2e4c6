"""Image clients of all generations against whole servers, over sockets only."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from legacy_image_clients import (
    ArDrone,
    ButtonClient,
    BytewiseClient,
    ImageTester,
    LcmProxy,
    Pixels,
    Poaret,
    SampleClient,
    SimpleUi,
    decoded,
)

from usarsim_client import BlockingConnection, rectangle
from usarsim_server.testing import (
    PATIENCE,
    ScriptedClient,
    ServerProcess,
    eventually,
    running_server,
)

WORLD = "arena"
STARTS = ("RobotStart1", "RobotStart2")


class Asker(BlockingConnection):
    """A client without narrow habits, for what the narrow ones cannot see."""

    def __init__(self, server: ServerProcess) -> None:
        super().__init__(server.ports["images"], patience=PATIENCE)

    def ask(self, request: bytes = b"OK") -> tuple[int, bytes]:
        """Type and payload of the answer."""
        self.send(request)
        return self.reply()

    def reply(self) -> tuple[int, bytes]:
        """Type and payload of what comes next."""
        found = self.picture()
        return found.kind, found.payload

    def tile(self, number: int) -> Pixels:
        """One tile of the default grid."""
        row, column = divmod(number, 4)
        kind, payload = self.ask(rectangle(column * 320, row * 240, 320, 240))
        assert kind == 3
        return decoded(payload)

    def raw(self, request: bytes = b"OK") -> Pixels:
        """A picture of a server that sends no JPEG."""
        self.send(request)
        found = self.picture()
        assert found.raw
        return found.pixels

    def silent_for(self, seconds: float) -> bool:
        """Whether nothing comes."""
        self.socket.settimeout(seconds)
        try:
            return bool(self.socket.recv(1)) and False
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(PATIENCE)


def robot(server: ServerProcess, start: str) -> ScriptedClient:
    """A robot with a camera, in the world."""
    client = server.client()
    client.send(f"INIT {{ClassName P3AT}} {{Start {start}}}")
    client.wait_for("STA")
    return client


def drone(server: ServerProcess) -> ScriptedClient:
    """An ARDrone as its client starts it: the camera that looks down is in its first tile."""
    client = server.client()
    client.send(f"INIT {{ClassName USARBot.ARDrone}} {{Name ARDrone}} {{Start {STARTS[0]}}}")
    client.send("SET {Type Viewports} {Config SingleView} {Viewport1 Camera2}")
    assert "{Viewport1 Camera2} {Status OK}" in client.wait_for("RES")
    return client


def empty(picture: Pixels) -> bool:
    """Whether nothing is to be seen in a tile: one dark colour, but for what JPEG makes of it."""
    middle = picture[8:-8, 8:-8]
    return float(middle.mean()) < 60.0 and float(middle.std()) < 2.0


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    """A server with the default settings of images."""
    with ServerProcess("--world", WORLD, "--image-port", "0") as process:
        yield process


@pytest.fixture(scope="module")
def team(server: ServerProcess) -> Iterator[list[ScriptedClient]]:
    """Two robots with cameras: tiles 0 and 1."""
    robots = [robot(server, start) for start in STARTS]
    yield robots
    for one in robots:
        one.close()


@pytest.fixture
def asker(server: ServerProcess) -> Iterator[Asker]:
    """A client of the images, which speaks before it would be sent a picture unasked."""
    client = Asker(server)
    client.ask()
    yield client
    client.close()


def test_images_need_no_robot() -> None:
    """Side channels 1 to 3: connect before any robot, hear nothing for a second, get one frame."""
    with ServerProcess(
        "--world", "empty", "--image-port", "0", "--image-silent-push", "60"
    ) as server:
        asker = Asker(server)
        assert asker.silent_for(1.0)
        kind, payload = asker.ask()
        assert (kind, decoded(payload).shape) == (3, (960, 1280, 3))
        assert asker.silent_for(0.2)
        asker.close()
        assert server.end() == 0
        assert "Traceback" not in server.errors


@pytest.mark.usefixtures("team")
class TestClients:
    """Side channels reference 2.12: what each known client relies on."""

    def test_ros_sample_client(self, server: ServerProcess) -> None:
        """One JPEG per request; the first two of its four views show the two robots' cameras."""
        with SampleClient(server.ports["images"]) as client:
            # While the renderer is late pictures are old or grey.
            assert eventually(
                lambda: [empty(view) for view in client.views()] == [False, False, True, True]
            )

    def test_lcm_proxy(self, server: ServerProcess) -> None:
        """A square grid that fills the frame: tile 2 of 4 columns is the second robot's."""
        for tile, is_empty in ((2, False), (6, True)):
            with LcmProxy(server.ports["images"], tile, 4) as client:
                assert client.view().shape == (240, 320, 3)
                assert eventually(lambda: empty(client.view()) == is_empty)  # noqa: B023

    def test_poaret(self, server: ServerProcess, asker: Asker) -> None:
        """Side channels 22: three zero bytes are skipped; robot 1 is on the second tile."""
        with Poaret(server.ports["images"], 1) as client:
            seen = [client.view() for _ in range(3)]
            assert not empty(seen[-1])
            assert eventually(
                lambda: bool(np.abs(client.view().astype(float) - asker.tile(1)).mean() < 8.0)
            )

    def test_button_client(self, server: ServerProcess) -> None:
        """Side channels 12: what arrives after a request is a picture behind five bytes."""
        with ButtonClient(server.ports["images"]) as client:
            assert client.press().shape == (960, 1280, 3)

    @pytest.mark.parametrize("text", [b"OK", b"OK\r\n"])
    def test_image_tester(self, server: ServerProcess, text: bytes) -> None:
        """Side channels 9 and 33: one picture per request at a fixed period, and none beyond."""
        with ImageTester(server.ports["images"], text, 0.01) as client:
            assert len(client.lengths(30)) == 30
            assert client.quiet_for(0.3)

    def test_client_that_waits_for_one_byte(self, server: ServerProcess) -> None:
        """The type byte comes alone, unless the client was not run for the moment after it."""
        with BytewiseClient(server.ports["images"]) as client:
            assert client.pictures_seen(20) > 10

    def test_client_of_the_manual(self, server: ServerProcess) -> None:
        """The ten lines of docs/cameras.md."""
        with socket.create_connection(("127.0.0.1", server.ports["images"])) as connection:
            connection.sendall(b"OK")
            with connection.makefile("rb") as stream:
                header = stream.read(5)
                picture = stream.read(int.from_bytes(header[1:]))
        assert decoded(picture).shape == (960, 1280, 3)


class TestWorld:
    """What pictures show of the world, and what the world notices of them."""

    def test_rectangle_of_the_frame_is_the_frame(self, asker: Asker) -> None:
        """Side channels 20."""
        kind, payload = asker.ask(rectangle(0, 0, 1280, 960))
        assert (kind, decoded(payload).shape) == (3, (960, 1280, 3))

    def test_rectangle_outside_is_empty(self, asker: Asker) -> None:
        """Side channels 25: one reply without payload, and the connection lives on."""
        assert asker.ask(rectangle(1280, 0, 320, 240)) == (3, b"")
        assert asker.ask()[0] == 3

    def test_conf_names_the_rectangle(self, team: list[ScriptedClient], asker: Asker) -> None:
        """Side channels 21: the rectangle of CONF shows that camera, at the size of a tile."""
        team[1].send("GETCONF {Type Camera}")
        conf = team[1].wait_for("CONF {Type Camera}")
        found = [
            int(re.search(rf"{{Texture{name} (\d+)}}", conf)[1])  # type: ignore[index]
            for name in ("OffsetX", "OffsetY", "ResolutionX", "ResolutionY")
        ]
        assert found == [320, 0, 320, 240]
        _, payload = asker.ask(rectangle(*found))
        assert decoded(payload).shape == (240, 320, 3)
        assert not empty(decoded(payload))

    def test_pictures_follow_the_robot(self, team: list[ScriptedClient], asker: Asker) -> None:
        """Side channels 34: a standing robot's pictures are the same, a turning one's become
        others."""
        seen = asker.tile(0).astype(float)

        def changed() -> float:
            nonlocal seen
            before, seen = seen, asker.tile(0).astype(float)
            return float(np.abs(before - seen).mean())

        assert eventually(lambda: changed() < 1.0)
        team[0].send("DRIVE {Left -1.5} {Right 1.5}")
        for _ in range(3):
            team[0].listen(0.3)
            assert eventually(lambda: changed() > 1.0)
        team[0].send("DRIVE {Left 0} {Right 0}")

    def test_stalled_client_stops_nobody(
        self, server: ServerProcess, team: list[ScriptedClient], asker: Asker
    ) -> None:
        """Side channels 30 and 31: status lines and pictures of others go on; then the stream is
        whole."""
        stalled = Asker(server)
        stalled.socket.sendall(b"OK" * 20)
        for _ in range(5):
            assert team[0].wait_for("STA")
            assert asker.ask()[0] == 3
        for _ in range(20):
            kind, payload = stalled.reply()
            assert (kind, decoded(payload).shape) == (3, (960, 1280, 3))
        assert stalled.silent_for(0.2)
        stalled.close()

    def test_frame_outlives_its_robots(self, server: ServerProcess, asker: Asker) -> None:
        """Side channels 32 and 35: robots and clients leave; the connection and the geometry
        stay."""
        guest = robot(server, "RobotStart3")
        number = 2
        assert eventually(lambda: not empty(asker.tile(number)))
        vanishing = Asker(server)
        vanishing.socket.sendall(b"OK" * 5)
        vanishing.socket.recv(100)
        vanishing.close()
        guest.close()
        assert eventually(lambda: empty(asker.tile(number)))
        kind, payload = asker.ask()
        assert (kind, decoded(payload).shape) == (3, (960, 1280, 3))
        assert "Traceback" not in server.errors


@pytest.mark.slow
class TestOldClients:
    """Clients that speak only after a picture, and other types and grids."""

    SMALL = ("--tiles", "1x1", "--tile-size", "176x144")

    def test_ar_drone_in_legacy_mode(self) -> None:
        """Side channels 11, 13, 14 and 27: raw, legacy, a single small tile, all that client can
        do; the class that it asks for, showing the camera that looks down."""
        options = ("--image-type", "RAW", "--image-legacy", *self.SMALL)
        with (
            ServerProcess("--world", WORLD, "--image-port", "0", *options) as server,
            drone(server),
            ArDrone(server.ports["images"]) as client,
        ):
            views = [client.view() for _ in range(4)]
        assert not empty(views[-1])

    def test_the_drone_has_small_pictures_in_any_tile(self) -> None:
        """Camera2 of an ARDrone makes pictures of 176 x 144 (addendum of the protocol reference):
        they stand in the corner of its tile, and are all that a client bound to it gets."""
        with (
            ServerProcess("--world", WORLD, "--image-port", "0", "--image-type", "RAW") as server,
            drone(server) as controller,
        ):
            asker = Asker(server)

            def drawn() -> bool:
                # All grey until the first picture is there.
                tile = asker.raw(rectangle(0, 0, 320, 240))
                rest = bool(tile[144:].any() or tile[:, 176:].any())
                return not rest and not empty(tile[:144, :176])

            assert eventually(drawn)
            controller.send("SET {Type Camera} {Robot ARDrone} {Name Camera2} {Client 127.0.0.1}")
            controller.wait_for("RES")
            assert asker.raw().shape == (144, 176, 3)
            asker.close()

    def test_ar_drone_without_legacy_mode(self) -> None:
        """Side channels 2.12: a client that waits silently is sent its first picture at last."""
        options = ("--image-type", "RAW", "--image-silent-push", "0.3", *self.SMALL)
        with (
            ServerProcess("--world", WORLD, "--image-port", "0", *options) as server,
            ArDrone(server.ports["images"]) as client,
        ):
            for _ in range(3):
                assert client.view().shape == (144, 176, 3)

    def test_clients_of_image_srv(self, tmp_path: Path) -> None:
        """Side channels 17 and 28: pictures come first; one that asks at once gets two."""
        config = tmp_path / "lab.toml"
        config.write_text('image_type = "Good"\nimage_legacy = true\ntiles = "2x2"\n')
        with ServerProcess(
            "--config", str(config), "--world", "empty", "--image-port", "0"
        ) as server:
            with SimpleUi(server.ports["images"]) as client:
                for _ in range(3):
                    assert client.picture().shape == (480, 640, 3)
            hasty = Asker(server)
            assert [hasty.ask()[0], hasty.reply()[0]] == [2, 2]
            assert hasty.silent_for(0.3)
            hasty.close()

    def test_client_whose_view_is_bound(self) -> None:
        """Side channels 2.11: SET Camera Client makes one camera the whole picture of a client."""
        with ServerProcess("--world", WORLD, "--image-port", "0") as server:
            controller = server.client()
            controller.send(f"INIT {{ClassName P3AT}} {{Name Scout}} {{Start {STARTS[0]}}}")
            controller.wait_for("STA")
            asker = Asker(server)
            assert decoded(asker.ask()[1]).shape == (960, 1280, 3)
            camera = "{Type Camera} {Robot Scout} {Name Camera}"
            controller.send(f"SET {camera} {{Client 127.0.0.1}}\r\nGETCONF {{Type Camera}}")
            controller.wait_for("CONF {Type Camera}")
            assert decoded(asker.ask()[1]).shape == (240, 320, 3)
            controller.send("SET {Type Camera} {Client 127.0.0.1}\r\nGETCONF {Type Camera}")
            controller.wait_for("CONF {Type Camera}")
            assert decoded(asker.ask()[1]).shape == (960, 1280, 3)
            asker.close()
            controller.close()

    def test_taken_port_is_a_warning(self, caplog: pytest.LogCaptureFixture) -> None:
        """Side channels 2.7: a port that nobody asked for is taken, as the default one may be, and
        the server goes on without images."""
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            with running_server(world="empty", image_port=port) as (_, endpoints):
                client = ScriptedClient(endpoints["control"].port)
                assert client.read_line().startswith("NFO {Gametype")
                client.close()
        assert set(endpoints) == {"control"}
        [warning] = [one for one in caplog.messages if "goes on without images" in one]
        assert f"port {port} is already in use" in warning
        assert "--image-port" in warning
