"""Checks of the side channels reference that need a whole server, and all of its ports.

Numbers in docstrings are those of the side channels reference, section 11.
"""

from __future__ import annotations

import io
import socket
import struct
from collections.abc import Iterator
from itertools import permutations

import psutil
import pytest
from PIL import Image
from side_clients import WirelessModel, split_reply

from usarsim_server.services.listener import Endpoint
from usarsim_server.settings import load_settings
from usarsim_server.testing import (
    PATIENCE,
    SIDE_PORTS,
    ScriptedClient,
    ServerProcess,
    running_server,
)


class Looker:
    """An image client that reads exactly what a header announces."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self._stream = self.socket.makefile("rb")

    def ask(self, request: bytes = b"OK") -> tuple[int, bytes]:
        """Type and payload of the reply to a request."""
        self.socket.sendall(request)
        kind, length = struct.unpack(">BI", self._stream.read(5))
        return kind, self._stream.read(length)

    def close(self) -> None:
        """Hang up."""
        self._stream.close()
        self.socket.close()


def ports(endpoints: dict[str, Endpoint]) -> dict[str, int]:
    """Port numbers by service."""
    return {name: endpoint.port for name, endpoint in endpoints.items()}


# -- images ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tag", "kind"),
    [("raw", 0), ("Super", 1), ("GOOD", 2), ("nOrMaL", 3), ("fair", 4), ("Bad", 5), ("", 3)],
)
def test_every_tag_of_a_type_is_on_the_wire(tag: str, kind: int) -> None:
    """Tags map to types 0 to 5 in any case, none at all to NORMAL (checks 17, 19); replies to OK
    and U have that type, their payload is as long as told and has the size (checks 10 to 14)."""
    settings = load_settings({"image_type": tag, "tile_size": "64x48", "tiles": "2x2"})
    small = {"tile_size": settings.tile_size, "tiles": settings.tiles}
    with running_server(world="empty", image_port=0, image_type=settings.image_type, **small) as (
        _,
        endpoints,
    ):
        looker = Looker(ports(endpoints)["images"])
        for request, size in (
            (b"OK", (128, 96)),
            (b"U" + struct.pack(">4I", 64, 0, 64, 48), (64, 48)),
        ):
            found, payload = looker.ask(request)
            assert found == kind
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
    reply is read by its splitter, and the server has not grown (check 66)."""
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
    elsewhere may be told either address (checks 47, 53, 54, 100)."""
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
    """Asked for alone a service listens where it was told, and nothing else does (check 99)."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = probe.getsockname()[1]
    with running_server(world="empty", **{key: free}) as (_, endpoints):
        found = ports(endpoints)
        assert set(found) == {"control", key.removesuffix("_port").replace("image", "images")}
        assert free in found.values()
        socket.create_connection(("127.0.0.1", free), timeout=PATIENCE).close()


def test_every_port_can_be_disabled() -> None:
    """With all of them off there is robot control only (check 99)."""
    settings = load_settings(dict.fromkeys(SIDE_PORTS, "off"))
    assert [getattr(settings, key) for key in SIDE_PORTS] == [None] * len(SIDE_PORTS)
    with running_server(world="empty") as (_, endpoints):
        assert set(endpoints) == {"control"}
